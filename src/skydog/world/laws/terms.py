"""The terms that laws are made of: escape, avoid, group, noise (paper, Eqs 1 to 5)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.world.neighbours import A_FEW, ALL_PAIRS, pushes
from skydog.world.vectors import PerSheep, column, norm, unit


class Weighted(eqx.Module):
    """The parameters of the terms. Lengths in metres, weights dimensionless.

    Each is one number, or one per sheep (shape `(sheep,)`).
    """

    avoidance: PerSheep  # R_ππ: sheep nearer than this push each other away
    sensing: PerSheep  # R_πβ: a sheep sees a dog that is nearer than this
    inertia: PerSheep  # W_πυ: weight of the previous step's force
    grouping: PerSheep  # W_πΛ: weight of the pull to the local centre of mass
    escape: PerSheep  # W_πβ: weight of the push away from dogs
    repulsion: PerSheep  # W_ππ: weight of the push away from other sheep
    noise: PerSheep = 0.0  # weight of a random unit vector (Strömbom 2014: e)

    @property
    def noisy(self) -> bool:
        """Whether the law draws random numbers."""
        return bool(np.any(self.noise))


def sees(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], sensing: PerSheep
) -> Bool[Array, "sheep dogs"]:
    """Which dog is within R_πβ metres of which sheep (paper, Eq. 1)."""
    return norm(sheep[:, None] - dogs[None, :]) <= column(sensing, len(sheep))


def escape(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], sensing: PerSheep
) -> Float[Array, "sheep 2"]:
    """The push away from every dog in sight (paper, Eq. 2).

    `sensing` is R_πβ in metres. Returns the sum of unit vectors pointing away from
    each dog within it: dimensionless, and zero for a sheep that sees none.
    """
    away = sheep[:, None] - dogs[None, :]
    seen = sees(sheep, dogs, sensing)
    return jnp.sum(jnp.where(seen[..., None], unit(away), 0.0), axis=1)


def avoid(sheep: Float[Array, "sheep 2"], avoidance: PerSheep) -> Float[Array, "sheep 2"]:
    """The push away from every sheep that is too near (paper, Eqs 3 and 4).

    `avoidance` is R_ππ in metres. Returns the sum of unit vectors pointing away from each
    sheep within it. Two sheep at one point do not push each other, since no direction is defined.
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


def random_directions(key: PRNGKeyArray, like: Float[Array, "sheep 2"]) -> Float[Array, "sheep 2"]:
    """A unit vector for each sheep, all directions alike (Strömbom 2014's error term)."""
    return unit(jax.random.normal(key, like.shape))
