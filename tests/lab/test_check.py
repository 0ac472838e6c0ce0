"""What `skydog lab check` says of a site, and that it says it of what is truly connected."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("msgspec", reason="skydog[lab] is not installed")

from skydog.lab import check, guard, setup, site, topics
from skydog.lab.site import DDS, ROS1, Cage, UAVSite, UGVSite

EXAMPLES = Path(__file__).parents[2] / "examples" / "sites"
SITE = site.load(EXAMPLES / "tum_simulator.toml")


def wrong(it):
    """The lines of a site that are not right."""
    return [line for line in check.lines(it) if not line.ok]


def only(it):
    """The one line of a site that is not right."""
    (line,) = wrong(it)
    return line


def with_mission(**changes):
    return replace(SITE, mission=replace(SITE.mission, **changes))


def with_ugv(**changes):
    return replace(SITE, ugv=(replace(SITE.ugv[0], **changes), *SITE.ugv[1:]))


def with_uav(**changes):
    return replace(SITE, uav=(replace(SITE.uav[0], **changes),))


def with_mocap(**changes):
    return replace(SITE, mocap=replace(SITE.mocap, **changes))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_nothing_is_wrong_with_an_example(path):
    assert wrong(site.load(path)) == []


def test_each_adapter_of_a_drone_has_an_example():
    shown = {uav.adapter for path in EXAMPLES.glob("*.toml") for uav in site.load(path).uav}
    assert shown == set(site.UAVAdapter.__args__)


def test_a_cage_that_is_too_small_is_told_the_numbers_that_fit():
    line = only(replace(SITE, cage=Cage((-0.4, 6.7), (-0.7, 6.7), (-0.5, 3.0))))
    assert "-0.2 to 6.2 m, does not fit into cage.x, -0.4 to 6.7 m" in line.what
    assert "at least [-0.5, 6.5], cage.z [-0.5, 2.3]" in line.write


def test_the_numbers_that_are_told_fit():
    fits = replace(SITE, cage=Cage((-0.5, 6.5), (-0.5, 6.5), (-0.5, 2.3)))
    assert wrong(fits) == []
    assert "does not fit" in only(with_mission(preset="paper")).what  # 1.4 m beyond the walls


def test_a_rover_that_is_too_slow_is_told_the_mission_that_it_can_drive():
    line = only(with_ugv(speed=0.22))
    assert "ugv1 can do 0.22 m/s, the mission asks for 0.5 m/s" in line.what
    assert line.write == "mission.speed = 0.44"
    slower = with_ugv(speed=0.22)
    assert wrong(replace(slower, mission=replace(slower.mission, speed=0.44))) == []


def test_the_slowest_of_several_robots_decides_the_speed():
    rovers = tuple(replace(ugv, speed=0.1 * n) for n, ugv in enumerate(SITE.ugv, 2))
    assert {line.write for line in wrong(replace(SITE, ugv=rovers))} == {"mission.speed = 0.4"}


def test_a_drone_of_the_wrong_kind_is_told():
    assert 'uav.profile = "ardrone2"' in only(with_uav(adapter="ardrone-autonomy")).write
    assert 'uav.profile = "tum-simulator"' in only(with_uav(profile="ardrone2")).write


def test_a_battery_that_is_too_small_is_told_how_many_steps_it_lasts():
    line = only(with_uav(battery_minutes=3.0))
    assert line.write == "mission.steps = 570"
    fits = with_uav(battery_minutes=3.0)
    assert wrong(replace(fits, mission=replace(fits.mission, steps=570))) == []
    assert wrong(replace(fits, mission=replace(fits.mission, steps=571))) != []
    assert only(with_uav(battery_minutes=0.5)).write == "a larger battery"


@pytest.mark.parametrize(
    ("mission", "said"),
    [
        ({"sheepdog": "no-such-dog"}, "no-such-dog"),
        ({"preset": "moon"}, "moon"),
        ({"goal": (7.0, 7.0)}, "goal"),
    ],
)
def test_a_mission_that_cannot_be_is_told(mission, said):
    assert said in only(with_mission(**mission)).what


def test_a_profile_that_is_not_there_is_told_and_the_rest_is_checked_all_the_same():
    found = check.lines(with_uav(profile="eagle"))
    assert [line.ok for line in found].count(False) == 1
    assert any("navdata" in line.what for line in found)


def test_what_a_sheepdog_was_not_taught_for_is_said_and_is_no_fault():
    pair = replace(SITE, ugv=SITE.ugv[:2])
    (line,) = [line for line in check.lines(pair) if "was trained" in line.what]
    assert line.ok
    assert "with 3 sheep, not 2" in line.what
    assert "skydog twin h-ddpg-6x6" in line.write
    assert wrong(with_mission(sheepdog="strombom")) == []


def test_a_rover_that_may_run_on_is_told_its_guard():
    line = only(with_ugv(topic="", stops_by_itself=False))
    assert 'guard = true, topic = "/ugv1/cmd_vel_in"' in line.write
    assert line.write.endswith(
        "python3 guard.py --in /ugv1/cmd_vel_in --out /ugv1/cmd_vel --max-speed 0.5 "
        "--max-turn-rate 3.14"
    )


def test_a_guard_that_is_not_between_is_told():
    line = only(with_ugv(topic="/ugv1/cmd_vel", stops_by_itself=False, guard=True))
    assert "not between" in line.what
    assert 'topic = "/ugv1/cmd_vel_in"' in line.write


def test_a_drone_whose_driver_keeps_the_last_twist_is_told_its_guard():
    line = only(with_uav(topic="", guard=False))
    assert 'guard = true, topic = "/cmd_vel_in"' in line.write
    assert "--out /cmd_vel --land /ardrone/land --max-speed 2" in line.write


def test_the_guard_understands_what_the_check_writes(monkeypatch):
    options = None
    for robot in (*SITE.uav, *SITE.ugv, UGVSite("odd", stamped=True, speed=0.26, turn_rate=1.82)):
        monkeypatch.setattr("sys.argv", check.guard(robot).split()[1:])
        options = guard._options()
        assert options.source == options.out + "_in"
    assert options is not None
    assert (options.stamped, options.max_speed, options.max_turn_rate) == (True, 0.26, 1.82)


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (UAVSite("d", "twist-dds"), "its driver"),
        (UAVSite("d", "crazyswarm2", "crazyflie"), "levels out"),
        (UAVSite("d", "crazyflie", "crazyflie", uri="udp://x"), "levels out"),
        (UAVSite("d", "mavlink", uri="udpin:x:1"), "COM_OBL_RC_ACT"),
    ],
)
def test_a_drone_that_no_guard_reaches_is_told_what_stops_it(robot, said):
    assert said in only(replace(SITE, uav=(robot,))).write
    assert wrong(replace(SITE, uav=(replace(robot, stops_by_itself=True),))) == []


def test_a_rover_of_ros_2_is_not_told_a_guard_that_speaks_ros_1():
    line = only(with_ugv(adapter="dds", stops_by_itself=False, guard=True, topic="/a_in"))
    assert "cmd_vel_timeout" in line.write
    assert "guard.py" not in line.write


def test_a_flock_of_its_own_is_neither_driven_nor_guarded():
    own = replace(with_ugv(stops_by_itself=False), mission=replace(SITE.mission, flock="own"))
    assert wrong(own) == []
    assert not any("mobile_base" in line.what for line in check.lines(own))


def test_two_robots_on_one_topic_are_told():
    line = only(with_ugv(topic=SITE.ugv[1].topic))
    assert "ugv1 and ugv2 obey the same commands" in line.what


@pytest.mark.parametrize(("rovers", "block"), [(2, 256), (3, 512), (5, 512), (6, 1024)])
def test_the_block_size_is_told_that_holds_the_bodies(rovers, block):
    ugv = tuple(UGVSite(f"ugv{n}", stops_by_itself=True) for n in range(rovers))
    found = check.lines(replace(with_mocap(source="vicon-udp"), ugv=ugv))
    assert any(f"block size has to be {block} at least" in line.what for line in found)


def test_more_bodies_than_a_packet_holds_are_told():
    ugv = tuple(UGVSite(f"ugv{n}", stops_by_itself=True) for n in range(13))
    line = only(replace(with_mocap(source="vicon-udp"), ugv=ugv))
    assert "at most 13 bodies fit" in line.what


@pytest.mark.parametrize(
    ("host", "advice"),
    [
        ("127.0.0.1", "if the tracker is another computer"),
        ("0.0.0.0", "so that no other is heard"),
        ("192.168.10.2", "keep that network"),
    ],
)
def test_who_can_send_poses_is_told(host, advice):
    found = check.lines(with_mocap(source="vicon-udp", host=host))
    (line,) = [line for line in found if "are received at" in line.what]
    assert line.ok
    assert advice in line.write


def test_poses_of_a_flight_log_are_no_eyes():
    assert "nobody sees the robots" in only(with_mocap(source="replay", host="a.mcap")).what


def test_a_node_that_robots_cannot_reach_is_told():
    far = ROS1("http://192.168.1.2:11311")
    assert "ros1.address" in only(replace(SITE, ros1=far)).write
    assert wrong(replace(SITE, ros1=replace(far, address="192.168.1.3"))) == []


def test_a_domain_that_cannot_reach_its_peers_is_told():
    lab = site.load(EXAMPLES / "ros2_twist.toml")
    assert "dds.interface" in only(replace(lab, dds=replace(lab.dds, interface="lo"))).write
    assert "dds.peers" in only(replace(lab, dds=DDS(interface="eth0"))).write


class Recorder:
    """Stands for a node or a domain, and notes down which topics it is asked for."""

    def __init__(self):
        self.asked = []

    def publisher(self, topic, kind):
        self.asked.append(topics.Topic(topic, kind._type, True))

    def subscribe(self, topic, kind, *_):
        kind = kind if isinstance(kind, str) else kind._type
        self.asked.append(topics.Topic("/" + topic.lstrip("/"), kind.replace("/msg", ""), False))

    def publish(self, topic, kind):
        self.asked.append(topics.Topic(topic, kind.replace("/msg", ""), True))

    def write(self, topic, kind):  # the request of a service, which is no topic of ROS 2's
        assert topic.startswith("rq/")

    def waiting(self, subscriptions):
        return None


def asked(module, kind, *arguments):
    """The topics that an adapter takes."""
    wire = {"ros1": "rospy"}.get(module, "cyclonedds")
    pytest.importorskip(wire, reason=f"{wire} is not installed")
    connects = import_module("skydog.lab.ros1_node" if module == "ros1" else "skydog.lab.domain")
    base = connects.Node if module == "ros1" else connects.Domain
    recorder = type("Recording", (Recorder, base), {})()
    getattr(import_module(f"skydog.lab.{module}"), kind)(recorder, *arguments)
    return sorted(recorder.asked)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("topic", ["", "/lab/cmd_vel_in"])
@pytest.mark.parametrize("stamped", [False, True])
def test_the_topics_of_ros_1_are_those_that_its_adapters_take(topic, stamped):
    ugv = UGVSite("ugv1", topic=topic, stamped=stamped)
    uavs = [UAVSite("uav1", name, topic=topic) for name in ("tum-simulator", "ardrone-autonomy")]
    kinds = ["TwistRover", "TumSimulator", "ArdroneAutonomy"]
    for kind, robot in zip(kinds, [ugv, *uavs], strict=True):
        assert asked("ros1", kind, robot) == sorted(topics.of_robot(robot))
    names = ["uav1", "ugv1", "ugv2", "ugv3"]
    told = sorted(topics.of_tracker(SITE))
    assert asked("ros1", "ViconSource", SITE.mocap, names) == told


@pytest.mark.parametrize("topic", ["", "/lab/it"])
@pytest.mark.parametrize("stamped", [False, True])
def test_the_topics_of_ros_2_are_those_that_its_adapters_take(topic, stamped):
    ugv = UGVSite("ugv1", "dds", topic=topic, stamped=stamped)
    twist = UAVSite("uav1", "twist-dds", topic=topic, stamped=stamped)
    swarm = UAVSite("uav1", "crazyswarm2", topic=topic)
    for module, kind, robot in (
        ("dds", "TwistRover", ugv),
        ("dds", "TwistDrone", twist),
        ("crazyswarm2", "Crazyswarm2Drone", swarm),
    ):
        assert asked(module, kind, robot) == sorted(topics.of_robot(robot))
    for pattern in ("", "/poses", "/NAME/pose"):
        seen = replace(SITE, mocap=replace(SITE.mocap, source="ros2", topic=pattern))
        names = [robot.name for robot in (*seen.uav, *seen.ugv)]
        told = sorted(topics.of_tracker(seen))
        assert asked("dds", "PoseSource", pattern, names) == told


def test_what_the_check_says_is_what_a_flight_would_be_refused_for():
    for refused in (with_mission(preset="paper"), with_mission(sheepdog="no-such-dog")):
        line = only(refused)
        with pytest.raises(setup.Refusal, match=line.what[:40]):
            setup.setup(refused)
