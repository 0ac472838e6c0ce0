# pyright: reportMissingImports=false
"""The drivers of ROS 1 robots that are not there: real topics on one side, the twin on the other.

Each obeys the topic it is given; where that is the one that a guard publishes, the guard stands
between it and the base station.
"""

import math
import time
from collections import deque
from typing import Any

from skydog.lab import ros1
from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.emulation.drivers import Flown, Shown
from skydog.lab.ros1 import EMERGENCY, FLYING, HOVERING, LANDED, LANDING, Six, bounded
from skydog.lab.ros1_node import Node, publish
from skydog.lab.site import Mocap

# isort: split
import rospy
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from std_msgs.msg import Empty

TAKING_OFF = 6  # Navdata.state, as the others
TIMEOUT = 0.6  # s: after so long without a Twist a Kobuki stops
NEVER = -math.inf


class _ARDroneDriver:
    """The states of an AR.Drone, its buttons and its navdata. The last Twist persists."""

    took_off: float  # m: at this height take-off has ended
    landed: float  # m
    landing_takes: float  # s at most

    def __init__(self, node: Node, topic: str = "/cmd_vel"):
        beside = f"{topic.rpartition('/')[0]}/ardrone"
        self._state = LANDED
        self._twist = Six()
        self._pressed: deque[str] = deque()
        self._landing_since = NEVER
        self._topics = [node.subscribe(topic, Twist, self._hear)]
        for button in ("takeoff", "land", "reset"):
            hear = self._button(button)
            self._topics.append(node.subscribe(f"{beside}/{button}", Empty, hear))
        self._navdata = node.publisher(f"{beside}/navdata", ros1.navdata())

    def step(self, shown: Shown, now: float) -> Flown | None:
        while self._pressed:
            self._press(self._pressed.popleft(), now)
        height = shown.position[2]
        if self._state == TAKING_OFF and height > self.took_off:
            self._state = FLYING
        over = height < self.landed or now - self._landing_since > self.landing_takes
        if self._state == LANDING and over:
            self._state = LANDED
        flown = None if self._state in (LANDED, EMERGENCY) else self._fly(shown)
        self._show(shown)
        return flown

    def close(self) -> None:
        for topic in (*self._topics, self._navdata):
            topic.unregister()

    def _hear(self, message: Any) -> None:
        self._twist = _six(message)

    def _button(self, name: str) -> Any:
        return lambda message: self._pressed.append(name)

    def _press(self, button: str, now: float) -> None:
        if button == "takeoff" and self._state in (LANDED, LANDING):
            self._state = TAKING_OFF
        if button == "land" and self._state in (TAKING_OFF, FLYING, HOVERING):
            self._state, self._landing_since = LANDING, now

    def _fly(self, shown: Shown) -> Flown:
        raise NotImplementedError

    def _show(self, shown: Shown) -> None:
        message = ros1.navdata()()
        message.header.stamp = rospy.Time.now()
        message.header.frame_id = "ardrone_base_link"
        message.state = self._state
        message.batteryPercent = 100.0 * shown.battery
        message.rotX, message.rotY, message.rotZ = map(math.degrees, shown.attitude)
        message.altd = round(1000.0 * shown.position[2])
        x, y = ros1.ahead(*shown.velocity[:2], shown.attitude[2])
        message.vx, message.vy, message.vz = 1000.0 * x, 1000.0 * y, 1000.0 * shown.velocity[2]
        message.az = 1.0  # g
        message.tm = 1e6 * time.monotonic()
        publish(self._navdata, message)


