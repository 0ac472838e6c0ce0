"""Messages: exact on every wire that they go over."""

import dataclasses
import random

import pytest

pytest.importorskip("rosbags", reason="skydog[lab] is not installed")
pytest.importorskip("cyclonedds", reason="skydog[lab] is not installed")

from rosbags.typesys import Stores, get_typestore

from skydog.lab import messages

SPOKEN = (
    "std_msgs/msg/Empty",
    "std_msgs/msg/String",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/Imu",
    "motion_capture_tracking_interfaces/msg/NamedPoseArray",
    "crazyflie_interfaces/msg/FullState",
    "crazyflie_interfaces/msg/Position",
    "crazyflie_interfaces/msg/VelocityWorld",
    "crazyflie_interfaces/msg/Status",
)
LIMITS = {"uint8": 2**8, "uint16": 2**16, "uint32": 2**32, "uint64": 2**64}


def filled(desc, chance: random.Random):
    """A random value of a field as rosbags describes it, for cyclonedds."""
    kind, what = int(desc[0]), desc[1]
    if kind == 2:
        return drawn(what, chance)
    if kind == 1:
        base = what[0]
        if base == "string":
            return "".join(chance.choices("abc é→", k=chance.randrange(9)))
        if base == "bool":
            return chance.random() < 0.5
        if base.startswith("float"):
            return chance.randrange(-999, 999) / 8  # exact in 32 bits too
        if base in LIMITS:
            return chance.randrange(LIMITS[base])
        return chance.randrange(-100, 100)
    inner, size = what
    return [filled(inner, chance) for _ in range(size if kind == 3 else chance.randrange(5))]


def drawn(name: str, chance: random.Random):
    fields = messages.store2().fielddefs[name][1]
    return messages.idl(name)(**{field: filled(desc, chance) for field, desc in fields})


def same(theirs, ours) -> bool:
    """Whether rosbags' message and cyclonedds' hold the same, field by field."""
    if dataclasses.is_dataclass(ours):
        return all(
            same(getattr(theirs, field.name), getattr(ours, field.name))
            for field in dataclasses.fields(ours)
        )
    if isinstance(ours, list):
        return len(theirs) == len(ours) and all(map(same, theirs, ours))
    return theirs == ours


@pytest.mark.parametrize("name", SPOKEN)
def test_dds_and_rosbags_write_the_same_bytes(name):
    store = messages.store2()
    for seed in range(30):
        ours = drawn(name, random.Random(seed))
        raw = ours.serialize()
        theirs = store.deserialize_cdr(raw, name)
        assert same(theirs, ours)
        assert bytes(store.serialize_cdr(theirs, name)) == raw


def leaves(message):
    if dataclasses.is_dataclass(message):
        for field in dataclasses.fields(message):
            yield from leaves(getattr(message, field.name))
    elif isinstance(message, list):
        yield from message
    else:
        yield message


@pytest.mark.parametrize("name", SPOKEN)
def test_a_message_is_called_as_ros_2_calls_it_final_and_at_first_all_zeros(name):
    kind = messages.idl(name)
    package, _, short = name.split("/")
    assert kind.__idl_typename__ == f"{package}::msg::dds_::{short}_"
    assert kind.__idl_annotations__["extensibility"] == "final"
    assert not any(leaves(kind()))


def test_two_messages_share_no_part():
    twist = messages.idl("geometry_msgs/msg/Twist")
    one, other = twist(), twist()
    one.linear.x = 1.0
    assert other.linear.x == 0.0


@pytest.mark.parametrize("store", [Stores.ROS2_JAZZY, Stores.ROS2_LYRICAL])
def test_the_standard_messages_are_the_same_in_later_ros(store):
    later = get_typestore(store)
    for name in set(SPOKEN) & set(later.fielddefs):
        assert later.fielddefs[name][1] == messages.store2().fielddefs[name][1]


def test_navdata_is_the_drivers_own_by_its_md5():
    name = "ardrone_autonomy/msg/Navdata"
    assert messages.store1().generate_msgdef(name)[1] == "e1169f766234363125ac62c9a3f87eeb"
    assert name not in messages.store2().fielddefs


def test_ros_1_reads_the_text_of_navdata():
    dynamic = pytest.importorskip("genpy.dynamic", reason="ROS 1 is not installed")
    made = dynamic.generate_dynamic(
        "ardrone_autonomy/Navdata", messages.text1("ardrone_autonomy/Navdata")
    )
    assert made["ardrone_autonomy/Navdata"]._md5sum == "e1169f766234363125ac62c9a3f87eeb"
