"""ROS 2's topics over real DDS on loopback, against bare readers and writers of cyclonedds."""

import math
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any
from uuid import uuid4

import pytest

pytest.importorskip("rosbags", reason="skydog[lab] is not installed")
pytest.importorskip("cyclonedds", reason="skydog[lab] is not installed")

from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, ddspy_write
from cyclonedds.sub import DataReader, ddspy_take
from cyclonedds.topic import Topic

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import messages
from skydog.lab.adapters import DroneCommand, Status
from skydog.lab.dds import PoseSource, TwistDrone, TwistRover
from skydog.lab.domain import Domain
from skydog.lab.emulation.dds import DDSDrone, DDSPoses, DDSRover, Phase
from skydog.lab.emulation.drivers import Shown
from skydog.lab.site import DDS, UAVSite, UGVSite

# A domain for each xdist worker and each run of the tests on this machine.
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
SITE = DDS(domain=(os.getppid() * 7 + WORKER) % 90)
TWIST = "geometry_msgs/msg/Twist"
ANY = ViewState.Any | SampleState.Any | InstanceState.Any


def until(happened: Callable[[], Any], seconds: float = 30.0) -> Any:
    """What happened, once it did."""
    end = time.monotonic() + seconds
    while not (seen := happened()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)
    return seen


def command(mode: Mode, **other) -> DroneCommand:
    usual = DroneCommand(
        mode=mode,
        hover=False,
        velocity=(0.3, -0.2, 0.1),
        tilt=(0.0, 0.0),
        setpoint=(1.0, 2.0, 2.0),
        position=(1.0, 2.0, 0.0),
        yaw=0.0,
    )
    return usual._replace(**other)


@pytest.fixture
def station():
    domain = Domain(SITE)
    yield domain
    domain.close()


@pytest.fixture
def robots():
    domain = Domain(SITE)
    yield domain
    domain.close()


@pytest.fixture
def bare(station):
    """A participant without anything of ours."""
    return DomainParticipant(SITE.domain)


@pytest.fixture
def name():
    """No other test's robot is called so."""
    return f"r{uuid4().hex[:8]}"


def raw(reader) -> list[bytes]:
    return [data for data, info in ddspy_take(reader._ref, ANY, 100) if info.valid_data]


def test_a_bare_reader_gets_the_twist_in_rosbags_bytes(station, bare, name):
    topic = Topic(bare, f"rt/{name}/cmd_vel", messages.idl(TWIST))
    reader = DataReader(bare, topic)
    rover = TwistRover(station, UGVSite(name, adapter="dds"))
    until(lambda: reader.get_matched_publications())
    rover.send(0.25, -1.5, now=0.0)
    (data,) = until(lambda: raw(reader))
    store = messages.store2()
    vector, twist = (store.types[f"geometry_msgs/msg/{kind}"] for kind in ("Vector3", "Twist"))
    theirs = twist(linear=vector(x=0.25, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=-1.5))
    assert data == bytes(store.serialize_cdr(theirs, TWIST))


def test_a_stamped_twist_carries_the_time(station, bare, name):
    kind = messages.idl("geometry_msgs/msg/TwistStamped")
    reader = DataReader(bare, Topic(bare, f"rt/base/{name}", kind))
    rover = TwistRover(station, UGVSite(name, topic=f"/base/{name}", stamped=True))
    until(lambda: reader.get_matched_publications())
    before = time.time()
    rover.send(0.5, 0.0, now=0.0)
    (said,) = until(lambda: reader.take(10))
    assert said.twist.linear.x == 0.5
    assert before - 1 <= said.header.stamp.sec <= time.time()


STRANGER = """
import sys
from skydog.lab.domain import Domain
from skydog.lab.site import DDS
domain = Domain(DDS(domain=int(sys.argv[1])))
publisher = domain.publish(sys.argv[2], "geometry_msgs/msg/Twist")
print("here", flush=True)
sys.stdin.read()
domain.close()
"""


def test_another_process_that_commands_is_named_until_it_leaves(station, name):
    rover = TwistRover(station, UGVSite(name))
    assert rover.others() == ()
    arguments = [sys.executable, "-c", STRANGER, str(SITE.domain), f"/{name}/cmd_vel"]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE) as stranger:
        (other,) = until(rover.others)
        assert f"process {stranger.pid} on" in other
        stranger.communicate()
    until(lambda: not rover.others())


def test_who_publishes_elsewhere_is_no_other(station, robots, name):
    rover = TwistRover(station, UGVSite(name))
    robots.publish(f"/{name}/odom_twist", TWIST)
    intruder = robots.publish(f"/{name}/cmd_vel", TWIST)
    until(rover.others)
    intruder.close()
    until(lambda: not rover.others())


def fly(drone: TwistDrone, driver: DDSDrone, told: DroneCommand, shown: Shown, now: float) -> Any:
    drone.send(told, now)
    return driver.step(shown, now)


