# pyright: reportMissingImports=false
import math
import threading
import time
from typing import Any

import pytest
import ros
from hypothesis import given
from hypothesis import strategies as st

from skydog.flight.supervisor import Mode
from skydog.lab.adapters import DroneCommand
from skydog.lab.emulation.drivers import Shown
from skydog.lab.emulation.master import Master
from skydog.lab.site import Mocap, UAVSite, UGVSite

UAV = UAVSite("drone", "tum-simulator")


@pytest.fixture(scope="module")
def master():
    it = Master()
    yield it.uri
    it.close()


def command(mode, hover=False, velocity=(0.0, 0.0, 0.0), tilt=(0.0, 0.0), yaw=0.0, z=0.0):
    return DroneCommand(mode, hover, velocity, tilt, (0.0, 0.0, 0.0), (0.0, 0.0, z), yaw)


# What a command is on each cmd_vel: the simulator's velocity, the real drone's share of its limits.
EAST = {"velocity": (1.0, 0.5, 0.35), "tilt": (-0.105, 0.21)}
TABLE = [
    # mode, command, navdata.state, of the simulator, of the driver
    (Mode.MISSION, EAST, 3, (1, 0.5, 0.35, 0, 0, 0), (1, 0.5, 0.5, 1, 0, 0)),
    (Mode.HOLD, EAST, 3, (1, 0.5, 0.35, 0, 0, 0), (1, 0.5, 0.5, 1, 0, 0)),
    (Mode.MISSION, {}, 3, (0, 0, 0, 0, 0, 0), (0, 0, 0, 1, 0, 0)),  # not the same as to hover
    (Mode.HOLD, {**EAST, "hover": True}, 3, (0,) * 6, (0,) * 6),
    (Mode.MISSION, {**EAST, "yaw": math.pi / 2}, 7, (0.5, -1, 0.35, 0, 0, -1.5), None),
    (Mode.MISSION, {**EAST, "yaw": 0.35}, 3, None, (1, 0.1268, 0.5, 1, 0, -0.2)),
    (Mode.MISSION, {"velocity": (9.0, -9.0, 9.0), "tilt": (1.0, -1.0)}, 4, (2, -2, 0.5, 0, 0, 0),
     (-1, -1, 1, 1, 0, 0)),
    (Mode.TAKING_OFF, EAST, 6, (0,) * 6, (0,) * 6),
    (Mode.TAKING_OFF, EAST, 3, (1, 0.5, 0.35, 0, 0, 0), (1, 0.5, 0.5, 1, 0, 0)),
    (Mode.LANDING, EAST, 8, (1, 0.5, 0, 0, 0, 0), (0,) * 6),
    (Mode.LANDING, EAST, 3, (1, 0.5, 0, 0, 0, 0), (0,) * 6),
    (Mode.LANDING, {**EAST, "z": 1.9}, 3, (1, 0.5, 0.35, 0, 0, 0), (1, 0.5, 0.5, 1, 0, 0)),
    (Mode.LANDING, {**EAST, "z": 1.9, "hover": True}, 3, (0,) * 6, (0,) * 6),
    (Mode.MISSION, EAST, 2, (0,) * 6, (0,) * 6),  # it stands
    (Mode.MISSION, EAST, None, (0,) * 6, (0,) * 6),  # nobody knows
    (Mode.READY, EAST, 3, (0,) * 6, (0,) * 6),
    (Mode.EMERGENCY, EAST, 3, (0,) * 6, (0,) * 6),
]  # fmt: skip


@pytest.mark.parametrize(("mode", "told", "state", "simulator", "driver"), TABLE)
def test_a_command_is_a_velocity_for_the_simulator_and_a_share_of_tilt_for_the_real_drone(
    mode, told, state, simulator, driver
):
    from skydog.lab.ros1 import driver_twist, simulator_twist

    it = command(mode, **told)
    if simulator is not None:
        assert simulator_twist(it, state) == pytest.approx(simulator)
    if driver is not None:
        assert driver_twist(it, state) == pytest.approx(driver, abs=1e-4)


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.sampled_from(Mode),
    st.booleans(),
    st.tuples(anything, anything, anything),
    st.tuples(anything, anything),
    st.floats(-4.0, 4.0),
    st.none() | st.integers(0, 9),
)
def test_no_twist_is_beyond_what_the_robot_takes(mode, hover, velocity, tilt, yaw, state):
    from skydog.lab.ros1 import driver_twist, simulator_twist

    it = command(mode, hover, velocity, tilt, yaw)
    for twist, limits in (
        (simulator_twist(it, state), (2.0, 2.0, 0.5, 0.0, 0.0, 1.5)),
        (driver_twist(it, state), (1.0,) * 6),
    ):
        assert all(abs(part) <= most for part, most in zip(twist, limits, strict=True))


def says(node):
    """A driver that says what it is told to, and waits until that has been heard."""
    from skydog.lab import ros1

    publisher = node.publisher("/ardrone/navdata", ros1.navdata())

    def say(drone, state):
        message = ros1.navdata()(state=state, batteryPercent=80.0)

        def heard():
            publisher.publish(message)
            return drone._state == state

        ros.until(heard)

    return say


