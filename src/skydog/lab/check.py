"""What is right and what is wrong with a site, line by line, before anything is connected."""

import shlex
from collections.abc import Iterator
from math import floor, inf
from typing import NamedTuple

from skydog.errors import Refusal
from skydog.flight import altitude, profiles, station
from skydog.lab import setup, topics, vicon
from skydog.lab.lookout import TAKES_OFF
from skydog.lab.preflight import USED
from skydog.lab.site import Mission, Site, UAVSite, UGVSite
from skydog.shepherds import finding, scope, store
from skydog.world.params import World

OPEN = "keep that network to the laboratory: who is in it can send too"
SPEAKS_ROS1, RADIO = {"ros1", "tum-simulator", "ardrone-autonomy"}, {"crazyflie", "mavlink"}
LOOPBACK = ("127.", "localhost", "::1", "[::1]")


class Line(NamedTuple):
    """One line of the check."""

    ok: bool
    what: str  # what was found
    write: str = ""  # what to write in the site file, or to do; of a line that is ok, an advice

    def __str__(self) -> str:
        return f"{'ok   ' if self.ok else 'WRONG'} {self.what}" + (
            f"\n      → {self.write}" if self.write else ""
        )


def lines(site: Site) -> list[Line]:
    """All that can be told of a site without connecting to anything: no network, no robot."""
    found = list(_profiles(site))
    known = all(line.ok for line in found)
    try:
        world = setup.world(site)
    except Refusal as problem:
        world = None
        found.append(Line(False, str(problem)))
    if world is not None:
        found += _mission(site, world)
        if known:
            found += _airspace(site, world)
            found += _speeds(site, world)
    found += _tracker(site)
    found += _networks(site)
    for robot in (*site.uav, *site.ugv):
        found += _wires(site, robot)
        if known:
            found.append(_stops(site, robot))
    found += _apart(site)
    if world is not None:
        found += (_battery(site.mission, uav, world) for uav in site.uav)
    return found


def guard(robot: UAVSite | UGVSite) -> str:
    """The command that runs on a robot, so that it stops when the base station falls silent."""
    heard = topics.commands(robot)
    out = topics.behind_guard(heard)
    words = ["python3", "guard.py", "--in", out + topics.GUARDED, "--out", out]
    if isinstance(robot, UAVSite):
        words += ["--land", f"{out.rpartition('/')[0]}/ardrone/land"]
        if robot.adapter == "tum-simulator":
            most = profiles.uav(robot.profile).velocity.largest
            words += ["--max-speed", f"{most:g}"]
    else:
        motion = profiles.rover(robot.profile).motion
        words += ["--max-speed", f"{robot.speed or motion.largest_speed:g}"]
        words += ["--max-turn-rate", f"{robot.turn_rate or motion.largest_turn_rate:g}"]
        words += ["--stamped"] * robot.stamped
    return shlex.join(words)


def _profiles(site: Site) -> Iterator[Line]:
    uav, rover = site.uav[0].profile, site.ugv[0].profile
    for name, read in ((uav, profiles.uav), (rover, profiles.rover)):
        try:
            read(name)
            yield Line(True, f"profile {name}")
        except Refusal as problem:
            yield Line(False, str(problem))


def _mission(site: Site, world: World) -> Iterator[Line]:
    asked, size, dt = site.mission, float(world.arena.size), float(world.arena.dt)
    goal = f"{float(world.arena.goal_x):g},{float(world.arena.goal_y):g}"
    yield Line(
        True,
        f"mission {asked.preset}: arena {size:g} × {size:g} m, goal {goal}, {len(site.ugv)} "
        f"rovers, a decision every {dt:g} s, at most {asked.steps} of them, {asked.steps * dt:g} s",
    )
    if asked.sheepdog in finding.RULES:
        yield Line(True, f"the rule dog {asked.sheepdog}, which learns nothing")
        return
    try:
        card = store.read(asked.sheepdog)[1]
    except Refusal as problem:
        yield Line(False, str(problem), 'mission.sheepdog = "h-ddpg-6x6" is one that ships')
        return
    beyond = scope.beyond(card, world, len(site.ugv))
    flags = f"--preset {asked.preset} --arena {size:g} --sheep {len(site.ugv)} --starts spaced"
    yield Line(
        True,
        f"sheepdog {asked.sheepdog}, "
        + (f"which was trained {'; '.join(beyond)}" if beyond else "trained for this mission"),
        f"fly it in the twin first: skydog twin {asked.sheepdog} {flags}" if beyond else "",
    )


