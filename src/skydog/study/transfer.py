"""Transfer: does a sheepdog herd in an arena other than the one that it learnt in?"""

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import numpy as np

from skydog.shepherds.sheepdog import Sheepdog
from skydog.study import evaluate
from skydog.study.cases import shipped
from skydog.world.mission import MAX_STEPS, Fly
from skydog.world.presets import furthest_first, preset

ARENAS = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0)  # metres


def scaled(sheepdog: Sheepdog, arena: float) -> Sheepdog:
    """The sheepdog as it is: it sees and flies through ξ wherever it is not at home."""
    return sheepdog


def unscaled(sheepdog: Sheepdog, arena: float) -> Sheepdog:
    """The sheepdog, its ξ taken away: it believes that it learnt in this arena."""
    return eqx.tree_at(lambda dog: dog.arena, sheepdog, arena)


def sweep(
    fly: Fly,
    sheepdogs: list[Sheepdog],
    seen: Callable[[Sheepdog, float], Sheepdog],
    arenas: Iterable[float],
) -> dict[str, dict[str, Any]]:
    """Fly sheepdogs through the 30 cases in each arena; the row of figures of all, by arena."""
    rows = {}
    for arena in arenas:
        world = furthest_first(preset("paper", arena))
        starts = shipped(world, "paper")
        flown = [
            evaluate.measure(fly(world, seen(dog, arena), starts, MAX_STEPS, None))
            for dog in sheepdogs
        ]
        together = {name: np.concatenate([one[name] for one in flown]) for name in flown[0]}
        rows[f"{arena:g}"] = evaluate.figures(together)
    return rows
