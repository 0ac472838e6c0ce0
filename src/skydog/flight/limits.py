"""What the supervisor allows: ages, fences, speeds; each number with its source."""

from dataclasses import dataclass
from math import inf

import numpy as np
from jaxtyping import Float

APART = 0.03  # m between two bodies of a kind, where a flight begins; ours
PAD = 0.15  # m between a drone's pad and a rover or a wall, which its take-off may meet; ours

Span = tuple[float, float]
Corner = float | Float[np.ndarray, "2"]
"""The least, or the greatest, coordinates of a rectangle in metres; of a square one number."""


@dataclass(frozen=True)
class Limits:
    """The limits of a flight. Metres, seconds, m/s; world frame."""

    # The hard fence: a drone that is seen outside lands.
    x: Span
    y: Span
    z: Span
    stale: float = 0.1  # s without a pose: rovers stop, drones hold; MRS UAV system
    blind: float = 0.5  # s: land; PX4 #15455 asks for it
    alarm: float = 1.5  # s: the operator is called; Crazyswarm2 #38
    silence: float = inf  # s without a decision: hold
    longest_hold: float = 10.0  # s, unless an operator holds; ours
    longest_take_off: float = 60.0  # s; ours
    lowest: float = 1.0  # m of altitude, in a mission: a UGV is 0.1 to 0.4 m high; ours
    battery: float = 0.15  # share, at which it lands; ours
    # Poses: what a body may move beyond what its speed allows, before it is no longer believed.
    jump: float = 0.15  # m; ours: less than a third of what separates two rovers
    drone_speed: float = 3.0  # m/s
    rover_speed: float = 0.75  # m/s
    turn: float = 0.6  # rad that a rover may turn beyond what its turn rate allows; ours
    turn_rate: float = 4.7  # rad/s
    remembers: float = 0.25  # s: nothing is believed further away than in that time
    # What a rover may do that is told to stand, before it is said to run away; and for how long.
    runaway: float = 0.15  # m/s; ours: slower than any that herds
    runs_for: float = 1.0  # s
