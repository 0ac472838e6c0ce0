"""The numbers that a user may give: what each is, its bounds, and what to write instead.

Commands, presets, cases and curricula check them here, so that a bound stands once.
"""

import math
from dataclasses import dataclass
from operator import index
from typing import Any

from skydog.errors import Refusal, short


@dataclass(frozen=True)
class Quantity:
    """A number from `least` to `most`."""

    says: str  # what it is, in words, with its bounds
    least: int | float
    most: int | float
    fix: str  # what to write instead of a bad one
    whole: bool = True

    def checked(self, value: Any) -> Any:
        """The value as an int or a float; text is read as one.

        Raises `Refusal` for what is no such number.
        """
        number = _number(value, self.whole)
        if number is None or not self.least <= number <= self.most:
            raise Refusal(f"{self.says}, got {_shown(value)}; try {self.fix}")
        return number


SHEEP = Quantity("a flock has 1 to 1,000,000 sheep", 1, 1_000_000, "--sheep 3")
DOGS = Quantity("a mission has 1 to 1,000 dogs", 1, 1_000, "--dogs 1")
CASES = Quantity("a test has 1 to 1,000,000 cases", 1, 1_000_000, "--cases 30")
STEPS = Quantity("a mission has 1 to 10,000,000 steps", 1, 10_000_000, "--steps 1000")
FLIGHT_STEPS = Quantity("a flight has 1 to 100,000 steps", 1, 100_000, "--steps 1000")
EVERY = Quantity("the sheep are recorded every 1 to 10,000,000 steps", 1, 10_000_000, "--every 10")
# jax counts seeds in 32 bits, and the two skills of a sheepdog take two of them.
SEED = Quantity("a seed is a whole number from 0 to 2,147,483,647", 0, 2**31 - 1, "--seed 0")
SEEDS = Quantity("1 to 10,000 sheepdogs are trained", 1, 10_000, "--seeds 8")
# The steps of a training are counted in 32 bits.
TRAINING = Quantity(
    "a skill is trained for 1 to 2,000,000,000 steps", 1, 2_000_000_000, "--steps 150000"
)
EPISODES = Quantity(
    "a skill is trained for 1 to 10,000,000 episodes", 1, 10_000_000, "--episodes 3000"
)
# In a larger arena float32 no longer holds the 5 cm that a sheep moves in a step.
ARENA = Quantity(
    "the arena's side is a length from 0.001 to 100,000 m", 0.001, 1e5, "--arena 4", whole=False
)
GOAL_RADIUS = Quantity(
    "the goal's radius is a length from 0.001 to 100,000 m",
    0.001,
    1e5,
    "--goal-radius 2",
    whole=False,
)
NEARNESS = Quantity(
    "nearness is a share from 0 to 1,000,000", 0.0, 1e6, "--nearness 1", whole=False
)
SPEED = Quantity("speed is a share from 0.001 to 1", 0.001, 1.0, "--speed 0.5", whole=False)
SHARE = Quantity(
    "a share of the flock is from 0 to 1", 0.0, 1.0, "--mix loner=SHARE, such as 0.2", whole=False
)
WAIT = Quantity(
    "the distance to wait for is from 0.001 to 1,000 m", 0.001, 1e3, "--wait 0.1", whole=False
)
STEP = Quantity(
    "a step of a fitted law lasts from 0.001 to 3,600 s", 0.001, 3600.0, "--step 0.5", whole=False
)
PORT = Quantity("a port is a whole number from 0 to 65535", 0, 65_535, "--port 8020")
THREADS = Quantity("there are 1 to 1,024 threads, or 0 for all cores", 0, 1_024, "--threads 0")


def _number(value: Any, whole: bool) -> int | float | None:
    if type(value).__name__ in ("bool", "bool_", "bytes"):
        return None
    try:
        if whole:
            return int(value) if isinstance(value, str) else index(value)
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _shown(value: Any) -> str:
    """A number that was read from text without its quotation marks."""
    reads = isinstance(value, str) and _number(value, False) is not None
    return value if reads and len(value) <= 60 else short(value)
