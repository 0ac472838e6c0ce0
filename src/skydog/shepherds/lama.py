"""The herders of Lama & di Bernardo 2024: each chases the furthest target that is its own."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.world import herding
from skydog.world.mission import limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm, unit


class Lama(eqx.Module):
    """Lama & di Bernardo 2024 (arXiv 2307.16797), Eqs 2 to 5, for dogs that see everyone.

    A sheep belongs to the dog nearest to it. A dog chases the one of its sheep that is furthest
    from the goal: it flies to the point δ behind it (the world's `dog.collecting`), seen from the
    goal, at `gain` times the distance and within its limits. A dog without any sheep flies to the
    goal, and hovers in it. The choice is that of the paper's limit γ → ∞.
    """

    gain: Scalar = 5.0  # α, 1/s

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        goal = herding.goal(world.arena)
        outward = state.sheep - goal
        to_sheep = norm(state.dogs[:, None] - state.sheep[None, :])
        own = to_sheep <= jnp.min(to_sheep, axis=0)
        _, furthest = jax.lax.top_k(jnp.where(own, norm(outward), -jnp.inf), 1)
        behind = state.sheep + world.dog.collecting * unit(outward)
        chase = self.gain * (behind[furthest[:, 0]] - state.dogs)
        home = goal - state.dogs
        outside = norm(home)[:, None] >= world.arena.goal_radius
        idle = jnp.where(outside, world.dog.speed * unit(home), 0.0)
        return limited(world.dog, jnp.where(jnp.any(own, axis=1)[:, None], chase, idle))
