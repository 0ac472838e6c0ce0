"""The rule dog of Strömbom et al. 2014 (paper, Eqs 8 and 9)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.shepherds.options import AtPoint
from skydog.world import herding
from skydog.world.mission import fastest, limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, limit, norm


class Strombom(eqx.Module):
    """Flies straight to the subgoal, as fast as the world's dogs may.

    `at_point` is "constant" for a dog that always flies at full speed and overshoots, as in
    Strömbom's model, or "arrive" for one that shortens its last step and stops. `speed`, in m/s,
    limits the length of the velocity further. While a sheep is nearer than the world's
    `dog.stall`, the dog hovers.
    """

    at_point: AtPoint = eqx.field(static=True, default="constant")
    speed: Scalar = jnp.inf

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        subgoal, _ = herding.gate(world, state.sheep, state.dogs)
        way = subgoal - state.dogs
        velocity = fastest(world.dog, way)
        if self.at_point == "arrive":
            there = way / world.arena.dt
            velocity = jnp.where(norm(there)[:, None] < norm(velocity)[:, None], there, velocity)
        nearest = jnp.min(norm(state.dogs[:, None] - state.sheep[None, :]), axis=1)
        velocity = jnp.where(nearest[:, None] < world.dog.stall, 0.0, velocity)
        return limited(world.dog, limit(velocity, self.speed))
