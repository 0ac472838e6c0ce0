"""Missions to look at, flown once for all tests of this room."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp

from skydog.shepherds.strombom import Strombom
from skydog.study import cases
from skydog.world import mission
from skydog.world.presets import preset
from skydog.world.trace import ENDINGS, Ending, Poses, Trace


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


def posed(trace: Trace, how: str = "accomplished") -> Trace:
    """The mission as if by bodies with physics: dogs climb to 1.5 m and sway, sheep turn left.

    The second dog sways the other way.
    """
    time, sheep, dogs = trace.time[:, None], trace.sheep.shape[1], trace.dogs.shape[1]
    side = jnp.where(jnp.arange(dogs) % 2, -1.0, 1.0)
    roll = jnp.radians(12.0) * jnp.sin(time) * side
    pitch = jnp.radians(-8.0) * jnp.cos(time) * side
    height = jnp.full((len(time), dogs), 1.5)
    poses = Poses(
        altitude=height * (1.0 - jnp.exp(-time)),
        attitude=jnp.stack([roll, pitch, jnp.zeros_like(roll)], -1),
        setpoint=jnp.stack([trace.dogs[..., 0], trace.dogs[..., 1], height], -1),
        yaw=(0.5 * time + jnp.arange(sheep) + jnp.pi) % (2 * jnp.pi) - jnp.pi,
        speed=jnp.zeros((len(time), sheep)),
        turn_rate=jnp.full((len(time), sheep), 0.5),
    )
    ending = Ending(how=jnp.asarray(ENDINGS.index(how)), steps=jnp.asarray(len(time) - 1))
    return replace(trace, poses=poses, ending=ending)
