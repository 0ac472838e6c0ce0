"""From a site file to the drivers at the other end of its wires."""

from collections.abc import Mapping
from typing import Any, Protocol

from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.emulation.room import Room
from skydog.lab.emulation.tracker import Tracker
from skydog.lab.site import UAVSite, UGVSite
from skydog.lab.topics import behind_guard


class Shows(Protocol):
    """What shows the bodies of a room to its base station."""

    def show(self, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> None:
        """Show a frame."""
        ...


def connect(room: Room) -> Shows:
    """Give a room its drivers and its tracker."""
    site = room.site
    speaks = {robot.adapter for robot in (*site.uav, *site.ugv)}
    node = domain = None
    if site.mocap.source == "ros1" or speaks & {"ros1", "tum-simulator", "ardrone-autonomy"}:
        from skydog.lab.ros1_node import Node

        node = Node(site.ros1, "room")
        room.closes.append(node)
    if site.mocap.source == "ros2" or speaks & {"dds", "twist-dds", "crazyswarm2"}:
        from skydog.lab.domain import Domain

        domain = Domain(site.dds)
        room.closes.append(domain)
    for uav in site.uav:
        room.drivers.append(_drone(uav, node, domain))
    for ugv in site.ugv:
        room.rover_drivers.append(_rover(ugv, node, domain, ugv.name in room.start.latches))
    shows = _shows(room, node, domain)
    if hasattr(shows, "close"):
        room.closes.append(shows)
    return shows


def _drone(uav: UAVSite, node: Any, domain: Any) -> Any:
    if uav.adapter in ("tum-simulator", "ardrone-autonomy"):
        from skydog.lab.emulation import ros1

        kind = (
            ros1.TumSimulatorDriver
            if uav.adapter == "tum-simulator"
            else ros1.ArdroneAutonomyDriver
        )
        return kind(node, behind_guard(uav.topic or "/cmd_vel"))
    if uav.adapter == "twist-dds":
        from skydog.lab.emulation.dds import DDSDrone

        return DDSDrone(domain, uav)
    if uav.adapter == "crazyswarm2":
        from skydog.lab.emulation.dds import DDSCrazyswarm2

        return DDSCrazyswarm2(domain, uav)
    if uav.adapter == "crazyflie":
        from skydog.lab.emulation.crazyflie import CrazyflieDriver

        return CrazyflieDriver()
    from skydog.lab.emulation.mavlink import MavlinkDriver

    return MavlinkDriver()


def _rover(ugv: UGVSite, node: Any, domain: Any, latches: bool) -> Any:
    if ugv.adapter == "ros1":
        from skydog.lab.emulation.ros1 import RoverROS1

        topic = behind_guard(ugv.topic or f"/{ugv.name}/cmd_vel")
        return RoverROS1(node, topic, ugv.stamped, latches)
    from skydog.lab.emulation.dds import DDSRover

    return DDSRover(domain, ugv, latches)


def _shows(room: Room, node: Any, domain: Any) -> Any:
    site = room.site
    if site.mocap.source == "vicon-udp":
        return Tracker(site, room.start.key[-1])
    names = tuple(robot.name for robot in (*site.uav, *site.ugv))
    if site.mocap.source == "ros1":
        from skydog.lab.emulation.ros1 import ViconBridge

        return _Each(ViconBridge(node, site.mocap, names))
    from skydog.lab.emulation.dds import DDSPoses

    return _All(DDSPoses(domain, site.mocap.topic or "/poses"))


class _Each:
    def __init__(self, bridge: Any):
        self._bridge, self.close = bridge, bridge.close

    def show(self, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> None:
        for name, (position, attitude) in bodies.items():
            self._bridge.show(name, position, attitude)


class _All:
    def __init__(self, poses: Any):
        self._poses, self.close = poses, poses.close

    def show(self, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> None:
        self._poses.send(bodies)
