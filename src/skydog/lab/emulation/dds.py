"""Emulated robots on the other end of DDS: what a ROS 2 drone, rover and tracker would do."""

from collections.abc import Mapping
from enum import Enum, auto
from math import cos, hypot, sin
from typing import Any

from skydog.lab import messages
from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.crazyswarm2 import COMMANDS, EMPTY, FLYING, FULL, LOCKED, EmptyRequest, emergency
from skydog.lab.dds import twist_kind
from skydog.lab.domain import Domain, beside, header
from skydog.lab.emulation.drivers import Flown, Shown
from skydog.lab.site import UAVSite, UGVSite

CLIMB = SINK = 0.5  # m/s
TOP = 1.0  # m above the floor: where a take-off ends
FLOOR = 0.05  # m above where it stood: landed
STALE = 0.6  # s: how long a rover that does not latch obeys a Twist; Kobuki's base
TELL = 0.1  # s between two words of status
LEVEL, SHUT = 0.5, 2.0  # s without a set-point: level, motors off; Crazyflie's commander
STIFFNESS, FASTEST = 1.5, 1.0  # 1/s and m/s of a Crazyflie's position loop; ours
POSITION = "crazyflie_interfaces/msg/Position"
STILL = Flown((0.0, 0.0, 0.0))


class Phase(Enum):
    """What an emulated drone does."""

    LANDED = auto()
    TAKING_OFF = auto()
    FLYING = auto()
    LANDING = auto()
    STOPPED = auto()  # for ever


class DDSDrone:
    """A drone that obeys Twist; a `skydog.lab.emulation.drivers.DroneDriver`.

    It climbs to 1 m when told to take off, obeys in flight, and sinks when told to land. A Twist is
    kept until the next one comes, as an AR.Drone's driver keeps it.
    """

    def __init__(self, domain: Domain, uav: UAVSite):
        topic = uav.topic or f"/{uav.name}/cmd_vel"
        self._stamped = uav.stamped
        self._twist = domain.subscribe(topic, twist_kind(uav.stamped), reliable=True)
        self._words = {
            word: domain.subscribe(beside(topic, word), "std_msgs/msg/Empty", reliable=True)
            for word in ("takeoff", "land", "emergency")
        }
        self._battery = domain.publish(
            beside(topic, "battery_state"), "sensor_msgs/msg/BatteryState"
        )
        self.phase = Phase.LANDED
        self._kept: Any = messages.idl("geometry_msgs/msg/Twist")()
        self._floor = 0.0
        self._told = float("-inf")

    def step(self, shown: Shown, now: float) -> Flown | None:
        """Hear, change what is done, and fly it."""
        twist = self._twist.latest()
        if twist is not None:
            self._kept = twist.twist if self._stamped else twist
        said = {word for word, heard in self._words.items() if heard.latest() is not None}
        self.phase = self._next(said, shown.position[2])
        if self.phase == Phase.LANDED:
            self._floor = shown.position[2]
        if now >= self._told + TELL:
            self._told = now
            self._battery.send(header=header(), percentage=shown.battery, present=True)
        return self._flown(shown)

    def close(self) -> None:
        """Stop listening."""
        for one in (self._twist, self._battery, *self._words.values()):
            one.close()

    def _next(self, said: set[str], height: float) -> Phase:
        if "emergency" in said or self.phase == Phase.STOPPED:
            return Phase.STOPPED
        if self.phase in (Phase.TAKING_OFF, Phase.FLYING) and "land" in said:
            return Phase.LANDING
        if self.phase == Phase.LANDED and "takeoff" in said:
            return Phase.TAKING_OFF
        if self.phase == Phase.TAKING_OFF and height >= self._floor + TOP:
            return Phase.FLYING
        if self.phase == Phase.LANDING and height <= self._floor + FLOOR:
            return Phase.LANDED
        return self.phase

    def _flown(self, shown: Shown) -> Flown | None:
        if self.phase in (Phase.LANDED, Phase.STOPPED):
            return None
        if self.phase == Phase.TAKING_OFF:
            return Flown((0.0, 0.0, CLIMB))
        if self.phase == Phase.LANDING:
            return Flown((0.0, 0.0, -SINK))
        x, y, yaw = self._kept.linear.x, self._kept.linear.y, shown.attitude[2]
        return Flown(
            (cos(yaw) * x - sin(yaw) * y, sin(yaw) * x + cos(yaw) * y, self._kept.linear.z)
        )