def _airspace(site: Site, world: World) -> Iterator[Line]:
    size, beyond = float(world.arena.size), float(world.dog.airspace)
    highest = altitude.HEIGHT + station.LEVEL * (len(site.uav) - 1)
    try:
        setup.base(site, world)
    except Refusal as problem:
        least, most = -beyond - setup.ROOM, size + beyond + setup.ROOM
        span = f"[{least:.4g}, {most:.4g}]"
        height = f"[{min(site.cage.z[0], 0.0):g}, {highest + setup.HEADROOM:g}]"
        yield Line(False, str(problem), f"cage.x and cage.y at least {span}, cage.z {height}")
        return
    cage = ", ".join(f"{a} {s[0]:g} to {s[1]:g}" for a, s in vars(site.cage).items())
    yield Line(
        True,
        f"the dog keeps within {-beyond:g} to {size + beyond:g} m and flies at up to {highest:g} "
        f"m; the cage is {cage} m",
    )


def _speeds(site: Site, world: World) -> Iterator[Line]:
    speed = site.mission.speed
    asked = {"uav": float(world.dog.speed), "ugv": float(world.sheep.speed)}
    can: list[tuple[UAVSite | UGVSite, str, float]] = [
        (one, "uav", profiles.uav(one.profile).velocity.largest) for one in site.uav
    ]
    if site.mission.flock == "base station":
        for one in site.ugv:
            most = profiles.rover(one.profile).motion.largest_speed
            can.append((one, "ugv", min(most, one.speed or inf)))
    # Down to a hundredth: what is written is to fit.
    fitting = min([floor(100 * speed * most / asked[kind] + 1e-9) / 100 for _, kind, most in can])
    for robot, kind, most in can:
        ok = most >= asked[kind] * (1 - 1e-6)
        yield Line(
            ok,
            f"{robot.name} can do {most:g} m/s, the mission asks for {asked[kind]:.3g} m/s",
            "" if ok else f"mission.speed = {max(fitting, 0.01):g}",
        )
    for one in site.uav:
        tilts = not profiles.uav(one.profile).velocity.on_board
        if tilts != (one.adapter == "ardrone-autonomy"):
            takes = "velocities" if tilts else "tilt"
            fits = "tum-simulator" if tilts else "ardrone2"
            yield Line(
                False,
                f"{one.name}: {one.adapter} commands {takes}, profile {one.profile} does not",
                f'uav.profile = "{fits}", or another profile of such a drone',
            )


def _tracker(site: Site) -> Iterator[Line]:
    mocap = site.mocap
    names = [robot.name for robot in (*site.uav, *site.ugv)]
    yield Line(True, f"the tracker has to call them {', '.join(names)}, at {mocap.rate:g} Hz")
    for topic in topics.of_tracker(site):
        yield Line(True, f"hears {topic.name}, {topic.kind}")
    if mocap.source == "replay":
        yield Line(
            False,
            f"poses come from the flight log {mocap.host}: nobody sees the robots",
            'mocap.source = "vicon-udp", "ros1" or "ros2"; a log is for programs, not for flight',
        )
    if mocap.source != "vicon-udp":
        return
    size = vicon.HEADER.size + len(names) * vicon.ITEM.size
    fits = next((block for block in vicon.BLOCKS if size <= block), None)
    most = (vicon.BLOCKS[-1] - vicon.HEADER.size) // vicon.ITEM.size
    yield Line(
        fits is not None,
        f"{len(names)} bodies are {size} bytes of a packet; "
        + (f"its block size has to be {fits} at least" if fits else f"at most {most} bodies fit"),
        "track nothing else: every other object takes 75 bytes more" if fits else "track fewer",
    )
    where = f"poses are received at {mocap.host}:{mocap.port}"
    if _is_local(mocap.host):
        advice = "if the tracker is another computer: mocap.host = our address in its network"
        yield Line(True, f"{where}: from this computer alone", advice)
    elif mocap.host in ("0.0.0.0", "::", ""):
        advice = "mocap.host = our address in the tracker's network, so that no other is heard"
        yield Line(True, f"{where}: from every network", advice)
    else:
        yield Line(True, where, OPEN)


