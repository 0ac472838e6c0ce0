"""What dogs see of the flock: within a radius, in a field of view, behind nothing."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world import obstacles
from skydog.world.obstacles import Obstacles
from skydog.world.vectors import Scalar, norm, unit


class Sight(eqx.Module):
    """How far and how wide a dog sees. What one dog sees, all know: the base station pools it.

    A dog's camera turns to where the flock's centre was last known to be. Obstacles that a dog has
    to go around hide what is behind them; those that it flies above do not. Ours.
    """

    radius: Scalar  # a dog sees sheep that are nearer than this, metres
    field: Scalar = 2 * math.pi  # the whole angle that its camera sees, radians
    body: Scalar = 0.0  # a sheep hides what is behind it, this far to each side, metres; 0 is off


def seen(
    sight: Sight,
    sheep: Float[Array, "sheep 2"],
    dogs: Float[Array, "dogs 2"],
    known: Float[Array, "sheep 2"],
    walls: Obstacles | None,
) -> Bool[Array, " sheep"]:
    """Which sheep any dog sees. `known` is where they were last seen: the cameras turn there."""
    away = sheep[None, :] - dogs[:, None]
    distance = norm(away)
    ahead = unit(jnp.mean(known, axis=0) - dogs)
    # A dog right above the centre looks around itself.
    cosine = jnp.sum(unit(away) * ahead[:, None], axis=-1)
    around = (norm(ahead)[:, None] == 0.0) | (distance == 0.0) | (sight.field >= 2 * math.pi)
    sees = (distance <= sight.radius) & (around | (cosine >= jnp.cos(0.5 * sight.field)))
    sees &= ~_behind_another(away, distance, sight.body)
    if walls is not None and walls.tall:
        hidden = [
            obstacles.passed(walls, jnp.broadcast_to(dog, sheep.shape), sheep) for dog in dogs
        ]
        sees &= ~jnp.stack(hidden)
    return jnp.any(sees, axis=0)


def _behind_another(
    away: Float[Array, "dogs sheep 2"], distance: Float[Array, "dogs sheep"], body: Scalar
) -> Bool[Array, "dogs sheep"]:
    """Whether a sheep that is nearer by `body` is within `body` of the line from a dog to one."""
    line = unit(away)[:, :, None]  # to the one that is looked for
    other = away[:, None, :]
    along = jnp.sum(line * other, axis=-1)
    aside = jnp.abs(line[..., 0] * other[..., 1] - line[..., 1] * other[..., 0])
    before = (along > 0.0) & (along < distance[:, :, None] - body) & (aside < body)
    return jnp.any(before & ~jnp.eye(distance.shape[1], dtype=bool), axis=-1)
