"""What the tests of missions share: compiled functions, a start, a shepherd, noisy worlds."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp

from skydog.world import herding, mission
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State

STEPS = 40  # of most rollouts here: each other number compiles again

step = jax.jit(mission.step)
gate = jax.jit(herding.gate)
accomplished = jax.jit(mission.accomplished)
reset = jax.jit(mission.reset, static_argnames=("sheep", "dogs"))
fly = jax.jit(mission.rollout, static_argnames="steps")


def with_(world: World, part: str, **changes) -> World:
    return replace(world, **{part: replace(getattr(world, part), **changes)})


class Constant(eqx.Module):
    """A shepherd that always commands the same, whatever it sees."""

    velocity: jax.Array

    def __call__(self, world: World, state: State) -> jax.Array:
        return jnp.broadcast_to(self.velocity, state.dogs.shape)


def a_start(seed=3, sheep=3, dogs=1, world=None):
    return reset(world or preset("paper"), jax.random.key(seed), sheep, dogs)


MANY = jax.random.split(jax.random.key(0), 4000)
PAPER = preset("paper")
BLURRED = with_(preset("paper"), "dog", perception_noise=0.5)
NOISY = with_(
    replace(PAPER, flock=StrombomFlock(**{**vars(PAPER.flock), "noise": 0.3}, graze=0.1)),
    "dog",
    actuation_noise=0.1,
    perception_noise=0.05,
)
