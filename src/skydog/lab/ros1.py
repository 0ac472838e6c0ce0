# pyright: reportMissingImports=false
"""ROS 1: robots, and a tracker, behind the topics of our node."""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from skydog.flight.supervisor import Mode
from skydog.lab.adapters import Body, DroneCommand, Status
from skydog.lab.ros1_node import Node, publish
from skydog.lab.site import Mocap, UAVSite, UGVSite

# isort: split
import genpy.dynamic
import rospy
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped, Vector3
from std_msgs.msg import Empty

AGAIN = 0.5  # s between two presses of a button that has not worked yet
FRESH = 1.0  # s: a drone whose navdata are older has lost its connection

EMERGENCY, LANDED, FLYING, HOVERING, TO_FIX_POINT, LANDING = 0, 2, 3, 4, 7, 8  # Navdata.state
FLIES = (FLYING, HOVERING, TO_FIX_POINT)

LEVEL, CLIMB, TURN = 2.0, 0.5, 1.5  # m/s, m/s, rad/s: the limits of tum_simulator's PIDs
TILT, FRACTION_CLIMB, FRACTION_TURN = 0.21, 0.7, 1.75  # rad, m/s, rad/s: ardrone.launch's limits
YAW_GAIN = 1.0  # 1/s, of the loop that holds yaw at 0; ours
LANDS_ITSELF = 0.6  # m: a lower drone is told to land, a higher one sinks as it is steered; ours
NO_HOVER = 1.0  # in angular.x it keeps ardrone_autonomy from hovering by itself


