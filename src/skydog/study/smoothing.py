"""A flock's law with smooth radii, over many moves at once: differentiable in every parameter.

A hard radius has no gradient: who is near changes by a jump. Here a sigmoid says how near.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.world.laws import terms
from skydog.world.laws.varied import VariedFlock
from skydog.world.state import State
from skydog.world.vectors import PerSheep, Scalar, norm, unit

FAR = 1e9  # metres: where a sheep is from itself, so that it is never near


class Surroundings(eqx.Module):
    """What no parameter changes of the states of a flock.

    Distances in metres and unit vectors; the moves stand along the last axis, over which XLA
    vectorises.
    """

    distance: Float[Array, "others sheep *moves"]
    away: Float[Array, "2 others sheep *moves"]
    dog_distance: Float[Array, "dogs sheep *moves"]
    from_dogs: Float[Array, "2 dogs sheep *moves"]
    pull: Float[Array, "2 sheep *moves"]
    mean: Float[Array, "2 sheep *moves"]  # the flockmates' direction
    before: Float[Array, "2 sheep *moves"]  # the force of the step before


@jax.jit
def surroundings(states: State) -> Surroundings:
    """The surroundings in states, stacked along the first axis, of flocks without `neighbours`."""

    def one(state: State) -> Surroundings:
        sheep, dogs = state.sheep, state.dogs
        away, from_dogs = sheep - sheep[:, None], sheep - dogs[:, None]
        return Surroundings(
            distance=norm(away) + FAR * jnp.eye(len(sheep)),
            away=jnp.moveaxis(unit(away), -1, 0),
            dog_distance=norm(from_dogs),
            from_dogs=jnp.moveaxis(unit(from_dogs), -1, 0),
            pull=terms.group(sheep, None).T,
            mean=terms.align(sheep, state.force, None).T,
            before=state.force.T,
        )

    return jax.vmap(one, out_axes=-1)(states)


def smoothed_force(
    flock: VariedFlock, around: Surroundings, softness: Scalar
) -> Float[Array, "2 sheep moves"]:
    """`flock.force` without noise, its radii smoothed over `softness` of their length.

    The smaller the softness, the nearer to the force itself. The flock has one number for each
    parameter, and neither `follow`, `fading` nor `neighbours`.
    """
    near, crowded = _near(around.distance, flock.avoidance, softness)
    seen, afraid = _near(around.dog_distance, flock.sensing, softness)
    crowd = _unit(jnp.sum(near * around.away, axis=1)) * crowded
    fear = flock.escape * _unit(jnp.sum(seen * around.from_dogs, axis=1))
    fear = fear + flock.grouping * around.pull
    if flock.alignment is not None:
        fear = fear + flock.alignment * around.mean
    total = flock.inertia * around.before + flock.repulsion * crowd + afraid * fear
    return _unit(jnp.asarray(total)) * (1.0 - (1.0 - afraid) * (1.0 - crowded))


def _near(distance: Array, radius: PerSheep, softness: Scalar) -> tuple[Array, Array]:
    """How near each is, from 0 to 1, and how near any: 1 - Π (1 - near)."""
    within = (1.0 - distance / radius) / softness
    return jax.nn.sigmoid(within), 1.0 - jnp.exp(-jnp.sum(jax.nn.softplus(within), axis=0))


def _unit(v: Array) -> Array:
    """`vectors.unit`, with the coordinates along the first axis."""
    return jnp.moveaxis(unit(jnp.moveaxis(v, 0, -1)), -1, 0)
