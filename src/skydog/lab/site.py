"""The site file: everything that is true of one laboratory and its robots, as TOML."""

import difflib
import tomllib
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from skydog import files
from skydog.errors import Refusal
from skydog.flight.options import Steering

try:
    import msgspec
    from msgspec import Meta
except ImportError:
    raise Refusal("the lab needs msgspec; run: pip install 'skydog[lab]'") from None

LARGEST_FILE = 1 << 16  # bytes

PoseSource = Literal["vicon-udp", "ros1", "ros2", "replay"]
UAVAdapter = Literal[
    "tum-simulator", "ardrone-autonomy", "twist-dds", "crazyswarm2", "crazyflie", "mavlink"
]
UGVAdapter = Literal["ros1", "dds"]

Metres = Annotated[float, Meta(ge=-1000.0, le=1000.0)]
Radians = Annotated[float, Meta(ge=-6.3, le=6.3)]
Point = tuple[Metres, Metres, Metres]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]*\Z", max_length=23)]  # of Vicon and ROS
Text = Annotated[str, Meta(max_length=500)]
Topic = Annotated[str, Meta(pattern=r"^(/?[A-Za-z]\w*(/[A-Za-z]\w*)*)?\Z", max_length=200)]


@dataclass(frozen=True)
class Mission:
    """What is flown."""

    sheepdog: Text = "h-ddpg-6x6"  # a name that ships, a run folder or a file; or strombom
    preset: Text = "paper-physical"
    arena: Annotated[float, Meta(gt=2.0, le=1000.0)] | None = (
        None  # m; the preset's own if not given
    )
    goal: tuple[Metres, Metres] | None = None  # m, x and y; the world's own if not given
    speed: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0  # share of the world's speeds
    steps: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    steering: Steering = "reference"
    # m: the next set-point waits until the drone is so near
    wait: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    flock: Literal["base station", "own"] = "base station"  # who steers the UGVs


@dataclass(frozen=True)
class Cage:
    """The hard fence, in the world's frame: a drone that is seen outside lands. Metres."""

    x: tuple[Metres, Metres]
    y: tuple[Metres, Metres]
    z: tuple[Metres, Metres]


@dataclass(frozen=True)
class Mocap:
    """Motion capture: which stream, and how its frame lies in the world's."""

    source: PoseSource = "vicon-udp"
    host: Text = "127.0.0.1"  # the address of ours that listens; or, of a flight log, its path
    port: Annotated[int, Meta(ge=0, le=65535)] = 51001
    topic: Topic = ""  # ROS: "" is the usual one of the source
    rate: Annotated[float, Meta(ge=20.0, le=1000.0)] = 100.0  # Hz
    origin: Point = (0.0, 0.0, 0.0)  # m: the tracker's origin in the world
    yaw: Radians = 0.0  # by which the tracker's x axis is turned in the world


@dataclass(frozen=True)
class ROS1:
    """The ROS 1 master."""

    master: Text = "http://127.0.0.1:11311"
    address: Text = "127.0.0.1"  # ours, as robots reach it


@dataclass(frozen=True)
class DDS:
    """The DDS domain of ROS 2."""

    domain: Annotated[int, Meta(ge=0, le=232)] = 0
    interface: Text = "lo"
    peers: tuple[Text, ...] = ("127.0.0.1",)


@dataclass(frozen=True)
class UAVSite:
    """A drone: its name at the tracker, what it speaks, and what it is."""

    name: Name
    adapter: UAVAdapter
    profile: Text = "tum-simulator"
    topic: Topic = ""  # of its commands, or a namespace; "" is the adapter's usual one
    uri: Text = ""  # crazyflie: radio://0/80/2M/E7E7E7E7E7, udp://…; mavlink: udpin:…, /dev/…
    stamped: bool = False  # TwistStamped instead of Twist
    offset: Point = (0.0, 0.0, 0.0)  # m: its markers' origin, in its own frame
    yaw: Radians = 0.0  # by which its markers' frame is turned in its own
    stops_by_itself: bool = False  # when commands cease
    guard: bool = False  # `skydog.lab.guard` runs on the robot
    battery_minutes: Annotated[float, Meta(gt=0.0, le=600.0)] = 10.0  # of flight, when full


@dataclass(frozen=True)
class UGVSite:
    """A rover."""

    name: Name
    adapter: UGVAdapter = "ros1"
    profile: Text = "kobuki"
    topic: Topic = ""  # "" is /NAME/cmd_vel
    stamped: bool = False
    offset: Point = (0.0, 0.0, 0.0)
    yaw: Radians = 0.0
    stops_by_itself: bool = False
    guard: bool = False
    speed: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None  # m/s; its profile's if not given
    turn_rate: Annotated[float, Meta(gt=0.0, le=20.0)] | None = None  # rad/s


