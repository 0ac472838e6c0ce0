"""From bodies as a tracker shows them to where robots are, and which of them are truly seen.

A tracker that has lost a body says so in no standard way: it leaves the body out, repeats its last
pose, shows zeros, or nothing that is a number. All of these are a loss.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from skydog.flight.station import Frame
from skydog.lab.adapters import Body, Quaternion, Source, Vector
from skydog.lab.site import Mocap, Site, UAVSite, UGVSite

STALE = 0.1  # s: a pose that came longer ago is no longer where a body is; MRS UAV system
FURTHEST = 1000.0  # m from the tracker's origin, on an axis
UNIT = 0.01  # by which the length of a quaternion may differ from 1
TURNS = 1.0  # rad by which a drone, which holds its yaw, may turn between two poses; ours
FORGETS = 10.0  # s after which it may have been turned by hand
HIGHEST = 0.6  # m above or below the floor: a rover that is there was mistaken for a drone


class Sighting(NamedTuple):
    """What is seen in one look. Robots in the order of the site file, drones first."""

    frame: Frame  # who is not seen is where it was seen last
    dog_yaw: Float[np.ndarray, "dogs"]  # rad
    why: tuple[str | None, ...]  # a robot is not seen; None of one that is
    came: tuple[float, ...]  # s: when the latest pose came that was believed; -inf: none did


@dataclass
class _Watched:
    robot: UAVSite | UGVSite
    drone: bool
    latest: Body | None = None
    position: Vector = (0.0, 0.0, 0.0)  # the latest that was believed, in the world
    yaw: float = 0.0
    came: float = -math.inf

    def look(self, body: Body, mocap: Mocap, now: float) -> str | None:
        """Take the pose that came, or say why not."""
        before, self.latest = self.latest, body
        if before is not None and body.number == before.number:
            return "not advancing"
        if now - body.came > STALE:
            return "stale"
        reason = _unbelievable(body)
        # A tracker's noise never repeats: the same numbers again are no news, and grow old.
        if reason is None and before is not None and body[:2] == before[:2]:
            reason = "frozen"
        if reason is not None:
            return reason
        position, attitude = to_world(mocap, self.robot, body.position, _unit(body.attitude))
        if not self.drone and abs(position[2]) > HIGHEST:
            return "too high"
        yaw = _yaw(attitude)
        # Rovers turn fast: `skydog.flight.outliers` knows how fast.
        turned_by = abs(math.remainder(yaw - self.yaw, math.tau)) if self.drone else 0.0
        if turned_by > TURNS and now - self.came < FORGETS:
            return "turned about"
        self.position, self.yaw, self.came = position, yaw, body.came
        return None


class Eyes:
    """Looks at a source, a hundred times a second, for the robots of a site.

    A robot is seen when a frame came since the last look that shows it in a pose that can be
    believed. Otherwise the reason is one of: missing (frames come without it), stale (none came,
    or too long ago), not advancing (the frame's number), frozen, zero, not finite, too far,
    not a rotation, too high (a rover).
    """

    def __init__(self, site: Site, source: Source) -> None:
        self._mocap = site.mocap
        self._source = source
        self._drones = [_Watched(robot, drone=True) for robot in site.uav]
        self._rovers = [_Watched(robot, drone=False) for robot in site.ugv]

    def look(self, now: float) -> Sighting:
        """What is seen at `now`, in seconds of the monotonic clock."""
        bodies = self._source.bodies()
        watched = self._drones + self._rovers
        came = [_news(bodies, each) for each in watched]
        absent = "missing" if any(came) else "stale"
        why = tuple(
            absent if body is None else each.look(body, self._mocap, now)
            for each, body in zip(watched, came, strict=True)
        )
        return Sighting(self._frame(why), _yaws(self._drones), why, tuple(w.came for w in watched))

    def _frame(self, why: tuple[str | None, ...]) -> Frame:
        seen = np.array([reason is None for reason in why], bool)
        return Frame(
            dogs=np.array([dog.position for dog in self._drones], float).reshape(-1, 3),
            sheep=np.array([one.position[:2] for one in self._rovers], float).reshape(-1, 2),
            yaw=_yaws(self._rovers),
            dogs_seen=seen[: len(self._drones)],
            sheep_seen=seen[len(self._drones) :],
        )


def to_world(
    mocap: Mocap, robot: UAVSite | UGVSite, position: Vector, attitude: Quaternion
) -> tuple[Vector, Quaternion]:
    """The pose of a robot in the world, from that of its markers in the tracker's frame."""
    level = _about_z(mocap.yaw)
    attitude = product(product(level, attitude), _about_z(-robot.yaw))
    markers, offset = turned(level, position), turned(attitude, robot.offset)
    x, y, z = (o + m - d for o, m, d in zip(mocap.origin, markers, offset, strict=True))
    return (x, y, z), attitude


def to_tracker(
    mocap: Mocap, robot: UAVSite | UGVSite, position: Vector, attitude: Quaternion
) -> tuple[Vector, Quaternion]:
    """The inverse: the pose of a robot's markers, as the tracker of an emulated site shows it."""
    back, offset = _about_z(-mocap.yaw), turned(attitude, robot.offset)
    x, y, z = (p + d - o for p, d, o in zip(position, offset, mocap.origin, strict=True))
    return turned(back, (x, y, z)), product(product(back, attitude), _about_z(robot.yaw))


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation by the second, then by the first."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )


def turned(attitude: Quaternion, vector: Vector) -> Vector:
    """A vector of a body's frame, in the frame in which the body has this attitude."""
    a, b, c, d = attitude
    x, y, z = vector
    e, f, g = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return x + d * e + b * g - c * f, y + d * f + c * e - a * g, z + d * g + a * f - b * e


def _news(bodies: Mapping[str, Body], watched: _Watched) -> Body | None:
    """What came of a body since the last look."""
    body, before = bodies.get(watched.robot.name), watched.latest
    if body is None or (before is not None and body.came <= before.came):
        return None
    return body


def _about_z(angle: float) -> Quaternion:
    return 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)


def _yaw(attitude: Quaternion) -> float:
    x, y, z, w = attitude
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _yaws(watched: list[_Watched]) -> Float[np.ndarray, "bodies"]:
    return np.array([each.yaw for each in watched], float)


def _unit(attitude: Quaternion) -> Quaternion:
    x, y, z, w = attitude
    size = math.hypot(x, y, z, w)
    return x / size, y / size, z / size, w / size


def _unbelievable(body: Body) -> str | None:
    """What is wrong with a pose that no body can have."""
    if not all(map(math.isfinite, body.position + body.attitude)):
        return "not finite"
    if not any(body.position):
        return "zero"
    if max(map(abs, body.position)) > FURTHEST:
        return "too far"
    if abs(math.hypot(*body.attitude) - 1.0) > UNIT:
        return "not a rotation"
    return None
