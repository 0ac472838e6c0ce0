"""The terms that laws are made of: those of the paper (Eqs 1 to 5), and of others."""

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
        nearest = _nearest(sheep, number, neighbours)
        return unit(jnp.sum(sheep[nearest] - sheep[number], axis=0))

    return jax.lax.map(pull, jnp.arange(len(sheep)), batch_size=ALL_PAIRS)


def align(
    sheep: Float[Array, "sheep 2"], moved: Float[Array, "sheep 2"], neighbours: int | None
) -> Float[Array, "sheep 2"]:
    """The mean direction in which flockmates moved: a unit vector for each sheep.

    `moved` is the force of the step before, of which only the direction counts. Vicsek et al.
    1995 for particles; Jadhav et al. 2024 for sheep, in whose model a sheep copies one of its
    nearest flockmates at random. Here it is the mean of the `neighbours` nearest, and None is
    all of them. Zero where they stand, and for a lone sheep.
    """
    headings, flockmates = unit(moved), len(sheep) - 1
    if neighbours is None or neighbours >= flockmates:
        # The few are summed without the sheep itself: those that cancel are then exactly zero.
        if len(sheep) <= A_FEW:
            others = ~jnp.eye(len(sheep), dtype=bool)[..., None]
            return unit(jnp.sum(jnp.where(others, headings[None, :], 0.0), axis=1))
        return unit(jnp.sum(headings, axis=0) - headings)

    def mean(number: Int[Array, ""]) -> Float[Array, "2"]:
        return unit(jnp.sum(headings[_nearest(sheep, number, neighbours)], axis=0))

    return jax.lax.map(mean, jnp.arange(len(sheep)), batch_size=ALL_PAIRS)


def follow(
    sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"], sensing: PerSheep
) -> Float[Array, "sheep 2"]:
    """The pull to every dog in sight, of sheep that take a dog for their leader.

    The inverse of `escape`, as in the mixed flocks of Strömbom et al. 2026 (ANTS), where the
    sheep that follow do not group.
    """
    return -escape(sheep, dogs, sensing)


def fading_escape(
    sheep: Float[Array, "sheep 2"],
    dogs: Float[Array, "dogs 2"],
    sensing: PerSheep,
    fading: PerSheep,
) -> Float[Array, "sheep 2"]:
    """`escape` from dogs, each of which pushes the less the further it is.

    A dog at the distance d pushes with exp(-μ d / R_πβ), where μ is `fading`: El-Fiqi et al.
    2020, who have 2, and whose push is also proportional to the dog's speed.
    """
    push, _ = _fading_pushes(sheep, dogs, sensing, fading)
    return push


def fading_avoid(
    sheep: Float[Array, "sheep 2"], avoidance: PerSheep, fading: PerSheep
) -> Float[Array, "sheep 2"]:
    """`avoid` of n sheep, each of which pushes with exp(-μ d / R_ππ) / √n (El-Fiqi et al. 2020)."""
    push, count = _fading_pushes(sheep, sheep, avoidance, fading)
    return push / jnp.sqrt(jnp.maximum(count, 1))


def random_directions(key: PRNGKeyArray, like: Float[Array, "sheep 2"]) -> Float[Array, "sheep 2"]:
    """A unit vector for each sheep, all directions alike (Strömbom 2014's error term)."""
    return unit(jax.random.normal(key, like.shape))


def _nearest(
    sheep: Float[Array, "sheep 2"], number: Int[Array, ""], neighbours: int
) -> Int[Array, " neighbours"]:
    """The numbers of the sheep that are nearest to one."""
    distance = norm(sheep - sheep[number]).at[number].set(jnp.inf)
    return jax.lax.top_k(-distance, neighbours)[1]


def _fading_pushes(
    sheep: Float[Array, "sheep 2"],
    others: Float[Array, "others 2"],
    radius: PerSheep,
    fading: PerSheep,
) -> tuple[Float[Array, "sheep 2"], Int[Array, "sheep 1"]]:
    """The sum of pushes that fade with distance, and of how many; none from one at one point."""

    def pushes(
        one: tuple[Float[Array, "2"], Float[Array, " 1"], Float[Array, " 1"]],
    ) -> tuple[Float[Array, "2"], Int[Array, " 1"]]:
        place, reach, rate = one
        away = place - others
        distance = norm(away)
        near = (distance <= reach) & (distance > 0.0)
        shares = distance / jnp.where(reach > 0.0, reach, 1.0)
        strength = jnp.where(near, jnp.exp(-rate * shares), 0.0)
        return jnp.sum(strength[:, None] * unit(away), axis=0), jnp.sum(near, keepdims=True)

    count = len(sheep)
    reach, rate = (
        jnp.broadcast_to(jnp.asarray(column(value, count), sheep.dtype), (count, 1))
        for value in (radius, fading)
    )
    return jax.lax.map(pushes, (sheep, reach, rate), batch_size=ALL_PAIRS)