class Six(NamedTuple):
    """A Twist: linear x, y, z and angular x, y, z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    wx: float = 0.0
    wy: float = 0.0
    wz: float = 0.0


STILL = Six()


class _Button:
    """An Empty on a topic, said again every half second while it is pressed."""

    def __init__(self, node: Node, topic: str):
        self.topic = topic
        self.publisher = node.publisher(topic, Empty)
        self._pressed = -math.inf

    def press(self, now: float) -> None:
        if now - self._pressed >= AGAIN:
            self._pressed = now
            publish(self.publisher, Empty())


class _ARDrone:
    """What tum_simulator and ardrone_autonomy share: take-off, landing and navdata.

    The topic is that of Twists, /cmd_vel if not given; the others are found beside it, in
    ardrone/: /ardrone/takeoff, or /ardrone1/ardrone/takeoff beside /ardrone1/cmd_vel. Who may only
    land it or stop its motors does no harm, and is not one of the `others`.
    """

    def __init__(self, node: Node, uav: UAVSite):
        self._node = node
        self._topic = uav.topic or "/cmd_vel"
        self._beside = f"{self._topic.rpartition('/')[0]}/ardrone"
        self._twist = node.publisher(self._topic, Twist)
        self._take_off = _Button(node, f"{self._beside}/takeoff")
        self._land = _Button(node, f"{self._beside}/land")
        self._state: int | None = None  # of navdata; None before the first
        self._battery: float | None = None
        self._came = -math.inf  # s
        self._navdata = node.subscribe(f"{self._beside}/navdata", navdata(), self._hear)

    def send(self, command: DroneCommand, now: float) -> None:
        state = self._state
        # Neither in an emergency: a real drone keeps the wish, and takes off when it is reset.
        if command.mode is Mode.TAKING_OFF and state and state not in FLIES:
            self._take_off.press(now)
        lands = command.mode is Mode.LANDING and not steered(command)
        if (lands or command.mode is Mode.EMERGENCY) and state != LANDED:
            self._land.press(now)
        publish(self._twist, _twist(self._six(command, state)))

    def status(self) -> Status:
        state = self._state
        return Status(
            battery=self._battery,
            flying=None if state is None else state in (*FLIES, LANDING),
            emergency=state == EMERGENCY,
            connected=time.monotonic() - self._came < FRESH,
        )

    def others(self) -> tuple[str, ...]:
        return self._node.others(self._topic, self._take_off.topic)

    def close(self) -> None:
        for topic in (self._navdata, self._twist, self._take_off.publisher, self._land.publisher):
            topic.unregister()

    def _six(self, command: DroneCommand, state: int | None) -> Six:
        raise NotImplementedError

    def _hear(self, message: Any) -> None:
        self._state = message.state
        percent = message.batteryPercent
        self._battery = min(max(percent / 100, 0.0), 1.0) if math.isfinite(percent) else None
        self._came = time.monotonic()


class TumSimulator(_ARDrone):
    """The AR.Drone of tum_simulator: Twists are velocities in m/s, x along its heading."""

    def _six(self, command: DroneCommand, state: int | None) -> Six:
        return simulator_twist(command, state)


class ArdroneAutonomy(_ARDrone):
    """The real AR.Drone 2 by ardrone_autonomy: Twists are shares of its limits."""

    def __init__(self, node: Node, uav: UAVSite):
        super().__init__(node, uav)
        self._reset = node.publisher(f"{self._beside}/reset", Empty)
        self._mode = Mode.DISARMED

    def send(self, command: DroneCommand, now: float) -> None:
        super().send(command, now)
        # It toggles: said twice, it would end the emergency. It must have been a human's wish.
        entered = command.mode is Mode.EMERGENCY and self._mode is not Mode.EMERGENCY
        self._mode = command.mode
        if entered and self._state != EMERGENCY:
            publish(self._reset, Empty())

    def close(self) -> None:
        super().close()
        self._reset.unregister()

    def _six(self, command: DroneCommand, state: int | None) -> Six:
        return driver_twist(command, state)


class TwistRover:
    """A rover that obeys Twists, on /NAME/cmd_vel if no topic is given."""

    def __init__(self, node: Node, ugv: UGVSite):
        self._node = node
        self._topic = ugv.topic or f"/{ugv.name}/cmd_vel"
        self._stamped = ugv.stamped
        self._twist = node.publisher(self._topic, TwistStamped if ugv.stamped else Twist)

    def send(self, speed: float, turn_rate: float, now: float) -> None:
        twist: Any = _twist(Six(x=bounded(speed, math.inf), wz=bounded(turn_rate, math.inf)))
        if self._stamped:
            twist = TwistStamped(twist=twist)
            twist.header.stamp = rospy.Time.now()
        publish(self._twist, twist)

    def others(self) -> tuple[str, ...]:
        return self._node.others(self._topic)

    def close(self) -> None:
        self._twist.unregister()


class ViconSource:
    """The poses that vicon_bridge publishes, a topic a body. A hidden body is not published."""

    def __init__(self, node: Node, mocap: Mocap, names: Sequence[str]):
        """The topic of the site is a pattern such as vicon/{name}/{name}, the usual one."""
        self._bodies: dict[str, Body] = {}
        self._news = threading.Condition()
        self._new = False
        self._subscribers = []
        for name in names:
            topic = vicon_topic(mocap, name)
            self._subscribers.append(node.subscribe(topic, TransformStamped, self._hear(name)))

    def wait(self, until: float) -> bool:
        with self._news:
            return self._news.wait_for(lambda: self._new, max(0.0, until - time.monotonic()))

    def bodies(self) -> Mapping[str, Body]:
        with self._news:
            self._new = False
            return dict(self._bodies)

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _hear(self, name: str) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            came = time.monotonic()
            at, turned = message.transform.translation, message.transform.rotation
            position = (at.x, at.y, at.z)
            attitude = (turned.x, turned.y, turned.z, turned.w)
            # All zeros, or no numbers at all, is what some trackers send of a body out of sight.
            if not (all(map(math.isfinite, position)) and 0.9 < math.hypot(*attitude) < 1.1):
                return
            with self._news:
                before = self._bodies[name].number if name in self._bodies else -1
                number = max(message.header.seq, before + 1)  # a bridge that restarts counts anew
                self._bodies[name] = Body(position, attitude, came, number)
                self._new = True
                self._news.notify_all()

        return hear


def vicon_topic(mocap: Mocap, name: str) -> str:
    """The topic of a body."""
    return (mocap.topic or "vicon/NAME/NAME").replace("NAME", name)


@cache
def navdata() -> type[Any]:
    """The class of ardrone_autonomy/Navdata, which no package of Debian has."""
    from skydog.lab.messages import text1

    name = "ardrone_autonomy/Navdata"
    return genpy.dynamic.generate_dynamic(name, text1(name))[name]


def simulator_twist(command: DroneCommand, state: int | None) -> Six:
    """Velocity in m/s along and across its heading, climb in m/s, and what holds its yaw at 0.

    Its own landing has a speed of its own, and obeys the rest.
    """
    lands = command.mode is Mode.LANDING and not steered(command)
    if command.hover or not _obeys(command.mode) or state not in (*FLIES, LANDING):
        return STILL
    x, y = ahead(*command.velocity[:2], command.yaw)
    z = 0.0 if lands else command.velocity[2]
    turn = bounded(-YAW_GAIN * command.yaw, TURN)
    return Six(bounded(x, LEVEL), bounded(y, LEVEL), bounded(z, CLIMB), wz=turn)


def driver_twist(command: DroneCommand, state: int | None) -> Six:
    """Tilt forward and to the left, climb and turn, each as a share of its limit.

    All zeros, it hovers by its own sensors: when it is to, and while it lands by itself.
    """
    stands = command.hover or (command.mode is Mode.LANDING and not steered(command))
    if stands or not _obeys(command.mode) or state not in FLIES:
        return STILL
    roll, pitch = command.tilt
    x, y = ahead(pitch, -roll, command.yaw)
    climb = bounded(command.velocity[2] / FRACTION_CLIMB, 1.0)
    turn = bounded(-YAW_GAIN * command.yaw / FRACTION_TURN, 1.0)
    return Six(bounded(x / TILT, 1.0), bounded(y / TILT, 1.0), climb, NO_HOVER, 0.0, turn)


def steered(command: DroneCommand) -> bool:
    """Whether a landing drone is steered, seen and high as it is: left to itself it drifts."""
    return not command.hover and command.position[2] > LANDS_ITSELF


def bounded(value: float, most: float) -> float:
    """The value, at most so large; nothing at all if it is no number."""
    return max(-most, min(value, most)) if math.isfinite(value) else 0.0


def _obeys(mode: Mode) -> bool:
    return mode in (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD, Mode.LANDING)


def ahead(x: float, y: float, yaw: float) -> tuple[float, float]:
    """A vector of the world's plane, forward and to the left of a heading."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return cos * x + sin * y, cos * y - sin * x


def _twist(six: Six) -> Twist:
    return Twist(Vector3(*six[:3]), Vector3(*six[3:]))
