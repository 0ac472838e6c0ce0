"""From a site file to adapters: the one place that knows them all."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from skydog.lab.adapters import Drone, Rover, Source
from skydog.lab.orders import Orders
from skydog.lab.site import Site, UAVSite, UGVSite
from skydog.lab.stop_topic import StopTopic
from skydog.lab.topics import behind_guard, commands

Robot = UAVSite | UGVSite


class Wires(NamedTuple):
    """What a site is connected by."""

    source: Source
    drones: tuple[Drone, ...]
    rovers: tuple[Rover, ...]
    stop: StopTopic
    guarded: Callable[[Robot], bool | None]  # whether its guard is seen; None: cannot tell
    behind: Callable[[Robot], tuple[str, ...]]  # who else commands it, past its guard
    closes: tuple[Any, ...]

    def close(self) -> None:
        """Let go of everything, in the order that is the inverse of opening."""
        for part in reversed(self.closes):
            part.close()


def connect(site: Site, orders: Orders) -> Wires:
    """Connect to a site, whose stop topic gives orders.

    Raises `Refusal` for whatever does not answer.
    """
    opened: list[Any] = []
    speaks = {robot.adapter for robot in (*site.uav, *site.ugv)}
    try:
        node = domain = None
        if site.mocap.source == "ros1" or speaks & {"ros1", "tum-simulator", "ardrone-autonomy"}:
            from skydog.lab.ros1_node import Node

            node = Node(site.ros1)
            opened.append(node)
        if site.mocap.source == "ros2" or speaks & {"dds", "twist-dds", "crazyswarm2"}:
            from skydog.lab.domain import Domain

            domain = Domain(site.dds)
            opened.append(domain)
        stop = StopTopic(node, domain, orders)
        opened.append(stop)
        source = _source(site, node, domain)
        opened.append(source)
        drones, rovers = [], []
        for uav in site.uav:
            drones.append(_drone(uav, node, domain))
            opened.append(drones[-1])
        for ugv in site.ugv:
            rovers.append(_rover(ugv, node, domain))
            opened.append(rovers[-1])
    except BaseException:
        for part in reversed(opened):
            part.close()
        raise

    def guarded(robot: Robot) -> bool | None:
        return None if node is None else node.guarded(commands(robot))

    def behind(robot: Robot) -> tuple[str, ...]:
        if node is None:
            return ()
        found = node.others(behind_guard(commands(robot)))
        return tuple(name for name in found if not name.startswith("/guard_"))

    return Wires(source, tuple(drones), tuple(rovers), stop, guarded, behind, tuple(opened))


def _source(site: Site, node: Any, domain: Any) -> Source:
    names = [robot.name for robot in (*site.uav, *site.ugv)]
    mocap = site.mocap
    if mocap.source == "vicon-udp":
        from skydog.lab.vicon import Receiver

        return Receiver(mocap.host, mocap.port, names)
    if mocap.source == "ros1":
        from skydog.lab.ros1 import ViconSource

        return ViconSource(node, mocap, names)
    if mocap.source == "ros2":
        from skydog.lab.dds import PoseSource

        return PoseSource(domain, mocap.topic, names)
    from skydog.lab.playback import Playback

    return Playback(Path(mocap.host))


def _drone(uav: UAVSite, node: Any, domain: Any) -> Drone:
    if uav.adapter in ("tum-simulator", "ardrone-autonomy"):
        from skydog.lab import ros1

        kind = ros1.TumSimulator if uav.adapter == "tum-simulator" else ros1.ArdroneAutonomy
        return kind(node, uav)
    if uav.adapter == "twist-dds":
        from skydog.lab.dds import TwistDrone

        return TwistDrone(domain, uav)
    if uav.adapter == "crazyswarm2":
        from skydog.lab.crazyswarm2 import Crazyswarm2Drone

        return Crazyswarm2Drone(domain, uav)
    if uav.adapter == "crazyflie":
        from skydog.lab.crazyflie import CrazyflieDrone

        return CrazyflieDrone(uav.name, uav.uri)
    from skydog.lab.mavlink import MavlinkDrone

    return MavlinkDrone(uav.name, uav.uri)


def _rover(ugv: UGVSite, node: Any, domain: Any) -> Rover:
    if ugv.adapter == "ros1":
        from skydog.lab import ros1

        return ros1.TwistRover(node, ugv)
    from skydog.lab import dds

    return dds.TwistRover(domain, ugv)
