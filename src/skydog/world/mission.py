"""A mission: state, start, one step, its end, and a whole rollout as a trace (Eqs 10 to 13)."""

import math
from collections.abc import Callable
from functools import wraps
from operator import index
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.errors import Refusal
from skydog.world import flock, herding
from skydog.world.params import Dog, World
from skydog.world.vectors import limit, norm, unit

MAX_STEPS = 1000  # paper, "Deep neural network structure": the longest episode


class State(eqx.Module):
    """Where everyone is. Metres; the force is dimensionless."""

    sheep: Float[Array, "*batch sheep 2"]
    dogs: Float[Array, "*batch dogs 2"]
    force: Float[Array, "*batch sheep 2"]  # what moved the sheep in the step before


Shepherd = Callable[[World, State], Float[Array, "dogs 2"]]
"""Anything that steers dogs: their velocities in m/s, from what they see."""


class Trace(eqx.Module):
    """Everything a mission recorded, instant by instant; the last instant commands nothing.

    After the mission is accomplished the world stands still, so that missions of different
    lengths share one shape. Metres, seconds, m/s.
    """

    world: World
    time: Float[Array, "*batch instants"]
    sheep: Float[Array, "*batch instants sheep 2"]
    dogs: Float[Array, "*batch instants dogs 2"]
    subgoal: Float[Array, "*batch instants dogs 2"]
    drives: Bool[Array, "*batch instants dogs"]  # the behaviour: driving, else collecting
    # What the shepherd asked for, within the limits of the dog.
    command: Float[Array, "*batch instants dogs 2"]
    accomplished: Bool[Array, "*batch instants"]


def start(sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]) -> State:
    """The state in which nobody has moved yet. Positions in metres.

    Raises `Refusal` for a position that is not finite, unless it is being traced.
    """
    for who, positions in (("sheep", sheep), ("dogs", dogs)):
        if isinstance(positions, Tracer):
            continue
        for number, position in enumerate(positions.tolist()):
            if not all(map(math.isfinite, position)):
                raise Refusal(
                    f"position {number} of the {who} is {position}; give finite numbers in metres"
                )
    return State(sheep=sheep, dogs=dogs, force=jnp.zeros_like(sheep))


def reset(world: World, key: PRNGKeyArray, sheep: int = 3, dogs: int = 1) -> State:
    """A random start: sheep uniform in [L/2, 0.95 L]², dogs anywhere in the arena.

    The flock starts in the quarter opposite the goal, as in Strömbom 2014; the paper does not
    print its starts.
    """
    for_sheep, for_dogs = jax.random.split(key)
    size = world.arena.size
    return start(
        size * jax.random.uniform(for_sheep, (sheep, 2), minval=0.5, maxval=0.95),
        size * jax.random.uniform(for_dogs, (dogs, 2)),
    )


