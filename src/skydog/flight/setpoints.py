"""Integrated set-points: where a body should be by now (paper, Eq. 23).

Every step a decision moves the set-point by velocity times dt; in between it runs there at that
velocity, so that a controller is never asked to jump.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Slide = Callable[
    [Float[np.ndarray, "*batch bodies 2"], Float[np.ndarray, "*batch bodies 2"]],
    Float[np.ndarray, "*batch bodies 2"],
]
"""Where those come to, in metres, who want to move from a place to another among obstacles."""


class Setpoint(NamedTuple):
    """A set-point on its way. Metres, m/s."""

    origin: Float[np.ndarray, "*batch bodies 2"]  # where it was when it was decided
    velocity: Float[np.ndarray, "*batch bodies 2"]


def stand(position: Float[np.ndarray, "*batch bodies 2"]) -> Setpoint:
    """A set-point that stands."""
    return Setpoint(position, np.zeros_like(position))


def at(
    setpoint: Setpoint, elapsed: float | Float[np.ndarray, "*batch 1 1"]
) -> Float[np.ndarray, "*batch bodies 2"]:
    """Where the set-point is, so many seconds after it was decided."""
    return setpoint.origin + elapsed * setpoint.velocity


def integrate(
    before: Setpoint,
    velocity: Float[np.ndarray, "*batch bodies 2"],
    position: Float[np.ndarray, "*batch bodies 2"],
    dt: float,
    leash: float,
) -> Setpoint:
    """The next set-point: on from where the last one came, at `velocity` (paper, Eq. 23).

    It starts no further than `leash` metres from the body's `position`: a body that is held up
    does not have to make up for it.
    """
    origin = at(before, dt)
    behind = origin - position
    away = np.hypot(behind[..., :1], behind[..., 1:])
    pulled = position + behind * np.minimum(1.0, leash / np.maximum(away, leash))
    return Setpoint(pulled, velocity)


def reached(
    setpoint: Setpoint,
    position: Float[np.ndarray, "*batch bodies 2"],
    dt: float,
    tolerance: float,
) -> Bool[np.ndarray, "*batch bodies"]:
    """Whether a body is within `tolerance` metres of its waypoint, the set-point's end."""
    away = at(setpoint, dt) - position
    return np.hypot(away[..., 0], away[..., 1]) <= tolerance
