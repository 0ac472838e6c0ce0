"""What is drawn of a world: its ground, and the circles around flock and dogs, as numbers."""

from typing import Any

import jax
import numpy as np

from skydog.world import herding
from skydog.world.params import World


def sensing(world: World) -> float | None:
    """How far a sheep sees a dog at most, in metres; None for a law that has no such range."""
    return greatest(world.flock, "sensing")


def greatest(law: object, name: str) -> float | None:
    """The parameter of a law, the greatest of the sheep's; None if it has no such number."""
    value = getattr(law, name, None)
    if isinstance(value, int | float | np.ndarray | jax.Array):
        return float(np.max(value))
    return None


def numbers(world: World, sheep: int) -> dict[str, Any]:
    """What a page draws of a world besides who moves in it: metres, to the millimetre."""
    seen = sensing(world)
    return {
        "size": rounded(world.arena.size),
        "goal": rounded(herding.goal(world.arena)),
        "radius": rounded(world.arena.goal_radius),
        "sensing": None if seen is None else rounded(seen),
        "gathered": rounded(herding.gathered_radius(world, sheep)),
    }


def rounded(values: Any, digits: int = 3) -> Any:
    """Numbers as plain data, rounded: metres to the millimetre."""
    return np.round(np.asarray(values, np.float64), digits).tolist()
