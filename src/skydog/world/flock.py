"""How sheep move: escape, avoid, group, inertia (paper, Eqs 1 to 6)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.world.neighbours import A_FEW, ALL_PAIRS, pushes
from skydog.world.params import Flock
from skydog.world.vectors import Scalar, norm, unit


def sees(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], sensing: Scalar
) -> Bool[Array, "sheep dogs"]:
    """Which dog is within R_πβ metres of which sheep (paper, Eq. 1)."""
    return norm(sheep[:, None] - dogs[None, :]) <= sensing


def escape(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], sensing: Scalar
) -> Float[Array, "sheep 2"]:
    """The push away from every dog in sight (paper, Eq. 2).

    `sensing` is R_πβ in metres. Returns the sum of unit vectors pointing away from
    each dog within it: dimensionless, and zero for a sheep that sees none.
    """
    away = sheep[:, None] - dogs[None, :]
    seen = sees(sheep, dogs, sensing)
    return jnp.sum(jnp.where(seen[..., None], unit(away), 0.0), axis=1)


def avoid(sheep: Float[Array, "sheep 2"], avoidance: Scalar) -> Float[Array, "sheep 2"]:
    """The push away from every sheep that is too near (paper, Eqs 3 and 4).

    `avoidance` is R_ππ in metres. Returns the sum of unit vectors pointing away from each
    sheep within it. Two sheep at one point do not push each other: no direction is theirs.
    """
    return pushes(sheep, avoidance)


def group(sheep: Float[Array, "sheep 2"], neighbours: int | None) -> Float[Array, "sheep 2"]:
    """The pull to the local centre of mass (paper, Eq. 5): a unit vector for each sheep.

    The paper does not define the neighbourhood; Strömbom's is the `neighbours` nearest
    flockmates, and None is all of them. A lone sheep feels no pull.
    """
    flockmates = sheep.shape[0] - 1
    if flockmates == 0:
        return jnp.zeros_like(sheep)
    if neighbours is None or neighbours >= flockmates:
        # Summed as differences, so that for sheep at one point it is exactly zero.
        if len(sheep) <= A_FEW:
            return unit(jnp.sum(sheep[None, :] - sheep[:, None], axis=1))
        away = sheep - sheep[0]
        return unit(jnp.sum(away, axis=0) - len(sheep) * away)

    def pull(number: Int[Array, ""]) -> Float[Array, "2"]:
        distance = norm(sheep - sheep[number]).at[number].set(jnp.inf)
        _, nearest = jax.lax.top_k(-distance, neighbours)
        return unit(jnp.sum(sheep[nearest] - sheep[number], axis=0))

    return jax.lax.map(pull, jnp.arange(len(sheep)), batch_size=ALL_PAIRS)


def force(
    flock: Flock,
    sheep: Float[Array, "sheep 2"],
    dogs: Float[Array, "dogs 2"],
    previous: Float[Array, "sheep 2"],
    key: PRNGKeyArray | None = None,
) -> Float[Array, "sheep 2"]:
    """The total force on each sheep (paper, Eq. 6), which its step follows (Eq. 11).

    `previous` is the force of the step before (the inertia term). By default each term and
    the sum are normalised, as in Strömbom 2014, so that a sheep moves at its full speed or
    stands; grouping and escape act on sheep that see a dog, and inertia carries no sheep
    that nothing pushes. With `flock.literal_forces` the equations are taken as printed.
    `key` draws the noise; None is a world without any.
    """
    flee = escape(sheep, dogs, flock.sensing)
    crowd = avoid(sheep, flock.avoidance)
    pull = group(sheep, flock.neighbours)
    if flock.literal_forces:
        total = flock.inertia * previous + flock.grouping * pull
        total = total + flock.escape * flee + flock.repulsion * crowd
        return total if key is None else total + flock.noise * _random_directions(key, sheep)

    afraid = jnp.any(sees(sheep, dogs, flock.sensing), axis=1, keepdims=True)
    crowded = jnp.any(crowd != 0.0, axis=1, keepdims=True)
    total = flock.inertia * previous + flock.repulsion * unit(crowd)
    total = total + jnp.where(afraid, flock.grouping * pull + flock.escape * unit(flee), 0.0)
    if key is None:
        return unit(jnp.where(afraid | crowded, total, 0.0))
    noisy, grazing, direction = jax.random.split(key, 3)
    total = total + flock.noise * _random_directions(noisy, sheep)
    grazes = jax.random.bernoulli(grazing, flock.graze, afraid.shape)
    idle = jnp.where(grazes, _random_directions(direction, sheep), 0.0)
    return unit(jnp.where(afraid | crowded, total, idle))


def _random_directions(key: PRNGKeyArray, like: Float[Array, "sheep 2"]) -> Float[Array, "sheep 2"]:
    return unit(jax.random.normal(key, like.shape))
