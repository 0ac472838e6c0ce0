"""Which poses are believed: finite, and where the body can have moved to. And how old they are."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from skydog.flight.limits import Limits
from skydog.flight.rovers import wrapped
from skydog.flight.station import Frame


class Believed(NamedTuple):
    """The latest pose of each body that was believed, and when: drones first, then rovers."""

    dogs: Float[np.ndarray, "*batch dogs 3"]  # m
    sheep: Float[np.ndarray, "*batch sheep 2"]
    yaw: Float[np.ndarray, "*batch sheep"]
    when: Float[np.ndarray, "*batch bodies"]  # s


def start(frame: Frame, now: float) -> Believed:
    """Believe the first frame, of the bodies that are in it."""
    seen = np.concatenate([frame.dogs_seen, frame.sheep_seen], axis=-1)
    return Believed(
        np.nan_to_num(frame.dogs, posinf=0.0, neginf=0.0),
        np.nan_to_num(frame.sheep, posinf=0.0, neginf=0.0),
        np.nan_to_num(frame.yaw, posinf=0.0, neginf=0.0),
        np.where(seen, now, -np.inf),
    )


def gate(
    limits: Limits, before: Believed, frame: Frame, now: float, anywhere: Bool[np.ndarray, "*batch"]
) -> tuple[Believed, Frame]:
    """The frame, less the poses that cannot be true; what is not seen is where it was last.

    A body may be `anywhere` as long as nothing moves by our command: it may be carried.
    """
    dogs = before.dogs.shape[-2]
    known = before.when
    for_long = np.minimum(now - known, limits.remembers)
    free = np.asarray(anywhere)[..., None]
    flown = limits.jump + limits.drone_speed * for_long[..., :dogs]
    driven = limits.jump + limits.rover_speed * for_long[..., dogs:]
    dogs_seen = frame.dogs_seen & _near(frame.dogs, before.dogs, flown, free)
    sheep_seen = frame.sheep_seen & _near(frame.sheep, before.sheep, driven, free)
    turned = np.abs(wrapped(np.where(np.isfinite(frame.yaw), frame.yaw, 0.0) - before.yaw))
    may_turn = limits.turn + limits.turn_rate * for_long[..., dogs:]
    sheep_seen = sheep_seen & np.isfinite(frame.yaw) & ((turned <= may_turn) | free)
    believed = Believed(
        np.where(dogs_seen[..., None], frame.dogs, before.dogs),
        np.where(sheep_seen[..., None], frame.sheep, before.sheep),
        np.where(sheep_seen, frame.yaw, before.yaw),
        np.where(np.concatenate([dogs_seen, sheep_seen], axis=-1), now, known),
    )
    return believed, Frame(believed.dogs, believed.sheep, believed.yaw, dogs_seen, sheep_seen)


def _near(
    seen: Float[np.ndarray, "*batch bodies axes"],
    last: Float[np.ndarray, "*batch bodies axes"],
    reach: Float[np.ndarray, "*batch bodies"],
    free: Bool[np.ndarray, "*batch 1"],
) -> Bool[np.ndarray, "*batch bodies"]:
    with np.errstate(invalid="ignore", over="ignore"):
        moved = np.sqrt(np.sum((seen - last) ** 2, axis=-1))
        return np.isfinite(moved) & ((moved <= reach) | free)
