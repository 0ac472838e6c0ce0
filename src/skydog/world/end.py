"""When a mission is accomplished."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from skydog.world import herding
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import norm


class AllHome(eqx.Module):
    """Every sheep is within 𝔻 of the goal, and the flock gathered (paper, Eq. 12).

    Gathered within f(N), by the world's `spread`, as for the gate.
    """

    def accomplished(self, world: World, state: State) -> Bool[Array, ""]:
        """Whether the mission is accomplished in this state."""
        home = norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius
        return jnp.all(home) & herding.gathered(world, state.sheep)


class AllAtGoal(eqx.Module):
    """Every sheep is within 𝔻 of the goal, gathered or not (El-Fiqi et al. 2020)."""

    def accomplished(self, world: World, state: State) -> Bool[Array, ""]:
        """Whether the mission is accomplished in this state."""
        home = norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius
        return jnp.all(home)
