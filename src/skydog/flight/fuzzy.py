"""The fuzzy rule base that scales the gain of a rover's yaw loop: nine rules, zero-order Sugeno.

The paper's UGVs have an "adaptive SNI controller-based FIS" whose table is in a supplement that we
do not have; these rules are ours. They scale Γ of N(s) = Γ / (s + ΓΦ) - Δ. Whatever Γ is, the
controller stays SNI and N(0) = 1/Φ - Δ stays below zero, so that no rule can destabilise the loop.
"""

import numpy as np
from jaxtyping import Float

from skydog.flight.bounds import clipped

# Where a set is certain: |error| in radians, and by how much it grows in rad/s.
ERROR = np.array([0.0, 0.5, 1.5])  # small, medium, large
GROWTH = np.array([-2.0, 0.0, 2.0])  # shrinks, stands, grows

# Γ is multiplied by this. A small one lets the lead -N(∞) = Δ last: a hard turn. A large one soon
# leaves the DC gain: a soft one.
RULES = np.array(
    [
        # shrinks, stands, grows
        [4.0, 2.0, 1.0],  # small: it is nearly there, brake
        [2.0, 1.0, 0.5],  # medium
        [1.0, 0.5, 0.25],  # large: turn as hard as it can
    ]
)


def gain(
    error: Float[np.ndarray, "*batch"], rate: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """The factor of Γ for an error in radians that changes by `rate` rad/s.

    Between `RULES`' least and greatest, 0.25 and 4.
    """
    growth = np.where(error < 0.0, -rate, rate)
    large, grows = _memberships(np.abs(error), ERROR), _memberships(growth, GROWTH)
    return np.einsum("...i,...j,ij->...", large, grows, RULES)


def _memberships(
    value: Float[np.ndarray, "*batch"], peaks: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*batch 3"]:
    """How far a value belongs to each of three triangular sets; the outer ones have shoulders."""
    least, middle, most = peaks
    below = clipped((middle - value) / (middle - least), 0.0, 1.0)
    above = clipped((value - middle) / (most - middle), 0.0, 1.0)
    return np.stack([below, 1.0 - below - above, above], axis=-1)
