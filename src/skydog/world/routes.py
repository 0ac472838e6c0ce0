"""The ways of dogs that cannot fly above obstacles: straight from corner to corner of them."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.sparse import csgraph

from skydog.errors import Refusal
from skydog.world import obstacles as obstacle
from skydog.world.obstacles import Obstacles
from skydog.world.vectors import norm

AROUND = 8  # corners about each end of an obstacle
MOST_CORNERS = 1_000  # the distances between all of them are kept
# Of radii: so far inside its rim a way may graze an obstacle, since a dog slides along it.
GRAZE = 1e-3
# A corner that a dog has reached must not hold it: of two equal ways it takes the longer first leg.
ONWARD = 1e-3


class Routes(eqx.Module):
    """Corners of obstacles, and how far it is from each to each other. Metres."""

    corners: Float[Array, "*batch corners 2"]
    apart: Float[Array, "*batch corners corners"]  # infinite where there is no way

    def waypoint(
        self, walls: Obstacles, dogs: Float[Array, "dogs 2"], targets: Float[Array, "dogs 2"]
    ) -> Float[Array, "dogs 2"]:
        """Where each dog goes straight to, on the shortest way to its target.

        That is the target itself, if it is in sight. One that lies within an obstacle is moved to
        its rim. A dog without any way goes straight to its target too.
        """
        targets = obstacle.outside(walls, targets)
        return jax.vmap(lambda dog, target: self._next(walls, dog, target))(dogs, targets)

    def _next(
        self, walls: Obstacles, dog: Float[Array, "2"], target: Float[Array, "2"]
    ) -> Float[Array, "2"]:
        first, last = (
            jnp.where(in_sight(walls, self.corners, end), norm(self.corners - end), jnp.inf)
            for end in (dog, target)
        )
        ways = (1.0 - ONWARD) * first + jnp.min(self.apart + last, axis=1)
        corner = jnp.argmin(ways)
        straight = in_sight(walls, dog[None], target)[0] | ~jnp.isfinite(ways[corner])
        return jnp.where(straight, target, self.corners[corner])


def in_sight(
    walls: Obstacles, places: Float[Array, "some 2"], of: Float[Array, "2"]
) -> Bool[Array, " some"]:
    """From which places the straight way to another meets no obstacle."""
    # `passed` tells of ways deeper than half into an obstacle.
    wide = Obstacles(walls.ends, 2.0 * (1.0 - GRAZE) * walls.radius)
    return ~obstacle.passed(wide, places, jnp.broadcast_to(of, places.shape))


def solve(walls: Obstacles, margin: float, least: float, most: tuple[float, float]) -> Routes:
    """The routes around obstacles that round their corners at `margin` metres or a little more.

    Corners lie from `least` to `most`, x and y in metres. Raises `Refusal` for too many of them.
    """
    angle = 2 * math.pi / AROUND * np.arange(AROUND)
    # The chord between two neighbouring corners keeps outside too.
    reach = np.asarray(walls.radius, float) / math.cos(math.pi / AROUND) + margin
    rim = reach[:, None, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    about = (np.asarray(walls.ends, float)[:, :, None] + rim).reshape(-1, 2)
    about = np.unique(np.round(about, 6), axis=0)
    about = about[np.all((about >= least) & (about <= most), axis=1)]
    corners = jnp.asarray(about, jnp.float32)
    corners = corners[obstacle.clearance(walls, corners) > 0.5 * margin]
    if max(len(corners), len(walls.radius)) > MOST_CORNERS:
        raise Refusal(
            f"{len(walls.radius):,} obstacles have {len(corners):,} corners, too many for dogs to "
            "go around; leave out dogs = 'around'"
        )
    seen = np.array([np.asarray(_seen(walls, corners, corner)) for corner in corners], bool)
    straight = np.linalg.norm(np.asarray(corners)[:, None] - np.asarray(corners), axis=-1)
    graph = np.where(seen.reshape(straight.shape), straight, 0.0)  # 0: no edge
    apart = csgraph.shortest_path(graph, directed=False) if len(corners) else straight
    return Routes(corners, jnp.asarray(apart, jnp.float32))


_seen = eqx.filter_jit(in_sight)
