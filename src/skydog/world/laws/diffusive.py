"""Targets that do not hold together: each diffuses, and only dogs push it (Lama, di Bernardo)."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.state import State
from skydog.world.vectors import PerSheep, column


class DiffusiveFlock(eqx.Module):
    """Lama & di Bernardo 2024 (Phys. Rev. Research; arXiv 2307.16797), Eq. 1.

    A dog at a distance d below `sensing` pushes a sheep away with `strength` (λ - d), and every
    sheep walks at random. Sheep neither see nor push each other. The force is a velocity in m/s,
    for sheep whose `speed` is 1.
    """

    sensing: PerSheep  # λ, metres
    strength: PerSheep  # k, 1/s; β in the paper
    # SD of each component of a random velocity, m/s: `diffusing` gives it for D and a time step.
    noise: PerSheep

    @property
    def noisy(self) -> bool:
        """Whether the law draws random numbers."""
        return bool(np.any(self.noise))

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The push of all dogs within λ, and the random velocity.

        A dog and a sheep at one point do not push, since no direction is defined.
        """
        count = len(state.sheep)
        # Dogs first, and each coordinate by itself: seven times as fast, where herds are long.
        x, y = (state.sheep[:, axis] - state.dogs[:, axis, None] for axis in (0, 1))
        squared = x * x + y * y
        distance = jnp.sqrt(jnp.where(squared == 0.0, 1.0, squared))
        reach = jnp.ravel(column(self.sensing, count)) - distance
        push = jnp.maximum(reach, 0.0) / distance
        total = jnp.stack([jnp.sum(push * x, axis=0), jnp.sum(push * y, axis=0)], axis=1)
        force = column(self.strength, count) * total
        if key is None:
            return force
        return force + column(self.noise, count) * jax.random.normal(key, force.shape)


def diffusing(diffusion: float, dt: float) -> float:
    """The `noise` by which sheep diffuse: √(2D/dt), in m/s.

    `diffusion` is D in m²/s: in a time t the mean square of each coordinate grows by 2Dt
    (Euler-Maruyama). `dt` is the world's time step in seconds.
    """
    return math.sqrt(2.0 * diffusion / dt)
