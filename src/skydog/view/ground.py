"""What is drawn of a world: its ground, and the circles around flock and dogs, as numbers."""

import math
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from skydog.world import herding
from skydog.world.params import World

CORNERS = 16  # of the polygon that shows each end of an obstacle
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
        "height": rounded(world.arena.plain_sides[1]),
        "obstacles": obstacles(world),
        "goal": rounded(herding.goal(world.arena)),
        "radius": rounded(drawn(float(world.arena.goal_radius), span)),
        "sensing": None if seen is None else rounded(drawn(seen, span)),
        "gathered": rounded(drawn(float(herding.gathered_radius(world, sheep)), span)),
    }


def obstacles(world: World) -> list[list[float]]:
    """Each obstacle as both ends of its segment, x and y, and its radius. Metres."""
    if world.obstacles is None:
        return []
    ends = np.reshape(np.asarray(world.obstacles.ends), (-1, 4))
    return rounded(np.column_stack([ends, np.asarray(world.obstacles.radius)]))


def outline(obstacle: list[float]) -> Float[np.ndarray, "corners 2"]:
    """The rim of an obstacle (`obstacles`) as a polygon, in metres."""
    *ends, radius = obstacle
    first, last = np.reshape(ends, (2, 2))
    angle = np.arctan2(*(last - first)[::-1])
    turn = angle + np.linspace(-np.pi / 2, np.pi / 2, CORNERS)
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return np.concatenate([last + cap, first - cap])


def rounded(values: Any, digits: int = 3) -> Any:
    """Numbers as plain data, rounded: metres to the millimetre."""
    return np.round(np.asarray(values, np.float64), digits).tolist()