@dataclass(frozen=True)
class Safety:
    """What the supervisor is stricter in than it is by itself. Seconds, m/s², shares."""

    stale: Annotated[float, Meta(ge=0.02, le=0.1)] = 0.1  # without a pose: hold
    blind: Annotated[float, Meta(ge=0.1, le=0.5)] = 0.5  # land
    alarm: Annotated[float, Meta(ge=0.5, le=1.5)] = 1.5  # call the operator
    missed_decisions: Annotated[int, Meta(ge=1, le=3)] = 3  # in a row: hold
    acceleration: Annotated[float, Meta(gt=0.0, le=4.0)] = 4.0  # of what a drone is commanded
    battery: Annotated[float, Meta(ge=0.15, le=1.0)] = 0.15  # share, at which it lands
    stop_file: Annotated[str, Meta(min_length=1, max_length=200)] = (
        "STOP"  # while this file exists, everything holds; see the docs
    )
    gamepad: Text = ""  # a device such as /dev/input/js0: its first button is held to fly


@dataclass(frozen=True)
class Site:
    """One laboratory."""

    mission: Mission
    cage: Cage
    mocap: Mocap
    ros1: ROS1
    dds: DDS
    uav: tuple[UAVSite, ...]
    ugv: tuple[UGVSite, ...]
    safety: Safety = field(default_factory=Safety)


def load(path: Path) -> Site:
    """The site of a TOML file. Raises `Refusal` for what is none, and says what to write."""
    try:
        table = files.read_toml(path, "site file", LARGEST_FILE)
    except Refusal as problem:
        raise Refusal(f"{problem}, or try skydog lab --emulate") from None
    try:
        return _site(table)
    except Refusal as problem:
        raise Refusal(f"{path}: {problem}") from None


def parse(text: str) -> Site:
    """The site that a TOML text describes. Raises `Refusal`, or ValueError for no TOML."""
    return _site(tomllib.loads(text))


def _site(table: dict[str, Any]) -> Site:
    table = {"mission": {}, "mocap": {}, "ros1": {}, "dds": {}, **table}
    _know(table, Site, "")
    for name, example in (("cage", "x = [-0.7, 6.7]"), ("uav", "[[uav]]"), ("ugv", "[[ugv]]")):
        if name not in table:
            raise Refusal(f"the site lacks {name}; write {example}, see docs/lab.md")
    try:
        site = msgspec.convert(table, Site)
    except msgspec.ValidationError as problem:
        raise Refusal(str(problem).replace("`$.", "`")) from None
    _check(site)
    return site


def _check(site: Site) -> None:
    for axis in "xyz":
        least, most = getattr(site.cage, axis)
        if not least < most:
            raise Refusal(f"cage.{axis} goes from {least:g} to {most:g} m; the smaller is first")
    if site.cage.z[0] > 0.0:
        raise Refusal(f"cage.z begins at {site.cage.z[0]:g} m, above the floor; try -0.5")
    robots = [*site.uav, *site.ugv]
    if not (len(site.uav) == 1 and 1 <= len(site.ugv) <= 50):
        # Two drones that fly one above the other would land through one another.
        raise Refusal(f"a site has 1 uav and 1 to 50 ugv, got {len(site.uav)} and {len(site.ugv)}")
    names = [robot.name for robot in robots]
    for name in sorted({name for name in names if names.count(name) > 1}):
        raise Refusal(f"two robots are called {name}; the tracker tells them apart by name")
    for kind, profiles in (("uav", site.uav), ("ugv", site.ugv)):
        if len({robot.profile for robot in profiles}) > 1:
            raise Refusal(f"all {kind} of a site have one profile, got several")
    for robot in site.uav:
        if robot.adapter in ("crazyflie", "mavlink") and not robot.uri:
            example = "radio://0/80/2M/E7E7E7E7E7" if robot.adapter == "crazyflie" else "udpin:…"
            raise Refusal(f"{robot.name} speaks {robot.adapter} and lacks uri; write {example}")


def _know(table: Any, form: Any, place: str) -> None:
    """Raise `Refusal` for a key that the form does not have."""
    if not isinstance(table, dict) or not is_dataclass(form):
        return
    inner = {"uav": UAVSite, "ugv": UGVSite, "mission": Mission, "cage": Cage, "mocap": Mocap}
    inner |= {"ros1": ROS1, "dds": DDS, "safety": Safety}
    known = [each.name for each in fields(form)]
    for name, value in table.items():
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 1)
            hint = f"did you mean {near[0]}?" if near else f"it knows {', '.join(known)}"
            raise Refusal(f"unknown {place + str(name)!r:.80}; {hint}")
        if form is Site:
            for part in value if isinstance(value, list) else [value]:
                _know(part, inner[name], f"{name}.")