def fastest(dog: Dog, direction: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocity in m/s of a dog that flies in a direction as fast as its limit allows."""
    if dog.per_axis:
        longest = jnp.max(jnp.abs(direction), axis=-1, keepdims=True)
        return dog.speed * direction / jnp.where(longest == 0.0, 1.0, longest)
    return dog.speed * unit(direction)


def limited(dog: Dog, velocity: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocity in m/s that a dog flies when told to fly `velocity`.

    Each component, or the speed, is limited as `dog.per_axis` says; a dog hovers on a
    command that is not a number.
    """
    finite = jnp.all(jnp.isfinite(velocity), axis=-1, keepdims=True)
    velocity = jnp.where(finite, velocity, 0.0)
    if dog.per_axis:
        return jnp.clip(velocity, -dog.speed, dog.speed)
    return limit(velocity, dog.speed)


def step(
    world: World,
    state: State,
    velocity: Float[Array, "dogs 2"],
    key: PRNGKeyArray | None = None,
) -> State:
    """The world one `dt` later (paper, Eqs 10 and 11): all move at once.

    `velocity` is in m/s. `key` draws the noise that the world's parameters ask for; without
    one there is none.
    """
    flown = limited(world.dog, velocity)
    for_sheep = None
    if key is not None:
        for_sheep, for_dogs = jax.random.split(key)
        flown = flown + world.dog.actuation_noise * jax.random.normal(for_dogs, flown.shape)
    force = flock.force(world.flock, state.sheep, state.dogs, state.force, for_sheep)
    sheep = state.sheep + world.flock.speed * world.arena.dt * force
    return State(
        sheep=jnp.clip(sheep, 0.0, world.arena.size),
        dogs=herding.within_airspace(world, state.dogs + world.arena.dt * flown),
        force=force,
    )


def accomplished(world: World, state: State) -> Bool[Array, ""]:
    """Whether every sheep is within 𝔻 of the goal and the flock gathered within f(N) (Eq. 12)."""
    home = norm(state.sheep - herding.goal(world.arena)) <= world.arena.goal_radius
    return jnp.all(home) & herding.gathered(world.flock, state.sheep)


def perceive(world: World, state: State, key: PRNGKeyArray) -> State:
    """The state as the dogs see it, each coordinate off by the world's perception noise."""
    for_sheep, for_dogs = jax.random.split(key)
    sd = world.dog.perception_noise
    return State(
        sheep=state.sheep + sd * jax.random.normal(for_sheep, state.sheep.shape),
        dogs=state.dogs + sd * jax.random.normal(for_dogs, state.dogs.shape),
        force=state.force,
    )


Records = tuple[Array, Array, Array, Array, Array, Array]
"""What an instant leaves to record: sheep, dogs, subgoal, drives, command, accomplished."""


def kept(flown: Callable[..., Any]) -> Callable[..., Any]:
    """`flown(world, shepherd, ...)`, compiled and kept for the next call if it is a module's.

    Any other shepherd may read what has changed by then: it is compiled anew each time.
    """
    compiled = eqx.filter_jit(flown)

    @wraps(flown)
    def fly(world: World, shepherd: Shepherd, *rest: Any) -> Any:
        return (compiled if isinstance(shepherd, eqx.Module) else flown)(world, shepherd, *rest)

    return fly


def rollout(
    world: World,
    shepherd: Shepherd,
    state: State,
    steps: int = MAX_STEPS,
    key: PRNGKeyArray | None = None,
) -> Trace:
    """Fly a mission of at most `steps` steps: one compiled scan, fit for jit and vmap.

    `key` draws the noise; None is a mission without any. For a shepherd that is an `eqx.Module`,
    what was compiled is kept for the next call with the same world and shapes.
    """
    return recorded(world, _flown(world, shepherd, state, index(steps), key))


@kept
def _flown(
    world: World, shepherd: Shepherd, state: State, steps: int, key: PRNGKeyArray | None
) -> Records:
    fly = instant(world, shepherd, steps, key)
    return jax.lax.scan(fly, (state, jnp.asarray(False)), jnp.arange(steps + 1))[1]


def instant(
    world: World, shepherd: Shepherd, steps: int, key: PRNGKeyArray | None
) -> Callable[[tuple[State, Array], Array], tuple[tuple[State, Array], Records]]:
    """One instant of a mission, for a scan: (state, done) and its number to those after it."""

    def fly(carry, now: Int[Array, ""]):
        state, done = carry
        moving = perceiving = None
        seen = state
        if key is not None:
            moving, perceiving = jax.random.split(jax.random.fold_in(key, now))
            seen = perceive(world, state, perceiving)
        done = done | accomplished(world, state)
        last = done | (now >= steps)
        command = jnp.where(last, 0.0, limited(world.dog, shepherd(world, seen)))
        subgoal, drives = herding.gate(world, state.sheep, state.dogs)
        record = (state.sheep, state.dogs, subgoal, drives, command, done)
        after = step(world, state, command, moving)
        state = jax.tree.map(lambda old, new: jnp.where(last, old, new), state, after)
        return (state, done), record

    return fly


def recorded(world: World, records: Records) -> Trace:
    """The trace that the records of all instants, one after another, amount to."""
    sheep, dogs, subgoal, drives, command, done = records
    return Trace(
        world=world,
        time=jnp.arange(len(done)) * jnp.asarray(world.arena.dt, jnp.float32),
        sheep=sheep,
        dogs=dogs,
        subgoal=subgoal,
        drives=drives,
        command=command,
        accomplished=done,
    )
