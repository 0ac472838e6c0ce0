"""Every message that the lab speaks, once: what ROS 1, ROS 2's wire and the flight log are made of.

Standard messages come from rosbags, all others from the texts in `msg/`. The classes that go over
DDS are made from the same definitions, so that no field is written twice.
"""

import dataclasses
from functools import cache
from importlib import resources
from typing import Any

from skydog.errors import Refusal

try:
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    from rosbags.typesys.store import Typestore
except ImportError as missing:
    raise Refusal("ROS messages need rosbags; run: pip install 'skydog[lab]'") from missing

ROS1_ONLY = ("ardrone_autonomy",)  # packages whose messages have no ROS 2 form


@cache
def store1() -> Typestore:
    """The messages of ROS 1 (Noetic), and ours."""
    return _with_ours(Stores.ROS1_NOETIC, lambda package: package in ROS1_ONLY)


@cache
def store2() -> Typestore:
    """The messages of ROS 2 (Humble; those we use stayed the same since), and ours."""
    return _with_ours(Stores.ROS2_HUMBLE, lambda package: package not in ROS1_ONLY)


def text1(name: str) -> str:
    """The text of a ROS 1 message and of all that it contains, as genpy.dynamic reads it.

    `name` is as ROS 1 has it: ardrone_autonomy/Navdata.
    """
    return store1().generate_msgdef(name.replace("/", "/msg/"))[0]


@cache
def idl(name: str) -> type[Any]:
    """The class of a ROS 2 message for cyclonedds; made without arguments it is all zeros.

    `name` is as ROS 2 has it: geometry_msgs/msg/Twist. On the wire it is called
    geometry_msgs::msg::dds_::Twist_, and it is final: a ROS 2 node matches no other name.
    """
    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.annotations import final

    package, kind, short = name.split("/")
    fields = {field: _typed(desc) for field, desc in store2().fielddefs[name][1]}
    made = make_idl_struct(short, f"{package}::{kind}::dds_::{short}_", fields, dataclassify=False)
    for field, desc in store2().fielddefs[name][1]:
        setattr(made, field, dataclasses.field(default_factory=_zero(desc)))
    return dataclasses.dataclass(final(made))


def _with_ours(base: Stores, wanted: Any) -> Typestore:
    store = get_typestore(base)
    folder = resources.files("skydog.lab") / "msg"
    ours = {}
    for package in sorted(folder.iterdir(), key=lambda found: found.name):
        if wanted(package.name):
            for file in package.iterdir():
                name = f"{package.name}/msg/{file.name.removesuffix('.msg')}"
                ours |= get_types_from_msg(file.read_text(), name)
    store.register(ours)
    return store


def _typed(desc: Any) -> Any:
    """The type that cyclonedds writes for what rosbags describes."""
    from cyclonedds.idl import types

    kind, what = desc
    if kind == Nodetype.NAME:
        return idl(what)
    if kind == Nodetype.BASE:
        base, limit = what
        if base == "string":
            return types.bounded_str[limit] if limit else str
        if base == "bool":
            return bool
        return getattr(types, "uint8" if base in ("byte", "char") else base)
    inner, size = what
    if kind == Nodetype.ARRAY:
        return types.array[_typed(inner), size]
    return types.sequence[_typed(inner), size] if size else types.sequence[_typed(inner)]


def _zero(desc: Any) -> Any:
    """What makes the value that a field has before it is given one."""
    kind, what = desc
    if kind == Nodetype.NAME:
        return idl(what)
    if kind == Nodetype.BASE:
        return {"string": str, "bool": bool, "float32": float, "float64": float}.get(what[0], int)
    inner, size = what
    one = _zero(inner)
    return (lambda: [one() for _ in range(size)]) if kind == Nodetype.ARRAY else list