def _networks(site: Site) -> Iterator[Line]:
    used = {robot.adapter for robot in (*site.uav, *site.ugv)}
    if site.mocap.source == "ros1" or used & SPEAKS_ROS1:
        ros = site.ros1
        far = not _is_local(ros.master.split("://")[-1])
        hidden = far and _is_local(ros.address)
        advice = OPEN if far else "if robots are other computers: ros1.master and ros1.address"
        yield Line(
            not hidden,
            f"ROS 1: the master {ros.master}, and we at {ros.address}"
            + (", where robots cannot reach us" if hidden else ""),
            "ros1.address = our address in the robots' network" if hidden else advice,
        )
    if site.mocap.source == "ros2" or used - SPEAKS_ROS1 - RADIO:
        dds = site.dds
        local = dds.interface == "lo" or _is_local(dds.interface)
        far = [peer for peer in dds.peers if not _is_local(peer)]
        ok = local != bool(far)
        advice = "if robots are other computers: dds.interface, and their addresses as dds.peers"
        if not ok and local:
            advice = 'dds.interface = our network card to them, such as "eth0"'
        elif not ok:
            advice = "dds.peers = the addresses of the robots: nothing is announced by multicast"
        peers = ", ".join(dds.peers) or "nobody"
        yield Line(
            ok,
            f"ROS 2: domain {dds.domain} on {dds.interface}, with {peers}",
            OPEN if ok and far else advice,
        )


def _wires(site: Site, robot: UAVSite | UGVSite) -> Iterator[Line]:
    if isinstance(robot, UGVSite) and site.mission.flock == "own":
        return
    if robot.adapter in RADIO:
        yield Line(True, f"{robot.name}: {robot.adapter} at {getattr(robot, 'uri', '')}")
    for topic in topics.of_robot(robot):
        does = "publishes" if topic.ours else "hears"
        yield Line(True, f"{robot.name}: {does} {topic.name}, {topic.kind}")


def _apart(site: Site) -> Iterator[Line]:
    """Robots that would all obey one command."""
    named: dict[str, list[str]] = {}
    for robot in (*site.uav, *site.ugv):
        where = getattr(robot, "uri", "") if robot.adapter in RADIO else topics.commands(robot)
        named.setdefault(where, []).append(robot.name)
    for where, names in named.items():
        if len(names) > 1:
            write = "a topic, or a uri, for each"
            yield Line(False, f"{' and '.join(names)} obey the same commands, {where}", write)


def _stops(site: Site, robot: UAVSite | UGVSite) -> Line:
    """Whether a robot stops when the base station falls silent, or what makes it."""
    name, flies = robot.name, isinstance(robot, UAVSite)
    if not flies and site.mission.flock == "own":
        return Line(True, f"{name} steers itself: we neither drive it nor stop it")
    if robot.adapter not in SPEAKS_ROS1:
        if robot.stops_by_itself and not robot.guard:
            return Line(True, f"{name} stops by itself when commands cease", _try(flies))
        return Line(
            False,
            f"{name} may obey the last command for ever; the guard speaks ROS 1 and not "
            f"{robot.adapter}",
            f"{_own_stop(robot)}; then, for {name}: stops_by_itself = true, guard = false",
        )
    heard = topics.commands(robot)
    if robot.guard and heard.endswith(topics.GUARDED):
        return Line(True, f"{name} is guarded, if this runs on it: {guard(robot)}")
    if robot.stops_by_itself and not robot.guard:
        return Line(True, f"{name} stops by itself when commands cease", _try(flies))
    why = "its guard is not between" if robot.guard else "it may obey the last command for ever"
    return Line(
        False,
        f"{name}: {why}",
        f'for {name}: guard = true, topic = "{topics.behind_guard(heard)}{topics.GUARDED}"; on the '
        f"robot: {guard(robot)}",
    )


def _own_stop(robot: UAVSite | UGVSite) -> str:
    """What makes a robot stop that no guard of ours can reach."""
    if robot.adapter == "mavlink":
        return "PX4: COM_OF_LOSS_T 0.5, COM_OBL_RC_ACT 4; ArduPilot: GUID_TIMEOUT 0.5"
    if robot.adapter in ("crazyflie", "crazyswarm2"):
        return "the firmware of a Crazyflie levels out after 0.5 s and cuts its motors after 2 s"
    if robot.adapter == "dds":
        return "diff_drive_controller's cmd_vel_timeout, or nav2_velocity_smoother's, at 0.5 s"
    return "its driver has to stop and land it"


def _try(flies: bool) -> str:
    return "see for yourself: end skydog while it " + ("hovers low" if flies else "drives")


def _battery(asked: Mission, uav: UAVSite, world: World) -> Line:
    dt = float(world.arena.dt)
    lasts, needed = 60.0 * uav.battery_minutes * USED, asked.steps * dt + TAKES_OFF
    steps = floor((lasts - TAKES_OFF) / dt)
    ok = lasts >= needed
    return Line(
        ok,
        f"the battery of {uav.name} lasts {lasts:.0f} s, {USED:.0%} of when it is full; "
        f"the mission takes up to {needed:.0f} s",
        "" if ok else f"mission.steps = {steps}" if steps > 0 else "a larger battery",
    )


def _is_local(address: str) -> bool:
    return address.startswith(LOOPBACK)