def hears(node, *buttons):
    """How often each of the drone's buttons was pressed."""
    from std_msgs.msg import Empty

    pressed = {button: [] for button in buttons}
    for button, presses in pressed.items():
        node.subscribe(f"/ardrone/{button}", Empty, presses.append)
    ros.until(lambda: all(_connected(f"/ardrone/{button}") for button in buttons))
    return pressed


def _connected(topic):
    from rospy.impl.registration import get_topic_manager

    topics: Any = get_topic_manager()
    publisher = topics.get_publisher_impl(topic)
    return publisher is not None and publisher.has_connections()


@ros.alone
def test_a_drone_that_is_seen_is_steered_down_and_told_to_land_near_the_floor(master):
    from skydog.lab.ros1 import ArdroneAutonomy, Node

    node = Node(ros.at(master))
    drone = ArdroneAutonomy(node, UAV)
    pressed = hears(node, "land")
    says(node)(drone, 3)
    for now, z in enumerate((2.0, 1.0, 0.7)):
        drone.send(command(Mode.LANDING, z=z), float(now))
    assert not pressed["land"]
    drone.send(command(Mode.LANDING, z=0.5), 3.0)
    ros.until(lambda: len(pressed["land"]) == 1)
    drone.send(command(Mode.LANDING, z=2.0, hover=True), 4.0)
    ros.until(lambda: len(pressed["land"]) == 2)
    node.close()


@ros.alone
def test_take_off_is_told_again_until_it_flies_and_landing_until_it_has_landed(master):
    from skydog.lab.ros1 import Node, TumSimulator

    node = Node(ros.at(master))
    drone = TumSimulator(node, UAV)
    pressed = hears(node, "takeoff", "land")
    say = says(node)
    up, down = command(Mode.TAKING_OFF), command(Mode.LANDING)
    times = {"takeoff": [], "land": []}

    def tell(order, button, now, comes):
        before = len(pressed[button])
        drone.send(order, now)
        if comes:
            ros.until(lambda: len(pressed[button]) > before)
            times[button].append(now)

    drone.send(up, 0.0)  # before a word of navdata: not told
    say(drone, 2)
    assert drone.status().flying is False
    for now, comes in ((1.0, True), (1.3, False), (1.5, True), (2.0, True)):
        tell(up, "takeoff", now, comes)
    say(drone, 3)
    assert drone.status().flying
    assert drone.status().battery == pytest.approx(0.8)
    tell(up, "takeoff", 5.0, False)
    for now, comes in ((6.0, True), (6.1, False)):
        tell(down, "land", now, comes)
    say(drone, 8)
    assert drone.status().flying  # it is in the air still
    tell(down, "land", 7.0, True)
    say(drone, 2)
    tell(down, "land", 8.0, False)
    tell(up, "takeoff", 9.0, True)
    say(drone, 3)
    tell(down, "land", 10.0, True)
    say(drone, 0)
    tell(up, "takeoff", 20.0, False)  # a drone in an emergency would take off when it is reset
    say(drone, 2)
    tell(up, "takeoff", 30.0, True)
    assert {button: len(presses) for button, presses in pressed.items()} == {
        button: len(presses) for button, presses in times.items()
    }
    node.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "ROS 1 master"]


@ros.alone
def test_reset_toggles_and_is_sent_once_and_by_a_humans_emergency_alone(master):
    from skydog.lab.ros1 import ArdroneAutonomy, Node

    node = Node(ros.at(master))
    drone = ArdroneAutonomy(node, UAV)
    pressed = hears(node, "reset", "land")
    say = says(node)
    say(drone, 3)
    now = 0.0
    for mode in (mode for mode in Mode if mode is not Mode.EMERGENCY):
        for hover in (False, True):
            now += 1.0
            drone.send(command(mode, hover=hover), now)
    for expected in (1, 2):
        for _ in range(3):  # the emergency goes on
            now += 1.0
            drone.send(command(Mode.EMERGENCY), now)
        ros.until(lambda expected=expected: len(pressed["reset"]) == expected)
        drone.send(command(Mode.DISARMED), now)
    landed = len(pressed["land"])
    say(drone, 0)
    assert drone.status().emergency
    drone.send(command(Mode.EMERGENCY), now + 1.0)  # it is in one: reset would end it
    ros.until(lambda: len(pressed["land"]) > landed)
    assert len(pressed["reset"]) == 2
    node.close()


