"""Who is near whom: all pairs for small flocks, cells for large ones; the same to rounding."""

import warnings
from functools import cache
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from skydog.world.vectors import PerSheep, column, norm, unit

A_FEW = 30  # sheep up to which pairs as vectors are the fastest
ALL_PAIRS = 300  # sheep up to which all pairs at once are
BLOCK = 64  # sheep whose pairs with all others are in memory at a time, where cells are missing


def pushes(sheep: Float[Array, "sheep 2"], radius: PerSheep) -> Float[Array, "sheep 2"]:
    """For each sheep the sum of unit vectors away from every other within `radius` metres.

    With a radius per sheep, each is pushed by those within its own. Chooses the fastest means:
    all pairs up to `ALL_PAIRS` sheep; beyond that cells, on a CPU with numba; else all pairs,
    block by block.
    """
    column(radius, len(sheep))  # refuses a shape that would broadcast along the wrong axis
    if len(sheep) <= A_FEW:
        return all_pairs(sheep, sheep, radius)
    if len(sheep) <= ALL_PAIRS:
        return by_coordinate(sheep, sheep, radius)
    if jax.default_backend() == "cpu" and compiled():
        return cells(sheep, radius)
    return blocks(sheep, radius)


def all_pairs(
    sheep: Float[Array, "some 2"], others: Float[Array, "others 2"], radius: PerSheep
) -> Float[Array, "some 2"]:
    """The pushes on some sheep, every pair looked at: time and memory grow as their product."""
    away = sheep[:, None] - others[None, :]
    near = norm(away) <= column(radius, len(sheep))
    return jnp.sum(jnp.where(near[..., None], unit(away), 0.0), axis=1)


def by_coordinate(
    sheep: Float[Array, "some 2"], others: Float[Array, "others 2"], radius: PerSheep
) -> Float[Array, "some 2"]:
    """`all_pairs`, one coordinate at a time: five times as fast for some hundred sheep.

    XLA vectorises over the sheep, which stand along the last axis.
    """
    x, y = sheep.T[:, None, :] - others.T[:, :, None]
    squared = x * x + y * y
    near = (squared > 0.0) & (jnp.sqrt(squared) <= radius)
    distance = jnp.sqrt(jnp.where(near, squared, 1.0))
    push = [jnp.sum(jnp.where(near, along / distance, 0.0), axis=0) for along in (x, y)]
    return jnp.stack(push, axis=-1)


def blocks(sheep: Float[Array, "sheep 2"], radius: PerSheep) -> Float[Array, "sheep 2"]:
    """The pushes, every pair looked at, in memory that grows only as the flock does."""
    reach = jnp.broadcast_to(jnp.asarray(radius), len(sheep))

    def push(one: tuple[Float[Array, "2"], Float[Array, ""]]) -> Float[Array, "2"]:
        place, radius = one
        return by_coordinate(place[None], sheep, radius)[0]

    return jax.lax.map(push, (sheep, reach), batch_size=BLOCK)


def cells(sheep: Float[Array, "sheep 2"], radius: PerSheep) -> Float[Array, "sheep 2"]:
    """The pushes, only neighbours looked at: time grows as the flock does, at one density.

    A packed herd, every sheep in one cell, is slower, never wrong. Not differentiable.
    """
    shape = jax.ShapeDtypeStruct(sheep.shape, jnp.float32)
    reach = jnp.asarray(radius, jnp.float32)
    return jax.pure_callback(_pushes, shape, sheep, reach, vmap_method="sequential")


@cache
def compiled() -> ModuleType | None:
    """The compiled cells; None, with a note, where numba is missing."""
    try:
        from skydog.world import cells
    except ImportError:
        warnings.warn(
            f"flocks of more than {ALL_PAIRS} sheep are slow without numba; "
            "run: pip install 'skydog[fast]'",
            stacklevel=2,
        )
        return None
    return cells


def _pushes(sheep: Array, radius: Array) -> np.ndarray:
    kernel = compiled()
    assert kernel is not None
    reach = np.asarray(radius, np.float32)
    each = np.full(len(sheep), reach) if reach.ndim == 0 else reach
    return kernel.pushes(np.asarray(sheep), each)
