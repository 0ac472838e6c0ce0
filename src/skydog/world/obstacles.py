"""Obstacles: walls and discs, as capsules that nobody on the ground passes."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world.vectors import Scalar, norm, unit

MOST_OBSTACLES = 10_000  # of a world that is read from a file
# Who is pushed out of an obstacle stands so far outside it: in its radii, and in shares of the
# distance from the origin, since float32 rounds what is far out.
SKIN, ROUNDING = 1e-4, 1e-6


class Obstacles(eqx.Module):
    """Capsules: all points nearer than `radius` to a line segment. Metres.

    A segment of no length makes a disc. Any number of them, each with a radius above 0.
    """

    ends: Float[Array, "*batch obstacles 2 2"]  # both ends of each segment, x and y
    radius: Float[Array, "*batch obstacles"]
    # Whether dogs have to go around too; else they fly above.
    tall: bool = eqx.field(static=True, default=False)


def away(
    obstacles: Obstacles, position: Float[Array, "some 2"]
) -> tuple[Float[Array, "some obstacles"], Float[Array, "some obstacles 2"]]:
    """How far each position is outside each obstacle, in metres, and the unit vector out of it.

    Negative inside. On a segment itself there is no way out: the vector is zero.
    """
    first, last = obstacles.ends[:, 0], obstacles.ends[:, 1]
    off = position[:, None] - _nearest(first, last, position[:, None])
    return norm(off) - obstacles.radius, unit(off)


def clearance(obstacles: Obstacles, position: Float[Array, "some 2"]) -> Float[Array, " some"]:
    """How far each position is outside the nearest obstacle, in metres; negative inside."""
    return jnp.min(away(obstacles, position)[0], axis=1, initial=jnp.inf)


def outside(obstacles: Obstacles, position: Float[Array, "some 2"]) -> Float[Array, "some 2"]:
    """The positions, those inside an obstacle moved to the nearest place on its rim."""
    gap, out = away(obstacles, position)
    deepest = jnp.argmin(gap, axis=1)[:, None]
    into = jnp.minimum(jnp.take_along_axis(gap, deepest, axis=1), 0.0)
    normal = jnp.take_along_axis(out, deepest[..., None], axis=1)[:, 0]
    skin = SKIN * obstacles.radius[deepest] + ROUNDING * norm(position)[:, None]
    return position - jnp.where(into < 0.0, into - skin, 0.0) * normal


def moved(
    obstacles: Obstacles,
    before: Float[Array, "some 2"],
    after: Float[Array, "some 2"],
    least: Float[Array, "2"] | Scalar,
    most: Float[Array, "2"] | Scalar,
) -> Float[Array, "some 2"]:
    """Where those come to who want to move from `before` to `after`: they slide along obstacles.

    Twice out of the obstacle that they are deepest in, since in a corner the way out of one may
    lead into the next, and back into where they may be, from `least` to `most` (x and y). Who
    would then still be inside one, or has passed through one, stays.
    """
    if obstacles.radius.shape[-1] == 0:
        return after
    slid = jnp.clip(outside(obstacles, outside(obstacles, after)), least, most)
    stuck = clearance(obstacles, slid) < 0.0
    return jnp.where((stuck | passed(obstacles, before, slid))[:, None], before, slid)


def passed(
    obstacles: Obstacles, before: Float[Array, "some 2"], after: Float[Array, "some 2"]
) -> Bool[Array, " some"]:
    """Whether the straight way from `before` to `after` leads deeper than half into an obstacle."""
    first, last = obstacles.ends[:, 0], obstacles.ends[:, 1]
    start, end = before[:, None], after[:, None]
    apart = [
        norm(start - _nearest(first, last, start)),
        norm(end - _nearest(first, last, end)),
        norm(first - _nearest(start, end, first)),
        norm(last - _nearest(start, end, last)),
    ]
    nearest = jnp.min(jnp.stack(apart), axis=0)
    cross = _side(first, last, start) * _side(first, last, end) < 0.0
    cross &= _side(start, end, first) * _side(start, end, last) < 0.0
    return jnp.any(cross | (nearest < 0.5 * obstacles.radius), axis=1)


def _nearest(
    first: Float[Array, "*many 2"], last: Float[Array, "*many 2"], to: Float[Array, "*any 2"]
) -> Float[Array, "*all 2"]:
    """The point of each segment that is nearest to a position."""
    along = last - first
    length = jnp.sum(along * along, axis=-1)
    share = jnp.sum((to - first) * along, axis=-1) / jnp.where(length == 0.0, 1.0, length)
    return first + jnp.clip(share, 0.0, 1.0)[..., None] * along


def _side(
    first: Float[Array, "*many 2"], last: Float[Array, "*many 2"], of: Float[Array, "*any 2"]
) -> Float[Array, "*all"]:
    """Positive for a position on the left of the line from first to last, negative on its right."""
    along, off = last - first, of - first
    return along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0]
