"""What is measured of a mission: one function a metric, from its trace and nothing else.

The seven of the paper's "Evaluation Metrics", each with its definition, and what they lack.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from skydog.world import herding
from skydog.world.end import AllHome
from skydog.world.laws import terms
from skydog.world.laws.paper import PaperFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.laws.varied import VariedFlock
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.params import World
from skydog.world.trace import ACCOMPLISHED, OUT_OF_TIME, Trace
from skydog.world.vectors import column, norm

STILL = 1e-6  # metres: a dog that moved less than this in a step has no heading
ROUNDING = 0.01  # of a step


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
    """`steps`, as a multiple of the `fewest_steps`: never less than 1.

    A mission that is accomplished at its start counts as one step. NaN where the fewest are not
    known, or more than the mission was given.
    """
    fewest = fewest_steps(trace)
    ratio = jnp.maximum(steps(trace), 1) / fewest
    return jnp.where(fewest <= jnp.maximum(_given(trace), 1), ratio, jnp.nan)


def fewest_steps(trace: Trace) -> Float[Array, ""]:
    """Steps, 1 or more, below which no shepherd can accomplish the mission from its start.

    No sheep moves before it sees a dog or touches another sheep. So the nearest dog first flies
    straight to within R_πβ of a sheep, as fast as it can. Then the sheep with the longest way
    moves straight to the goal disc, at its full speed.

    NaN where no such bound is known: for a law under which a sheep may exceed its speed, such as
    `LiteralFlock`, or of one's own; for another `end` than the paper's; for bodies with physics;
    among obstacles; for a start outside the walls.
    """
    world, sheep, dogs = trace.world, trace.sheep[0], trace.dogs[0]
    arena, speed = world.arena, jnp.asarray(world.sheep.speed)
    normalised = type(world.flock) in (PaperFlock, StrombomFlock, VariedFlock)
    odd = trace.poses is not None or world.obstacles is not None
    if not normalised or type(world.end) is not AllHome or odd:
        return jnp.asarray(jnp.nan)
    away = norm(sheep - herding.goal(arena)) - arena.goal_radius
    stride = jnp.where(speed > 0.0, speed * arena.dt, jnp.inf)
    longest = jnp.max(_whole_steps(away, stride))
    fewest = jnp.where(longest > 0.0, longest + _steps_of_rest(world, sheep, dogs), 1.0)
    inside = jnp.all((sheep >= 0.0) & (sheep <= arena.sides))
    inside &= jnp.all(dogs == herding.within_airspace(world, dogs))
    return jnp.where(inside, fewest, jnp.nan)


def _steps_of_rest(
    world: World, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
) -> Float[Array, ""]:
    """The steps from a start before which no sheep can move, whatever the dogs do."""
    flock, dog = world.flock, world.dog
    far = jnp.min(norm(sheep[:, None] - dogs[None, :]) - column(flock.sensing, len(sheep)))
    # Limits of one's own may allow any speed, and so may an error that is added to it.
    factor = {PerAxis: math.sqrt(2.0), AnyDirection: 1.0}.get(type(dog.limits), math.inf)
    noisy = jnp.asarray(dog.actuation_noise) > 0.0
    stride = jnp.where(noisy, jnp.inf, factor * dog.speed * world.arena.dt)
    restless = jnp.any(terms.avoid(sheep, flock.avoidance) != 0.0)
    if isinstance(flock, StrombomFlock):
        restless |= jnp.any(jnp.asarray(flock.graze) > 0.0)
    return jnp.where(restless, 0.0, _whole_steps(far, stride))


def _whole_steps(way: Float[Array, "*n"], stride: Float[Array, "*m"]) -> Float[Array, "*n"]:
    """The steps of so many metres that a way takes at least; rounding must not add one."""
    return jnp.maximum(jnp.ceil(way / stride - ROUNDING), 0.0)


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
