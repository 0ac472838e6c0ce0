"""What a sheepdog was trained for, and what a mission needs beyond that."""

from typing import Any

import numpy as np

from skydog.world.params import World
from skydog.world.serialise import law_name

NEAR = 0.02  # sides of the arena: a goal so near to the one of the lessons is the same


def scope(
    world: World, scales: tuple[float, float], goals_anywhere: bool, sheep: int
) -> dict[str, Any]:
    """What lessons in a world teach for, as it stands in a card under `taught_for`.

    `scales` are the least and the greatest ξ of an episode.
    """
    size, arena = float(world.arena.scale), world.arena
    return {
        "goals": "anywhere" if goals_anywhere else [float(arena.goal_x), float(arena.goal_y)],
        "arenas": sorted(size / scale for scale in scales),
        "sheep": sheep,
        "flock": law_name("flock", world.flock),
    }


def beyond(card: dict[str, Any], world: World, sheep: int | None) -> list[str]:
    """What a mission asks beyond what a sheepdog's card says that it was taught for.

    `sheep` is None for any number. Each is a phrase, such as "for the goal 0,0, not 4,4". A card
    that says nothing of it asks for nothing.
    """
    taught, size = card.get("taught_for"), float(world.arena.scale)
    if not isinstance(taught, dict):
        taught = _before(card)
    found = []
    goal, home = _numbers(taught.get("goals"), 2), _numbers([card.get("arena")], 1)
    if goal and home:
        here = np.array([float(world.arena.goal_x), float(world.arena.goal_y)])
        there = np.array(goal) / home[0] * np.array(world.arena.plain_sides)
        if np.abs(here - there).max() > NEAR * size:
            found.append("for the goal {:g},{:g}, not {:g},{:g}".format(*there, *here))
    if arenas := _numbers(taught.get("arenas"), 2):
        least, most = arenas
        if not 0.999 * least <= size <= 1.001 * most:
            found.append(f"for arenas of {least:.3g} to {most:.3g} m, not {size:g} m")
    flock = _numbers([taught.get("sheep")], 1)
    if flock and sheep is not None and flock[0] != sheep:
        found.append(f"with {flock[0]:g} sheep, not {sheep}")
    law, here = taught.get("flock"), law_name("flock", world.flock)
    if isinstance(law, str) and law != here:
        found.append(f"with sheep of the law {law[:60]!r}, not {here!r}")
    return found


def _before(card: dict[str, Any]) -> dict[str, Any]:
    """What cards tell that were written before they had `taught_for`: one goal."""
    world = card.get("world")
    world = world if isinstance(world, dict) else {}
    goal = [world.get("arena.goal_x", 0.0), world.get("arena.goal_y", 0.0)]
    return {"goals": goal, "sheep": card.get("sheep")}


def _numbers(values: Any, count: int) -> list[float]:
    """A value from a file, if it is a list of so many numbers; else an empty list."""
    if not isinstance(values, list) or len(values) != count:
        return []
    fit = all(isinstance(one, int | float) and 0.0 <= one < 1e9 for one in values)
    return [float(one) for one in values] if fit else []
