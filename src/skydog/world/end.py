"""When a mission is accomplished."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from skydog.world import herding
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm


class AllHome(eqx.Module):
    """Every sheep is within 𝔻 of the goal, and the flock gathered (paper, Eq. 12).

    Gathered within f(N), by the world's `spread`, as for the gate.
    """

    def accomplished(self, world: World, state: State) -> Bool[Array, ""]:
        """Whether the mission is accomplished in this state."""
        home = norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius
        return jnp.all(home) & herding.gathered(world, state.sheep)


class ShareHome(eqx.Module):
    """A share of the sheep is within 𝔻 of the goal, wherever the others are.

    Lama & di Bernardo 2024 count a herd as captured from a share χ of 0.99 on, which is every
    sheep of fewer than 100. El-Fiqi et al. 2020 ask for every sheep: a share of 1.
    """

    share: Scalar = 0.99

    def accomplished(self, world: World, state: State) -> Bool[Array, ""]:
        """Whether the mission is accomplished in this state."""
        home = norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius
        # A little less, so that rounding cannot ask for one sheep more.
        return jnp.sum(home) >= self.share * len(state.sheep) - 1e-3
