"""Position and velocity out of what motion capture sees: an alpha-beta filter."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

# Of what a frame says beyond the prediction, this much is believed of the position and, over dt, of
# the velocity: the critically damped filter that forgets by 0.6 each frame (0.05 s at 100 Hz).
FORGETS = 0.6
ALPHA, BETA = 1.0 - FORGETS**2, (1.0 - FORGETS) ** 2


class Estimate(NamedTuple):
    """Where a body is, and how fast. Metres, m/s; for yaw, radians and rad/s."""

    position: Float[np.ndarray, "*batch bodies axes"]
    velocity: Float[np.ndarray, "*batch bodies axes"]


def start(position: Float[np.ndarray, "*batch bodies axes"]) -> Estimate:
    """The estimate of a body that stands where it is seen."""
    return Estimate(position, np.zeros_like(position))


def update(
    before: Estimate,
    seen: Float[np.ndarray, "*batch bodies axes"],
    fresh: Bool[np.ndarray, "*batch bodies"],
    dt: float,
) -> Estimate:
    """The estimate `dt` seconds later. Without a `fresh` frame a body moves on as it did."""
    predicted = before.position + dt * before.velocity
    surprise = np.where(fresh[..., None], seen - predicted, 0.0)
    return Estimate(predicted + ALPHA * surprise, before.velocity + BETA / dt * surprise)
