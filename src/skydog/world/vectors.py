"""Vectors in the plane: safe at zero, with finite gradients everywhere."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from skydog.errors import Refusal

# A parameter: a plain number from a preset, or a traced scalar under jit and vmap.
Scalar = int | float | Float[Array, ""]

# A parameter of sheep: one number for the whole flock, or one number per sheep.
PerSheep = int | float | Num[Array, ""] | Num[Array, " sheep"] | Num[np.ndarray, " sheep"]


def norm(v: Float[Array, "*batch 2"]) -> Float[Array, "*batch"]:
    """Euclidean length, in the unit of `v`; its gradient at zero is zero, not NaN."""
    squared = jnp.sum(v * v, axis=-1)
    still = squared == 0.0
    return jnp.where(still, 0.0, jnp.sqrt(jnp.where(still, 1.0, squared)))


def unit(v: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
    """The direction of `v` (dimensionless), and the zero vector for the zero vector."""
    length = norm(v)[..., None]
    return v / jnp.where(length == 0.0, 1.0, length)


def limit(v: Float[Array, "*batch 2"], most: Scalar) -> Float[Array, "*batch 2"]:
    """`v` shortened to a length of at most `most`, its direction kept."""
    length = norm(v)[..., None]
    over = length > most
    return v * jnp.where(over, most / jnp.where(over, length, 1.0), 1.0)


def column(value: PerSheep, sheep: int) -> Scalar | Num[Array, "sheep 1"]:
    """A parameter of `sheep` sheep, as a factor of an array with a row per sheep.

    One number stays as it is; one number per sheep becomes a column. Raises `Refusal` for an
    array of any other shape, which would broadcast along the wrong axis.
    """
    if isinstance(value, list | tuple):
        raise Refusal("a parameter of the sheep is a list; give an array, jnp.array([...])")
    shape = jnp.shape(value)
    if shape == ():
        return value  # pyright: ignore[reportReturnType]
    if shape != (sheep,):
        raise Refusal(
            f"a parameter of the sheep is one number, or one number per sheep (shape ({sheep},)); "
            f"got an array of shape {shape}" + f"; try --sheep {shape[0]}" * (len(shape) == 1)
        )
    return jnp.asarray(value)[:, None]
