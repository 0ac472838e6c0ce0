"""Which topics a site publishes and hears, told without connecting to anything."""

from typing import NamedTuple

from skydog.lab.site import Site, UAVSite, UGVSite

TWIST, STAMPED, EMPTY = "geometry_msgs/Twist", "geometry_msgs/TwistStamped", "std_msgs/Empty"


GUARDED = "_in"  # with which the topic ends that a guard passes on


class Topic(NamedTuple):
    """A topic and its type, as ROS 1 writes it: package/Name."""

    name: str
    kind: str
    ours: bool  # we publish it, and nobody else should; else we hear it


def of_tracker(site: Site) -> list[Topic]:
    """The topics of poses; none where motion capture does not come by ROS."""
    pattern = site.mocap.topic
    names = [robot.name for robot in (*site.uav, *site.ugv)]
    if site.mocap.source == "ros1":
        pattern = "/" + (pattern or "vicon/NAME/NAME").lstrip("/")
        kind = "geometry_msgs/TransformStamped"
        return [Topic(pattern.replace("NAME", name), kind, False) for name in names]
    if site.mocap.source == "ros2":
        if "NAME" in pattern:
            kind = "geometry_msgs/PoseStamped"
            return [Topic(pattern.replace("NAME", name), kind, False) for name in names]
        kind = "motion_capture_tracking_interfaces/NamedPoseArray"
        return [Topic(pattern or "/poses", kind, False)]
    return []


def commands(robot: UAVSite | UGVSite) -> str:
    """The topic of a robot's velocities, or the namespace of a Crazyswarm2 drone."""
    if isinstance(robot, UAVSite):
        if robot.adapter in ("tum-simulator", "ardrone-autonomy"):
            return robot.topic or "/cmd_vel"
        if robot.adapter == "crazyswarm2":
            return robot.topic or f"/{robot.name}"
    return robot.topic or f"/{robot.name}/cmd_vel"


def behind_guard(topic: str) -> str:
    """The topic that a guard publishes and its robot obeys."""
    return topic.removesuffix(GUARDED)


def of_robot(robot: UAVSite | UGVSite) -> list[Topic]:
    """The topics of a robot; none of one that is reached by radio or by MAVLink."""
    topic = commands(robot)
    space = topic.rpartition("/")[0]
    twist = Topic(topic, STAMPED if robot.stamped else TWIST, True)
    if isinstance(robot, UGVSite):
        return [twist]
    if robot.adapter in ("tum-simulator", "ardrone-autonomy"):
        words = ["takeoff", "land"] + ["reset"] * (robot.adapter == "ardrone-autonomy")
        return [
            Topic(topic, TWIST, True),
            *(Topic(f"{space}/ardrone/{word}", EMPTY, True) for word in words),
            Topic(f"{space}/ardrone/navdata", "ardrone_autonomy/Navdata", False),
        ]
    if robot.adapter == "twist-dds":
        return [
            twist,
            *(Topic(f"{space}/{word}", EMPTY, True) for word in ("takeoff", "land", "emergency")),
            Topic(f"{space}/battery_state", "sensor_msgs/BatteryState", False),
        ]
    if robot.adapter == "crazyswarm2":
        return [
            Topic(f"{topic}/cmd_full_state", "crazyflie_interfaces/FullState", True),
            Topic(f"{topic}/cmd_velocity_world", "crazyflie_interfaces/VelocityWorld", True),
            Topic(f"{topic}/cmd_vel_legacy", TWIST, True),
            Topic(f"{topic}/status", "crazyflie_interfaces/Status", False),
        ]
    return []
