"""What is measured of a mission: one function a metric, from its trace and nothing else.

The seven of the paper's "Evaluation Metrics", each with its definition, and what they lack.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from skydog.world import herding
from skydog.world.trace import ACCOMPLISHED, OUT_OF_TIME, Trace
from skydog.world.vectors import norm

STILL = 1e-6  # metres: a dog that moved less than this in a step has no heading


def success(trace: Trace) -> Bool[Array, ""]:
    """Whether the mission was accomplished: all sheep home and gathered (paper, Eq. 12).

    A mission that ended in any other way is a failure.
    """
    done = trace.accomplished[-1]
    return done if trace.ending is None else done & (trace.ending.how == ACCOMPLISHED)


def steps(trace: Trace) -> Int[Array, ""]:
    """The step at which the mission was accomplished; else all the steps that it was given.

    So a mission that ended early, by a crash or because someone stopped it, is no record.
    """
    return jnp.where(success(trace), jnp.argmax(trace.accomplished), _given(trace))


def steps_gcm(trace: Trace) -> Int[Array, ""]:
    """The step at which the flock's centre came within 𝔻 of the goal.

    That is how the paper counts (Section "Evaluation Metrics", Number of steps). A mission
    whose centre never arrives counts its `steps`, and so does one that ended otherwise than
    accomplished or out of time.
    """
    arena = trace.world.arena
    arrived = norm(_centre(trace) - herding.goal(arena)) <= arena.goal_radius
    counts = jnp.any(arrived)
    if trace.ending is not None:
        counts = counts & (trace.ending.how <= OUT_OF_TIME)
    return jnp.where(counts, jnp.argmax(arrived), steps(trace))


def steps_ratio(trace: Trace) -> Float[Array, ""]:
    """`steps`, as a multiple of the fewest that any shepherd could need.

    Those take the sheep that starts furthest out straight to the goal disc at its full speed;
    with a speed per sheep, the one that needs the longest. At least one step, so that a mission
    which starts at home has a ratio.
    """
    arena, speed = trace.world.arena, trace.world.sheep.speed
    away = norm(trace.sheep[0] - herding.goal(arena)) - arena.goal_radius
    needed = jnp.where(jnp.asarray(speed) > 0.0, jnp.ceil(away / (speed * arena.dt)), 0.0)
    return steps(trace) / jnp.maximum(jnp.max(needed), 1.0)


def distance(trace: Trace) -> Float[Array, ""]:
    """Metres that the dogs flew in all (paper, Eq. 13; "Travel Distance")."""
    return jnp.sum(norm(jnp.diff(trace.dogs, axis=0)))


def cumulative_reward(trace: Trace) -> Float[Array, ""]:
    """What the paper's reward comes to over the mission, for each dog ("Cumulative reward").

    0.1 for a step after which the dog is no further from its subgoal than before, -0.1 for
    any other (paper, "Reward Design"). The "large reward" of an accomplished mission, whose
    size the paper does not print, is left out.
    """
    away = norm(trace.dogs - trace.subgoal)
    paid = jnp.where(away[1:] <= away[:-1], 0.1, -0.1)
    return jnp.sum(jnp.where(_flown(trace), jnp.mean(paid, axis=1), 0.0))


def error_per_step(trace: Trace) -> Float[Array, ""]:
    """Metres between where a dog came in a step and where it was to come ("Error per step").

    It was to come from where it was, at its commanded velocity, for the time of the step.
    """
    taken = jnp.diff(trace.time)[:, None, None]
    desired = trace.dogs[:-1] + trace.command[:-1] * taken
    return _mean_over_steps(trace, norm(trace.dogs[1:] - desired))


def dog_to_subgoal(trace: Trace) -> Float[Array, ""]:
    """Metres between a dog and its subgoal, as each step begins ("Distance ... per step")."""
    return _mean_over_steps(trace, norm(trace.dogs - trace.subgoal)[:-1])


def centre_to_target(trace: Trace) -> Float[Array, ""]:
    """Metres a step by which the flock's centre came nearer to the goal ("Reduced distance")."""
    away = norm(_centre(trace) - herding.goal(trace.world.arena))
    flown = jnp.where(success(trace), steps(trace), len(trace.time) - 1)
    return (away[0] - away[-1]) / jnp.maximum(flown, 1)


def turn(trace: Trace) -> Float[Array, ""]:
    """Degrees by which a dog turns from one step to the next: 0 is smooth, 90 a zigzag. Ours.

    The mean over pairs of steps in both of which it moved.
    """
    way = jnp.diff(trace.dogs, axis=0)
    before, after = way[:-1], way[1:]
    cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    angle = jnp.abs(jnp.degrees(jnp.arctan2(cross, jnp.sum(before * after, axis=-1))))
    moved = (norm(before) > STILL) & (norm(after) > STILL)
    return jnp.sum(jnp.where(moved, angle, 0.0)) / jnp.maximum(jnp.sum(moved), 1)


def _centre(trace: Trace) -> Float[Array, "instants 2"]:
    return jnp.mean(trace.sheep, axis=-2) if trace.centre is None else trace.centre


def _flown(trace: Trace) -> Bool[Array, " steps"]:
    # After the mission is accomplished the world stands still.
    return ~trace.accomplished[:-1]


def _mean_over_steps(trace: Trace, values: Float[Array, "steps dogs"]) -> Float[Array, ""]:
    flown = _flown(trace)
    total = jnp.sum(jnp.where(flown, jnp.mean(values, axis=1), 0.0))
    return total / jnp.maximum(jnp.sum(flown), 1)


def _given(trace: Trace) -> Int[Array, ""]:
    """The steps that the mission was given: if the trace does not say, those that it has."""
    return jnp.asarray(len(trace.time) - 1) if trace.ending is None else trace.ending.steps
