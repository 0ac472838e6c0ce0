"""What is seen of obstacles from a place, without a map: how far the way is free."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.world import obstacles
from skydog.world.obstacles import Obstacles
from skydog.world.vectors import Scalar

MARCHES = 12  # of a ray: steps as long as the way is free on all sides (Hart 1996)


def free(
    walls: Obstacles,
    sides: Float[Array, "2"] | Scalar,
    place: Float[Array, "2"],
    rays: Float[Array, "rays 2"],
    sight: Scalar,
) -> Float[Array, " rays"]:
    """How far the way from a place is free along each ray, in metres: `sight` at most.

    `rays` are unit vectors. The arena's walls are seen as the obstacles are. A ray that passes
    close by an obstacle may end there.
    """
    ends = jnp.where(rays < 0.0, 0.0, sides)
    along = jnp.where(rays == 0.0, jnp.inf, (ends - place) / jnp.where(rays == 0.0, 1.0, rays))
    most = jnp.clip(jnp.min(along, axis=-1), 0.0, sight)
    gone = jnp.zeros(len(rays))
    for _ in range(MARCHES):
        gap = obstacles.clearance(walls, place + gone[:, None] * rays)
        gone = jnp.minimum(gone + jnp.maximum(gap, 0.0), most)
    return gone
