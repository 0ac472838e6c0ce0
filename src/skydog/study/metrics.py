"""What is measured of a mission: one function a metric, from its trace and nothing else."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from skydog.world import herding
from skydog.world.mission import Trace
from skydog.world.vectors import norm


def success(trace: Trace) -> Bool[Array, ""]:
    """Whether the mission was accomplished: all sheep home and gathered (paper, Eq. 12)."""
    return trace.accomplished[-1]


def steps(trace: Trace) -> Int[Array, ""]:
    """The step at which the mission was accomplished; else all the steps that it was given."""
    return _first(trace.accomplished)


def steps_gcm(trace: Trace) -> Int[Array, ""]:
    """The step at which the flock's centre came within 𝔻 of the goal.

    That is how the paper counts (Section "Evaluation Metrics", Number of steps). A trace
    whose centre never arrives counts all its steps.
    """
    centre = jnp.mean(trace.sheep, axis=-2)
    arena = trace.world.arena
    return _first(norm(centre - herding.goal(arena)) <= arena.goal_radius)


def distance(trace: Trace) -> Float[Array, ""]:
    """Metres that the dogs flew in all (paper, Eq. 13; "Travel Distance")."""
    return jnp.sum(norm(jnp.diff(trace.dogs, axis=0)))


def _first(reached: Bool[Array, " instants"]) -> Int[Array, ""]:
    return jnp.where(jnp.any(reached), jnp.argmax(reached), len(reached) - 1)