@pytest.mark.parametrize("kind", ["tum-simulator", "ardrone-autonomy"])
@ros.alone
def test_an_emulated_drone_takes_off_climbs_and_lands(master, kind):
    from skydog.lab.emulation.ros1 import ArdroneAutonomyDriver, TumSimulatorDriver
    from skydog.lab.ros1 import ArdroneAutonomy, Node, TumSimulator

    simulated = kind == "tum-simulator"
    node = Node(ros.at(master))
    drone = TumSimulator(node, UAV) if simulated else ArdroneAutonomy(node, UAV)
    driver = TumSimulatorDriver(node) if simulated else ArdroneAutonomyDriver(node)
    height, now = 0.0, 0.0
    flown: Any = None

    def pass_by(order, dt=0.1):
        nonlocal height, now, flown
        now += dt
        shown = Shown((0.0, 0.0, height), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), battery=0.5)
        flown = driver.step(shown, now)
        climb = -1.0 if flown is None else flown.velocity[2]
        height = max(0.0, height + climb * dt)
        drone.send(order, now)

    def fly(order, until):
        def step():
            pass_by(order)
            return until()

        ros.until(step)

    fly(command(Mode.READY), lambda: drone.status().connected)
    assert flown is None
    fly(command(Mode.TAKING_OFF), lambda: drone.status().flying)
    assert 0.4 < height < 2.0
    climbs = command(Mode.MISSION, velocity=(0.3, 0.0, 0.4), tilt=(0.0, 0.1))
    fly(climbs, lambda: height > 2.0)
    assert flown is not None
    if simulated:
        assert flown.velocity == pytest.approx((0.3, 0.0, 0.4))
        assert flown.tilt is None
    else:
        assert flown.tilt == pytest.approx((0.0, 0.1))
    fly(command(Mode.HOLD, hover=True), lambda: flown.velocity == (0.0, 0.0, 0.0))
    assert flown.tilt is None
    fly(command(Mode.LANDING), lambda: drone.status().flying is False)
    assert flown is None
    assert height < 0.25
    assert drone.status().battery == pytest.approx(0.5)
    driver.close()
    drone.close()
    drone.send(climbs, now)  # closed: nobody is told, and nothing is raised
    node.close()


@ros.alone
def test_an_emulated_real_drone_in_an_emergency_has_its_motors_off(master):
    from std_msgs.msg import Empty

    from skydog.lab.emulation.ros1 import ArdroneAutonomyDriver
    from skydog.lab.ros1 import Node

    node = Node(ros.at(master), "room")
    driver = ArdroneAutonomyDriver(node)
    up = Shown((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), battery=1.0)
    buttons = {name: node.publisher(f"/ardrone/{name}", Empty) for name in ("takeoff", "reset")}
    ros.until(lambda: all(_connected(f"/ardrone/{name}") for name in buttons))
    buttons["takeoff"].publish(Empty())
    ros.until(lambda: driver.step(up, 0.0) is not None)
    buttons["reset"].publish(Empty())
    ros.until(lambda: driver.step(up, 0.0) is None)
    buttons["takeoff"].publish(Empty())
    node.close()
    assert driver.step(up, 0.0) is None


@pytest.mark.parametrize("stamped", [False, True])
@ros.alone
def test_a_rover_stops_when_nothing_comes_unless_it_latches(master, stamped):
    from skydog.lab.emulation.ros1 import RoverROS1
    from skydog.lab.ros1 import Node, TwistRover

    node = Node(ros.at(master))
    rover = TwistRover(node, UGVSite("ugv1", stamped=stamped))
    stops = RoverROS1(node, "/ugv1/cmd_vel", stamped=stamped)
    latches = RoverROS1(node, "/ugv1/cmd_vel", stamped=stamped, latches=True)

    def driven():
        rover.send(0.3, -0.7, 0.0)
        return stops.step(0.0) == latches.step(0.0) == (0.3, -0.7)

    ros.until(driven)
    later = time.monotonic() + 10.0
    assert stops.step(later) == (0.0, 0.0)
    assert latches.step(later) == (0.3, -0.7)
    rover.send(math.nan, math.inf, 0.0)
    ros.until(lambda: latches.step(0.0) == (0.0, 0.0))
    rover.close()
    rover.send(0.3, -0.7, 0.0)
    node.close()


@ros.alone
def test_poses_come_by_body_and_what_is_no_pose_is_left_out(master):
    from skydog.lab.emulation.ros1 import ViconBridge
    from skydog.lab.ros1 import Node, ViconSource

    node, names, mocap = Node(ros.at(master)), ("drone", "ugv1"), Mocap(source="ros1")
    source, bridge = ViconSource(node, mocap, names), ViconBridge(node, mocap, names)
    level = (0.0, 0.0, 0.0, 1.0)
    assert not source.wait(time.monotonic())

    def shown(name, position, attitude=level):
        def seen():
            bridge.show(name, position, attitude)
            source.wait(time.monotonic() + 0.05)
            bodies = source.bodies()
            return name in bodies and bodies[name].position == position

        ros.until(seen)
        return source.bodies()[name]

    first = shown("drone", (1.0, 2.0, 3.0))
    assert first.attitude == level
    assert "ugv1" not in source.bodies()  # hidden so far
    shown("ugv1", (4.0, 5.0, 0.0))
    bridge.show("drone", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    bridge.show("drone", (math.nan, 0.0, 0.0), level)
    again = shown("drone", (1.0, 2.0, 3.5))
    bridge.close()
    bridge = ViconBridge(node, mocap, names)  # restarted: it counts from 0
    last = shown("drone", (1.0, 2.0, 4.0))
    assert first.number < again.number < last.number
    assert first.came < again.came < last.came
    assert set(source.bodies()) == set(names)
    source.close()
    node.close()