class DDSRover:
    """A rover that obeys Twist; a `skydog.lab.emulation.drivers.RoverDriver`.

    One that `latches` keeps the last Twist for ever; any other stops 0.6 s after it.
    """

    def __init__(self, domain: Domain, ugv: UGVSite, latches: bool = False):
        topic = ugv.topic or f"/{ugv.name}/cmd_vel"
        self._stamped, self._latches = ugv.stamped, latches
        self._twist = domain.subscribe(topic, twist_kind(ugv.stamped), reliable=True)
        self._kept, self._came = (0.0, 0.0), float("-inf")

    def step(self, now: float) -> tuple[float, float]:
        """Hear, and drive it."""
        twist = self._twist.latest()
        if twist is not None:
            twist = twist.twist if self._stamped else twist
            self._kept, self._came = (twist.linear.x, twist.angular.z), now
        return self._kept if self._latches or now < self._came + STALE else (0.0, 0.0)

    def close(self) -> None:
        """Stop listening."""
        self._twist.close()


class DDSCrazyswarm2:
    """Crazyswarm2's server with one Crazyflie; a `skydog.lab.emulation.drivers.DroneDriver`.

    The latest set-point counts, whatever its topic. Without one it levels out after 0.5 s and stops
    its motors after 2 s. An emergency request with rmw_cyclonedds's header stops it for ever.
    """

    def __init__(self, domain: Domain, uav: UAVSite):
        space = uav.topic or f"/{uav.name}"
        self._commands = {
            name: domain.subscribe(f"{space}/{name}", kind, reliable=True)
            for name, kind in {**COMMANDS, "cmd_position": POSITION}.items()
        }
        self._emergency = domain.read(emergency(space), EmptyRequest, reliable=True)
        self._status = domain.publish(f"{space}/status", "crazyflie_interfaces/msg/Status")
        self._obeyed: tuple[str, Any] | None = None
        self._came = self._told = float("-inf")
        self.locked = False

    def step(self, shown: Shown, now: float) -> Flown | None:
        """Hear, fly the latest set-point, and tell the status."""
        came = [
            (message.sample_info.source_timestamp, name, message)
            for name, heard in self._commands.items()
            for message in heard.take()
        ]
        if came:
            _, *obeyed = max(came, key=lambda one: one[0])
            self._obeyed, self._came = (obeyed[0], obeyed[1]), now
        self.locked |= self._emergency.latest() is not None
        flown = None if self.locked or now > self._came + SHUT else self._flown(shown, now)
        if now >= self._told + TELL:
            self._told = now
            self._status.send(
                header=header(),
                supervisor_info=LOCKED * self.locked | FLYING * (flown is not None),
                battery_voltage=EMPTY + shown.battery * (FULL - EMPTY),
            )
        return flown

    def close(self) -> None:
        """Stop listening."""
        for one in (self._status, self._emergency, *self._commands.values()):
            one.close()

    def _flown(self, shown: Shown, now: float) -> Flown | None:
        if self._obeyed is None:
            return None
        name, told = self._obeyed
        if name == "cmd_vel_legacy":
            return None  # thrust 0: the station sends no other
        if now > self._came + LEVEL:
            return STILL
        if name == "cmd_velocity_world":
            return Flown((told.vel.x, told.vel.y, told.vel.z))
        goal = told.pose.position if name == "cmd_full_state" else told
        return Flown(_towards(shown.position, (goal.x, goal.y, goal.z)))


class DDSPoses:
    """A tracker that sends NamedPoseArray, as motion_capture_tracking does."""

    def __init__(self, domain: Domain, topic: str = "/poses"):
        self._poses = domain.publish(topic, "motion_capture_tracking_interfaces/msg/NamedPoseArray")

    def send(self, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> None:
        """Publish a frame: positions in metres and attitudes by name."""
        named = messages.idl("motion_capture_tracking_interfaces/msg/NamedPose")
        pose, point, turned = (
            messages.idl(f"geometry_msgs/msg/{name}") for name in ("Pose", "Point", "Quaternion")
        )
        poses = [
            named(name, pose(point(*position), turned(*attitude)))
            for name, (position, attitude) in bodies.items()
        ]
        self._poses.send(header=header(), poses=poses)

    def close(self) -> None:
        """Stop publishing."""
        self._poses.close()


def _towards(here: Vector, goal: Vector) -> Vector:
    x, y, z = (STIFFNESS * (there - at) for at, there in zip(here, goal, strict=True))
    slower = FASTEST / max(hypot(x, y, z), FASTEST)
    return (slower * x, slower * y, slower * z)
