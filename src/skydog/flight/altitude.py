"""Take-off, hold and landing: how high a drone should be by now, and how fast it climbs there."""

import numpy as np
from jaxtyping import Float

from skydog.flight.bounds import clipped
from skydog.flight.profiles import UAV

HEIGHT = 2.0  # m; paper, "Action and state space": the altitude that the UAV holds
GAIN = 1.5  # 1/s, of the altitude
LANDING = 0.6  # 1/s: how fast a landing drone sinks, of its altitude
SLOWEST = 0.15  # m/s at which it comes to the floor


def climb(
    uav: UAV, altitude: Float[np.ndarray, "*batch"], height: Float[np.ndarray, "*batch"] | float
) -> Float[np.ndarray, "*batch"]:
    """The climb rate in m/s that brings a drone to `height` metres and holds it there."""
    most = uav.velocity.largest_climb
    return clipped(GAIN * (height - altitude), -most, most)


def land(uav: UAV, altitude: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """The climb rate in m/s of a drone that lands: the slower the lower it is."""
    return -clipped(LANDING * altitude, SLOWEST, uav.velocity.largest_climb)
