"""The adapters of ROS 2 over DDS: poses in, Twist out."""

import time
from collections.abc import Mapping, Sequence
from math import cos, isfinite, sin
from typing import Any

from skydog.flight.supervisor import Mode
from skydog.lab import messages
from skydog.lab.adapters import Body, DroneCommand, Status, Vector
from skydog.lab.domain import Domain, Subscription, beside, header
from skydog.lab.site import UAVSite, UGVSite

MOST_BODIES = 64  # in a NamedPoseArray, and known in all
REPEAT = 0.5  # s between two words to take off, land or stop


class PoseSource:
    """Poses over DDS; a `skydog.lab.adapters.Source`.

    `topic` carries NamedPoseArray, as motion_capture_tracking sends it. With NAME in it (such as
    /NAME/pose) it stands for a topic of PoseStamped for each of `names`. A frame's number is its
    time stamp in nanoseconds, or is counted where it has none. A pose that is not finite and an
    array of more than 64 poses are left out.
    """

    def __init__(self, domain: Domain, topic: str = "", names: Sequence[str] = ()):
        topic = topic or "/poses"
        self._arrays: list[Subscription] = []
        self._single: dict[str, Subscription] = {}
        if "NAME" in topic:
            kind = "geometry_msgs/msg/PoseStamped"
            self._single = {
                name: domain.subscribe(topic.replace("NAME", name), kind) for name in names
            }
        else:
            kind = "motion_capture_tracking_interfaces/msg/NamedPoseArray"
            self._arrays = [domain.subscribe(topic, kind)]
        self._heard = [*self._arrays, *self._single.values()]
        self._waiting = domain.waiting(self._heard)
        self._bodies: dict[str, Body] = {}
        self._count = 0
        self._news = False

    def wait(self, until: float) -> bool:
        """Wait for bodies until a monotonic time in seconds; False if none came."""
        self._drain()
        while not self._news and (left := until - time.monotonic()) > 0:
            self._waiting.wait(left)
            self._drain()
        return self._news

    def bodies(self) -> Mapping[str, Body]:
        """The latest of every body that was ever seen."""
        self._drain()
        self._news = False
        return dict(self._bodies)

    def close(self) -> None:
        """Stop listening."""
        self._waiting.close()
        for one in self._heard:
            one.close()

    def _drain(self) -> None:
        for subscription in self._arrays:
            for array in subscription.take():
                if len(array.poses) <= MOST_BODIES:
                    number = self._number(array.header.stamp)
                    for one in array.poses:
                        self._see(one.name, one.pose, number)
        for name, subscription in self._single.items():
            for stamped in subscription.take():
                self._see(name, stamped.pose, self._number(stamped.header.stamp))

    def _number(self, stamp: Any) -> int:
        self._count += 1
        return stamp.sec * 1_000_000_000 + stamp.nanosec or self._count

    def _see(self, name: str, pose: Any, number: int) -> None:
        at, turned = pose.position, pose.orientation
        position = (at.x, at.y, at.z)
        attitude = (turned.x, turned.y, turned.z, turned.w)
        known = name in self._bodies or len(self._bodies) < MOST_BODIES
        if known and all(map(isfinite, position + attitude)):
            self._bodies[name] = Body(position, attitude, time.monotonic(), number)
            self._news = True


class TwistDrone:
    """A drone that obeys a Twist in m/s in its heading frame; a `skydog.lab.adapters.Drone`.

    Its commands go to the site's topic, or /NAME/cmd_vel. Beside it are std_msgs/Empty to take off,
    land and stop at once (takeoff, land, emergency), told every half second as long as the mode
    asks for it, and sensor_msgs/BatteryState (battery_state), where the drone sends it.
    """

    def __init__(self, domain: Domain, uav: UAVSite):
        topic = uav.topic or f"/{uav.name}/cmd_vel"
        self._domain, self._stamped = domain, uav.stamped
        self._twist = domain.publish(topic, twist_kind(uav.stamped))
        modes = {Mode.TAKING_OFF: "takeoff", Mode.LANDING: "land", Mode.EMERGENCY: "emergency"}
        self._words = {
            mode: domain.publish(beside(topic, word), "std_msgs/msg/Empty")
            for mode, word in modes.items()
        }
        self._topics = (topic, *(beside(topic, word) for word in modes.values()))
        self._battery = domain.subscribe(
            beside(topic, "battery_state"), "sensor_msgs/msg/BatteryState"
        )
        self._share: float | None = None
        self._told: tuple[Mode, float] | None = None

    def send(self, command: DroneCommand, now: float) -> None:
        """Publish the velocity, and the word that belongs to the mode."""
        still = command.hover or command.mode in (Mode.DISARMED, Mode.READY, Mode.EMERGENCY)
        forward = (0.0, 0.0, 0.0) if still else heading(command.velocity, command.yaw)
        self._twist.send(**_twist(self._stamped, forward, 0.0))
        word = self._words.get(command.mode)
        if word is None:
            self._told = None
        elif self._told is None or self._told[0] != command.mode or now >= self._told[1] + REPEAT:
            word.send()
            self._told = (command.mode, now)

    def status(self) -> Status:
        """The battery, and whether anybody listens to the Twist."""
        battery = self._battery.latest()
        if battery is not None and 0 <= battery.percentage <= 1:
            self._share = battery.percentage
        return Status(battery=self._share, connected=self._twist.heard())

    def others(self) -> tuple[str, ...]:
        """Who else publishes on a topic of its commands."""
        return self._domain.others(*self._topics)

    def close(self) -> None:
        """Stop publishing."""
        for one in (self._twist, self._battery, *self._words.values()):
            one.close()


class TwistRover:
    """A rover that obeys a Twist; a `skydog.lab.adapters.Rover`.

    On the site's topic, or /NAME/cmd_vel; `stamped` is what ros2_control's drives ask for.
    """

    def __init__(self, domain: Domain, ugv: UGVSite):
        self._topic = ugv.topic or f"/{ugv.name}/cmd_vel"
        self._domain, self._stamped = domain, ugv.stamped
        self._twist = domain.publish(self._topic, twist_kind(ugv.stamped))

    def send(self, speed: float, turn_rate: float, now: float) -> None:
        """Publish a forward speed in m/s and a turn rate in rad/s."""
        self._twist.send(**_twist(self._stamped, (speed, 0.0, 0.0), turn_rate))

    def others(self) -> tuple[str, ...]:
        """Who else publishes on its topic."""
        return self._domain.others(self._topic)

    def close(self) -> None:
        """Stop publishing."""
        self._twist.close()


def heading(velocity: Vector, yaw: float) -> Vector:
    """A velocity of the world's frame in the frame of who heads `yaw` radians from its x axis."""
    x, y, z = velocity
    return (cos(yaw) * x + sin(yaw) * y, cos(yaw) * y - sin(yaw) * x, z)


def twist_kind(stamped: bool) -> str:
    """The message that a robot's velocity goes by."""
    return "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"


def _twist(stamped: bool, velocity: Vector, turn_rate: float) -> dict[str, Any]:
    vector = messages.idl("geometry_msgs/msg/Vector3")
    fields = {"linear": vector(*velocity), "angular": vector(0.0, 0.0, turn_rate)}
    if not stamped:
        return fields
    return {"header": header(), "twist": messages.idl("geometry_msgs/msg/Twist")(**fields)}
