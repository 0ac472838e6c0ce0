"""Toys that any learner must solve: tasks whose best policy is known."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from skydog.learning import ddpg
from skydog.learning.lessons import Outcome

# Small and quick: the paper's rates take ten times as long, whatever the task.
QUICK = ddpg.Config(
    actor=(16,),
    critic=(32,),
    actor_rate=1e-3,
    critic_rate=3e-3,
    memory=2_000,
    tau=0.02,
    sigma=0.3,
)


class Bandit(eqx.Module):
    """One step an episode: sees x in [-1, 1], pays most for the action 0.6 x."""

    observation: ClassVar[int] = 1
    action: ClassVar[int] = 1

    def start(self, key) -> Array:
        return jax.random.uniform(key, (1,), minval=-1.0, maxval=1.0)

    def observe(self, episode: Array) -> Array:
        return episode

    def step(self, episode: Array, action: Array) -> tuple[Array, Outcome]:
        error = jnp.abs(action - 0.6 * episode)[0]
        yes = jnp.asarray(True)
        return episode, Outcome(-error, yes, ~yes, error < 0.1)


class Walk(eqx.Module):
    """A point in the plane: sees where it is, is paid the metres gained on the origin."""

    observation: ClassVar[int] = 2
    action: ClassVar[int] = 2
    horizon: ClassVar[int] = 20

    def start(self, key) -> tuple[Array, Array]:
        return jax.random.uniform(key, (2,), minval=-1.0, maxval=1.0), jnp.asarray(0)

    def observe(self, episode: tuple[Array, Array]) -> Array:
        return episode[0]

    def step(self, episode: tuple[Array, Array], action: Array):
        position, step = episode
        after = position + 0.1 * action
        away = jnp.linalg.norm(after)
        gained = jnp.linalg.norm(position) - away
        done, near = step + 1 >= self.horizon, away < 0.2
        return (after, step + 1), Outcome(gained, jnp.asarray(False), done, near)


class Count(eqx.Module):
    """Sees the step's number; ends by itself after `ends`, or is cut off after `cut`."""

    ends: int = 99
    cut: int = 99
    observation: ClassVar[int] = 1
    action: ClassVar[int] = 1

    def start(self, key) -> Array:
        return jnp.asarray(0.0)

    def observe(self, episode: Array) -> Array:
        return episode[None]

    def step(self, episode: Array, action: Array) -> tuple[Array, Outcome]:
        after = episode + 1.0
        ended, cut = after >= self.ends, after >= self.cut
        return after, Outcome(after, ended, cut & ~ended, ended)