class TumSimulatorDriver(_ARDroneDriver):
    """tum_simulator's AR.Drone: Twists are velocities in m/s, x along its heading.

    `reset` does nothing. Take-off ends at 0.5 m, landing at 0.2 m or after 5 s.
    """

    took_off, landed, landing_takes = 0.5, 0.2, 5.0
    # m/s: where force × 1.5 and × 0.8 come to rest against the climb's PD of gain 5 1/s:
    # 1.5 (g - 5 v) = g, 0.8 (g - 5 v) = g (quadrotor_simple_controller.cpp).
    climbs, sinks = 0.65, -0.49

    def _fly(self, shown: Shown) -> Flown:
        twist, yaw = self._twist, shown.attitude[2]
        x, y = ros1.ahead(bounded(twist.x, ros1.LEVEL), bounded(twist.y, ros1.LEVEL), -yaw)
        push = {TAKING_OFF: self.climbs, LANDING: self.sinks}.get(self._state, 0.0)
        return Flown(velocity=(x, y, bounded(twist.z, ros1.CLIMB) + push))


class ArdroneAutonomyDriver(_ARDroneDriver):
    """ardrone_autonomy and the real AR.Drone 2: Twists are shares of its limits.

    Six zeros, and it hovers by itself. `reset` toggles its emergency, in which its motors are off.
    """

    took_off, landed, landing_takes = 0.8, 0.1, math.inf  # ours
    climbs, sinks = 0.5, -0.3  # m/s; ours

    def _press(self, button: str, now: float) -> None:
        super()._press(button, now)
        if button == "reset":
            self._state = LANDED if self._state == EMERGENCY else EMERGENCY

    def _fly(self, shown: Shown) -> Flown:
        if self._state in (TAKING_OFF, LANDING):
            climb = self.climbs if self._state == TAKING_OFF else self.sinks
            return Flown(velocity=(0.0, 0.0, climb))
        twist = self._twist
        hovers = all(abs(part) < 1e-6 for part in twist)
        self._state = HOVERING if hovers else FLYING
        if hovers:
            return Flown(velocity=(0.0, 0.0, 0.0))
        roll, pitch = -ros1.TILT * bounded(twist.y, 1.0), ros1.TILT * bounded(twist.x, 1.0)
        climb = ros1.FRACTION_CLIMB * bounded(twist.z, 1.0)
        return Flown(velocity=(0.0, 0.0, climb), tilt=(roll, pitch))


class RoverROS1:
    """A rover that obeys Twists: it stops 0.6 s after the last, or never if it latches."""

    def __init__(self, node: Node, topic: str, stamped: bool = False, latches: bool = False):
        self._latches = latches
        self._told: tuple[float, Six] = (NEVER, Six())
        kind = TwistStamped if stamped else Twist
        self._topic = node.subscribe(topic, kind, self._hear)

    def step(self, now: float) -> tuple[float, float]:
        came, twist = self._told
        if now - came > TIMEOUT and not self._latches:
            return 0.0, 0.0
        return twist.x, twist.wz

    def close(self) -> None:
        self._topic.unregister()

    def _hear(self, message: Any) -> None:
        self._told = (time.monotonic(), _six(getattr(message, "twist", message)))


class ViconBridge:
    """vicon_bridge: a topic a body. A body that is not shown is hidden."""

    def __init__(self, node: Node, mocap: Mocap, names: tuple[str, ...]):
        self._topics = {
            name: node.publisher(ros1.vicon_topic(mocap, name), TransformStamped) for name in names
        }

    def show(self, name: str, position: Vector, attitude: Quaternion) -> None:
        """Publish where a body is, in the tracker's frame."""
        message = TransformStamped()
        message.header.stamp = rospy.Time.now()
        message.header.frame_id = "/vicon/world"
        message.child_frame_id = f"vicon/{name}/{name}"
        at, turned = message.transform.translation, message.transform.rotation
        at.x, at.y, at.z = position
        turned.x, turned.y, turned.z, turned.w = attitude
        publish(self._topics[name], message)

    def close(self) -> None:
        """Let go of the topics."""
        for topic in self._topics.values():
            topic.unregister()


def _six(twist: Any) -> Six:
    linear, angular = twist.linear, twist.angular
    return Six(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
