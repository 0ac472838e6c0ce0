"""Missions to look at, flown once for all tests of this room."""

from functools import cache

import jax

from skydog.shepherds.strombom import Strombom
from skydog.study import cases
from skydog.world import mission
from skydog.world.presets import preset
from skydog.world.trace import Trace


@cache
def herded() -> Trace:
    """A mission that is accomplished well before its 300 steps are over."""
    return flown(dogs=1, steps=300)


@cache
def two_dogs_cut_short() -> Trace:
    return flown(dogs=2, steps=20)


def flown(dogs: int, steps: int) -> Trace:
    world = preset("paper")
    starts = cases.cases(world, count=1, dogs=dogs)
    state = jax.tree.map(lambda every: every[0], starts)
    return jax.jit(mission.rollout, static_argnums=3)(world, Strombom(), state, steps)
