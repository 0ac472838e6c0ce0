"""The dog's limits: which velocities it can fly."""

from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.world import vectors
from skydog.world.vectors import Scalar, unit


@runtime_checkable
class Limits(Protocol):
    """What a dog can fly. Any `equinox.Module` with these two methods is one.

    `speed` is the world's `dog.speed` in m/s, which also scales actions.
    """

    def limit(self, velocity: Float[Array, "*batch 2"], speed: Scalar) -> Float[Array, "*batch 2"]:
        """The velocity in m/s that is flown when `velocity` is commanded."""
        ...

    def fastest(
        self, direction: Float[Array, "*batch 2"], speed: Scalar
    ) -> Float[Array, "*batch 2"]:
        """The fastest velocity in m/s in a direction; zero for the zero vector."""
        ...


class PerAxis(eqx.Module):
    """Each component within ±speed (paper, "Action and state space"): faster diagonally."""

    def limit(self, velocity: Float[Array, "*batch 2"], speed: Scalar) -> Float[Array, "*batch 2"]:
        """Each component cut to ±speed."""
        return jnp.clip(velocity, -speed, speed)

    def fastest(
        self, direction: Float[Array, "*batch 2"], speed: Scalar
    ) -> Float[Array, "*batch 2"]:
        """The direction, stretched until its longer component is the limit."""
        longest = jnp.max(jnp.abs(direction), axis=-1, keepdims=True)
        return speed * direction / jnp.where(longest == 0.0, 1.0, longest)


class AnyDirection(eqx.Module):
    """The length of the velocity within `speed`: as fast in every direction (Strömbom 2014)."""

    def limit(self, velocity: Float[Array, "*batch 2"], speed: Scalar) -> Float[Array, "*batch 2"]:
        """The velocity, shortened to a length of `speed`."""
        return vectors.limit(velocity, speed)

    def fastest(
        self, direction: Float[Array, "*batch 2"], speed: Scalar
    ) -> Float[Array, "*batch 2"]:
        """The direction, at full speed."""
        return speed * unit(direction)