def test_a_drone_takes_off_flies_and_lands_as_it_is_told(station, robots, name):
    site = UAVSite(name, adapter="twist-dds")
    drone, driver = TwistDrone(station, site), DDSDrone(robots, site)
    until(lambda: drone.status().connected)
    floor = Shown((1.0, 2.0, 0.1), (0.0, 0.0, 0.0), (0.0, 0.0, 0.5), battery=0.75)
    aloft = floor._replace(position=(1.0, 2.0, 1.1))
    clock = iter(range(10**6))

    def told(mode: Mode, shown: Shown, **other) -> Any:
        return fly(drone, driver, command(mode, **other), shown, next(clock) / 10)

    assert told(Mode.READY, floor) is None
    until(lambda: told(Mode.TAKING_OFF, floor) is not None)
    assert told(Mode.TAKING_OFF, floor).velocity == (0.0, 0.0, 0.5)
    until(lambda: told(Mode.TAKING_OFF, aloft) and driver.phase == Phase.FLYING)
    world = (0.3, -0.2, 0.1)  # through the heading frame and back
    until(lambda: told(Mode.MISSION, aloft, yaw=0.5).velocity == pytest.approx(world))
    until(lambda: told(Mode.HOLD, aloft, hover=True).velocity == (0.0, 0.0, 0.0))
    until(lambda: told(Mode.LANDING, aloft).velocity == (0.0, 0.0, -0.5))
    until(lambda: told(Mode.LANDING, floor) is None)
    assert until(lambda: drone.status().battery) == 0.75


def test_a_stopped_drone_does_not_take_off_again(station, robots, name):
    site = UAVSite(name, adapter="twist-dds", stamped=True)
    drone, driver = TwistDrone(station, site), DDSDrone(robots, site)
    until(lambda: drone.status().connected)
    shown = Shown((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), battery=1.0)
    clock = iter(range(10**6))
    until(lambda: fly(drone, driver, command(Mode.TAKING_OFF), shown, float(next(clock))))
    until(lambda: not fly(drone, driver, command(Mode.EMERGENCY), shown, float(next(clock))))
    for _ in range(20):
        assert fly(drone, driver, command(Mode.TAKING_OFF), shown, float(next(clock))) is None


def test_words_are_repeated_every_half_second_and_zero_is_sent_on_the_ground(station, bare, name):
    empty = Topic(bare, f"rt/{name}/takeoff", messages.idl("std_msgs/msg/Empty"))
    words = DataReader(bare, empty, Qos(Policy.Reliability.Reliable(0), Policy.History.KeepAll))
    twists = DataReader(bare, Topic(bare, f"rt/{name}/cmd_vel", messages.idl(TWIST)))
    drone = TwistDrone(station, UAVSite(name, adapter="twist-dds"))
    until(lambda: words.get_matched_publications() and twists.get_matched_publications())
    for tenth in range(11):
        drone.send(command(Mode.TAKING_OFF), tenth / 10)
    until(lambda: len(words.read(100)) >= 3)
    assert len(words.take(100)) == 3
    for mode in (Mode.DISARMED, Mode.READY, Mode.EMERGENCY):
        raw(twists)
        drone.send(command(mode), 2.0)
        (data,) = until(lambda: raw(twists))
        assert not any(data[4:])


def test_a_drone_without_a_battery_message_or_a_listener_says_so(station, name):
    drone = TwistDrone(station, UAVSite(name, adapter="twist-dds"))
    assert drone.status() == Status(connected=False)


@pytest.mark.parametrize("share", [math.nan, -1.0, 87.0])
def test_a_battery_that_is_no_share_is_not_believed(station, robots, name, share):
    drone = TwistDrone(station, UAVSite(name, adapter="twist-dds"))
    battery = robots.publish(f"/{name}/battery_state", "sensor_msgs/msg/BatteryState")
    until(battery.heard)
    battery.send(percentage=0.5)
    until(lambda: drone.status().battery == 0.5)
    battery.send(percentage=share)
    battery.send(percentage=share)
    assert drone.status().battery == 0.5


@pytest.mark.parametrize("latches", [True, False])
def test_a_rover_that_does_not_latch_stops_by_itself(station, robots, name, latches):
    site = UGVSite(name, adapter="dds")
    rover, driver = TwistRover(station, site), DDSRover(robots, site, latches=latches)
    assert driver.step(0.0) == (0.0, 0.0)
    until(lambda: rover.send(0.4, 1.0, 0.0) or driver.step(1.0) == (0.4, 1.0))
    time.sleep(0.05)
    driver.step(1.0)
    assert driver.step(1.5) == (0.4, 1.0)
    assert driver.step(2.0) == ((0.4, 1.0) if latches else (0.0, 0.0))


POSE = ((1.0, -2.0, 3.0), (0.0, 0.0, 0.6, 0.8))


def test_named_poses_come_in(station, robots, name):
    source, tracker = PoseSource(station, f"/{name}"), DDSPoses(robots, f"/{name}")
    assert source.bodies() == {}
    assert not source.wait(time.monotonic() + 0.01)

    def seen():
        tracker.send({"uav": POSE, "ugv1": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))})
        return source.wait(time.monotonic() + 0.1)

    before = time.monotonic()
    until(seen)
    first = source.bodies()
    assert set(first) == {"uav", "ugv1"}
    assert (first["uav"].position, first["uav"].attitude) == POSE
    assert before <= first["uav"].came <= time.monotonic()
    until(seen)
    assert source.bodies()["uav"].number > first["uav"].number
    source.close()
    source.close()


