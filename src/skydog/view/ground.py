"""What is drawn of a world: its ground, and the circles around flock and dogs, as numbers."""

import math
from typing import Any

import jax
import numpy as np

from skydog.world import herding
from skydog.world.params import World

WIDEST = 10.0  # views that a circle is wide, at most


def sensing(world: World) -> float | None:
    """How far a sheep sees a dog at most, in metres; None for a law that has no such range."""
    return greatest(world.flock, "sensing")


def greatest(law: object, name: str) -> float | None:
    """The parameter of a law, the greatest of the sheep's; None if it has no such number."""
    value = getattr(law, name, None)
    if isinstance(value, int | float | np.ndarray | jax.Array):
        return float(np.max(value))
    return None


def drawn(radius: float, span: float) -> float:
    """The radius of a circle in a view of so many metres: no file keeps a pencil busy for ever.

    Around something in the view, the rim of so wide a circle is not in it.
    """
    return min(radius, WIDEST * span)


def numbers(world: World, sheep: int, span: float | None = None) -> dict[str, Any]:
    """What a page draws of a world besides who moves in it: metres, to the millimetre.

    `span` is how many metres the page shows, if that is known.
    """
    seen = sensing(world)
    span = math.inf if span is None else span
    return {
        "size": rounded(world.arena.size),
        "goal": rounded(herding.goal(world.arena)),
        "radius": rounded(drawn(float(world.arena.goal_radius), span)),
        "sensing": None if seen is None else rounded(drawn(seen, span)),
        "gathered": rounded(drawn(float(herding.gathered_radius(world, sheep)), span)),
    }


def rounded(values: Any, digits: int = 3) -> Any:
    """Numbers as plain data, rounded: metres to the millimetre."""
    return np.round(np.asarray(values, np.float64), digits).tolist()
