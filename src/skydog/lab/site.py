"""The site file: everything that is true of one laboratory and its robots, as TOML."""

from dataclasses import dataclass
from typing import Literal

from skydog.flight.options import Steering

Transport = Literal["vicon-udp", "ros1", "ros2", "replay"]
UAVAdapter = Literal["tum-simulator", "ardrone-autonomy", "twist-dds", "crazyswarm2", "crazyflie", "mavlink"]
UGVAdapter = Literal["ros1", "dds"]


@dataclass(frozen=True)
class Mission:
    """What is flown."""

    sheepdog: str = "h-ddpg-6x6"  # a name that ships, a run folder or a file; or strombom
    preset: str = "paper-physical"
    arena: float | None = None  # m; the preset's own if not given
    goal: str | None = None
    speed: float = 1.0  # share of the world's speeds
    steps: int = 1000
    steering: Steering = "reference"
    wait: float | None = None  # m: the next set-point waits until the drone is so near
    flock: Literal["base station", "own"] = "base station"  # who steers the UGVs


@dataclass(frozen=True)
class Cage:
    """The hard fence, in the world's frame: what is outside lands. Metres."""

    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]


@dataclass(frozen=True)
class Mocap:
    """Motion capture: which stream, and how its frame lies in the world's."""

    source: Transport = "vicon-udp"
    host: str = "127.0.0.1"  # the address of ours that listens; or, of a log, its path
    port: int = 51001
    topic: str = ""  # ROS: "" is the usual one of the source
    rate: float = 100.0  # Hz
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: the tracker's origin in the world
    yaw: float = 0.0  # rad by which the tracker's x axis is turned in the world


@dataclass(frozen=True)
class ROS1:
    """The ROS 1 master."""

    master: str = "http://127.0.0.1:11311"
    address: str = "127.0.0.1"  # ours, as robots reach it


@dataclass(frozen=True)
class DDS:
    """The DDS domain of ROS 2."""

    domain: int = 0
    interface: str = "lo"
    peers: tuple[str, ...] = ("127.0.0.1",)


@dataclass(frozen=True)
class UAVSite:
    """A drone: its name at the tracker, what it speaks, and what it is."""

    name: str
    adapter: UAVAdapter
    profile: str = "tum-simulator"
    topic: str = ""  # of its commands, or a namespace; "" is the adapter's usual one
    uri: str = ""  # crazyflie: radio://0/80/2M/E7E7E7E7E7, udp://…; mavlink: udpin:…, /dev/…
    stamped: bool = False  # TwistStamped instead of Twist
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: its markers' origin, in its own frame
    yaw: float = 0.0  # rad by which its markers' frame is turned in its own
    stops_by_itself: bool = False
    guard: bool = False  # `skydog.lab.guard` runs on the robot
    battery_minutes: float = 10.0  # of flight, with a full battery


@dataclass(frozen=True)
class UGVSite:
    """A rover."""

    name: str
    adapter: UGVAdapter = "ros1"
    profile: str = "kobuki"
    topic: str = ""  # "" is /NAME/cmd_vel
    stamped: bool = False
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    stops_by_itself: bool = False
    guard: bool = False
    speed: float | None = None  # m/s; its profile's if not given
    turn_rate: float | None = None  # rad/s


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