def test_waiting_ends_when_a_pose_comes_from_another_thread(station, robots, name):
    source, tracker = PoseSource(station, f"/{name}"), DDSPoses(robots, f"/{name}")
    until(tracker._poses.heard)
    later = threading.Timer(0.1, tracker.send, [{"uav": POSE}])
    later.start()
    assert source.wait(time.monotonic() + 30)
    later.join()


def test_a_topic_for_each_body_comes_in(station, robots, name):
    source = PoseSource(station, f"/{name}/NAME/pose", ("uav", "ugv1"))
    publisher = robots.publish(f"/{name}/uav/pose", "geometry_msgs/msg/PoseStamped")
    until(publisher.heard)
    publisher.send(
        pose=messages.idl("geometry_msgs/msg/Pose")(
            messages.idl("geometry_msgs/msg/Point")(*POSE[0]),
            messages.idl("geometry_msgs/msg/Quaternion")(*POSE[1]),
        )
    )
    assert source.wait(time.monotonic() + 30)
    ((body, pose),) = source.bodies().items()
    assert (body, pose.position, pose.attitude) == ("uav", *POSE)


def test_what_is_too_much_or_not_finite_is_left_out(station, robots, name):
    source, tracker = PoseSource(station, f"/{name}"), DDSPoses(robots, f"/{name}")
    until(tracker._poses.heard)
    tracker.send({f"b{i}": POSE for i in range(65)})
    time.sleep(0.1)
    tracker.send({f"c{i}": POSE for i in range(2000)})  # above the largest message
    time.sleep(0.1)
    nowhere = ((math.nan, 0.0, 0.0), POSE[1])
    tracker.send({"lost": nowhere, "twisted": (POSE[0], (math.inf, 0.0, 0.0, 0.0)), "uav": POSE})
    assert source.wait(time.monotonic() + 30)
    assert set(source.bodies()) == {"uav"}
    for one in range(100):
        tracker.send({f"d{one}": POSE})
        source.bodies()
    assert len(source.bodies()) <= 64


def test_text_that_is_not_text_is_left_out(station, bare, name):
    kind = messages.idl("motion_capture_tracking_interfaces/msg/NamedPoseArray")
    source = PoseSource(station, f"/{name}")
    writer = DataWriter(bare, Topic(bare, f"rt/{name}", kind))
    until(lambda: writer.get_matched_subscriptions())
    named = messages.idl("motion_capture_tracking_interfaces/msg/NamedPose")
    good = kind(poses=[named(name="uav")]).serialize()
    chance = random.Random(0)
    for _ in range(200):
        bad = bytearray(good)
        for _ in range(3):
            bad[chance.randrange(4, len(bad))] = chance.randrange(256)
        ddspy_write(writer._ref, bytes(bad).ljust(len(bad) + 3 & ~3, b"\0"))
        source.bodies()
    ddspy_write(writer._ref, good.ljust(len(good) + 3 & ~3, b"\0"))
    until(lambda: "uav" in source.bodies())


@pytest.mark.parametrize(
    ("module", "package"),
    [("dds", "cyclonedds"), ("crazyswarm2", "cyclonedds"), ("messages", "rosbags")],
)
def test_a_missing_package_is_refused_with_the_line_that_installs_it(module, package):
    program = f"import sys; sys.modules[{package!r}] = None; import skydog.lab.{module}"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    last = ended.stderr.strip().splitlines()[-1]
    assert last.startswith("skydog.errors.Refusal")
    assert last.endswith(f"{package}; run: pip install 'skydog[lab]'")


def test_an_interface_that_is_not_there_is_refused():
    with pytest.raises(Refusal, match=r"interface 'nosuch0'"):
        Domain(DDS(domain=SITE.domain + 100, interface="nosuch0"))


def test_a_domain_cannot_be_open_on_two_interfaces(station):
    with pytest.raises(Refusal, match="another interface"):
        Domain(DDS(domain=SITE.domain, peers=("127.0.0.2",)))
    assert station.others("/nothing") == ()


def threads() -> int:
    return len(os.listdir("/proc/self/task"))


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="threads are counted on Linux")
def test_the_last_to_leave_ends_the_threads_and_nothing_raises_after_it(name):
    before = threads()
    one, other = Domain(SITE), Domain(SITE)
    rover, drone = TwistRover(one, UGVSite(name)), TwistDrone(other, UAVSite(name, "twist-dds"))
    source = PoseSource(one, f"/{name}")
    assert threads() > before
    one.close()
    one.close()
    rover.send(1.0, 0.0, 0.0)
    assert rover.others() == ()
    assert source.bodies() == {}
    drone.send(command(Mode.TAKING_OFF), 0.0)
    other.close()
    until(lambda: threads() <= before)
    drone.send(command(Mode.EMERGENCY), 0.0)
    assert not drone.status().connected
    drone.close()
    rover.close()
