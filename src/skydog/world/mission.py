"""A mission: start, decide, step, and a whole rollout as a trace (paper, Eqs 10 to 13)."""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog import numerics, quantities
from skydog.errors import Refusal
from skydog.world import asking, herding, memory, obstacles, params
from skydog.world.params import Dog, World
from skydog.world.state import State, start
from skydog.world.trace import ACCOMPLISHED, OUT_OF_TIME, Ending, Trace
from skydog.world.vectors import column

TRIES = 64  # of a place that is drawn into an obstacle
MAX_STEPS = 1000  # paper, "Deep neural network structure": the longest episode

Shepherd = Callable[[World, State], Float[Array, "dogs 2"]]
"""Anything that steers dogs: their velocities in m/s, from what they see."""


@runtime_checkable
class Fly(Protocol):
    """Whatever flies missions: the kinematic world, a physics simulation, a laboratory."""

    def __call__(
        self,
        world: World,
        shepherd: Shepherd,
        starts: State,
        steps: int = MAX_STEPS,
        key: PRNGKeyArray | None = None,
        /,
    ) -> Trace:
        """One mission per start, of at most `steps` steps: a trace, cases along its first axis.

        `key` draws the noise that the world asks for; None flies without any. The trace's world
        may be the one that was given, or stacked along the first axis too.
        """
        ...


class Decision(eqx.Module):
    """Everything that is decided in an instant. Metres, m/s; the force is dimensionless."""

    velocity: Float[Array, "dogs 2"]  # of the dogs, within their limits
    force: Float[Array, "sheep 2"]  # on the sheep, by the flock's law
    subgoal: Float[Array, "dogs 2"]
    drives: Bool[Array, " dogs"]  # the behaviour: driving, else collecting


@numerics.untraced
def reset(world: World, key: PRNGKeyArray, sheep: int = 3, dogs: int = 1) -> State:
    """A random start: the flock opposite the goal, dogs anywhere in the arena.

    For the goal in the corner (0, 0) the sheep are uniform in [L/2, 0.95 L]², the quarter
    opposite, as in Strömbom 2014; the paper does not print its starts. On an axis on which the
    goal is in the middle they are uniform in [0.05 L, 0.95 L]. A scene says itself where they are.
    """
    sheep, dogs = quantities.SHEEP.checked(sheep), quantities.DOGS.checked(dogs)
    for_sheep, for_dogs = jax.random.split(key)
    places = draw_sheep(world, for_sheep, sheep, *opposite(world))
    return memory.begin(world, start(places, draw_dogs(world, for_dogs, dogs)))


def opposite(world: World) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Where sheep start by themselves, in shares of the sides: least and greatest x and y.

    In the world's `start`, if it has one, and else opposite the goal.
    """
    sides = world.arena.sides
    if world.start is not None:
        place = jnp.asarray(world.start)
        return place[:2] / sides, place[2:] / sides
    share = herding.goal(world.arena) / sides
    least = jnp.clip(0.5 - 0.9 * share, 0.05, 0.5)
    return least, jnp.clip(0.95 - 0.9 * (share - 0.5), 0.5, 0.95)


def draw_sheep(
    world: World,
    key: PRNGKeyArray,
    sheep: int,
    least: Float[Array, "2"] | float = 0.0,
    most: Float[Array, "2"] | float = 1.0,
) -> Float[Array, "sheep 2"]:
    """Places for sheep, uniform between two shares of the sides, from where there is a way home.

    Metres. One who is drawn into an obstacle is drawn again, `TRIES` times at most.
    """
    sides = world.arena.sides
    drawn = sides * jax.random.uniform(key, (sheep, 2), minval=least, maxval=most)
    if world.obstacles is None:
        return drawn
    return _redrawn(
        drawn,
        lambda again: sides * jax.random.uniform(again, (sheep, 2), minval=least, maxval=most),
        lambda places: _can_stand(world, places),
        key,
    )


def draw_dogs(world: World, key: PRNGKeyArray, dogs: int) -> Float[Array, "dogs 2"]:
    """Places for dogs, uniform in the arena, in metres; outside what they have to go around."""
    sides = world.arena.sides
    drawn = sides * jax.random.uniform(key, (dogs, 2))
    walls = world.obstacles
    if walls is None or not walls.tall:
        return drawn
    return _redrawn(
        drawn,
        lambda again: sides * jax.random.uniform(again, (dogs, 2)),
        lambda places: obstacles.clearance(walls, places) >= 0.0,
        key,
    )


def _can_stand(world: World, places: Float[Array, "sheep 2"]) -> Bool[Array, " sheep"]:
    assert world.obstacles is not None
    free = obstacles.clearance(world.obstacles, places) >= 0.0
    reaches = getattr(world.home, "reaches", None)
    return free if reaches is None else free & reaches(places)


def _redrawn(
    drawn: Float[Array, "some 2"],
    draw: Callable[[PRNGKeyArray], Float[Array, "some 2"]],
    fits: Callable[[Float[Array, "some 2"]], Bool[Array, " some"]],
    key: PRNGKeyArray,
) -> Float[Array, "some 2"]:
    def again(number: Int[Array, ""], places: Float[Array, "some 2"]) -> Float[Array, "some 2"]:
        others = draw(jax.random.fold_in(key, number))
        return jnp.where(fits(places)[:, None], places, others)

    return jax.lax.fori_loop(0, TRIES, again, drawn)


def fastest(dog: Dog, direction: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocity in m/s of a dog that flies in a direction as fast as its limits allow."""
    return dog.limits.fastest(direction, dog.speed)


def limited(dog: Dog, velocity: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocity in m/s that a dog flies when `velocity` is commanded.

    `dog.limits` limits it; a dog hovers on a command that is not a number.
    """
    finite = jnp.all(jnp.isfinite(velocity), axis=-1, keepdims=True)
    return dog.limits.limit(jnp.where(finite, velocity, 0.0), dog.speed)


def check(world: World, sheep: int, dogs: int = 1) -> World:
    """The world, if its laws work for this number of sheep and dogs. Only shapes are computed.

    Raises `Refusal` for a law without its methods, for one that fails, and for one that returns
    something of another shape. What ships need not be checked.
    """
    params.check(world)
    state = start(jnp.zeros((sheep, 2)), jnp.zeros((dogs, 2)))
    laws: tuple[tuple[str, Any, Callable[[World, Any], Any], tuple[int, ...]], ...] = (
        ("flock", world.flock, lambda w, key: w.flock.force(state, key), (sheep, 2)),
        ("flock", world.flock, lambda w, _: w.flock.force(state, None), (sheep, 2)),
        ("spread", world.spread, lambda w, _: jnp.asarray(w.spread.radius(sheep)), ()),
        ("home", world.home, lambda w, _: herding.gate(w, state.sheep, state.dogs)[0], (dogs, 2)),
        ("end", world.end, lambda w, _: w.end.accomplished(w, state), ()),
        ("dog.limits", world.dog.limits, lambda w, _: limited(w.dog, state.dogs), (dogs, 2)),
        ("dog.limits", world.dog.limits, lambda w, _: fastest(w.dog, state.dogs), (dogs, 2)),
        ("sheep", world.sheep, lambda w, _: step(w, state, state.dogs).sheep, (sheep, 2)),
    )
    for place, law, call, shape in laws:
        name = f"the world's {place} ({type(law).__name__})"
        try:
            found = jax.eval_shape(call, params.traced(world), jax.random.key(0))
        except Refusal:
            raise
        except Exception as problem:  # whatever a law of one's own may raise
            kind, said = type(problem).__name__, str(problem).strip().split("\n")[0]
            static = "Tracer" in kind or "Concretization" in kind
            raise Refusal(
                f"{name} failed: {kind}: {said:.160}"
                + "; mark a field that is not computed with as equinox.field(static=True)" * static
            ) from problem
        if getattr(found, "shape", None) != shape:
            raise Refusal(
                f"{name} gave something of the shape {getattr(found, 'shape', found)!s:.60} for "
                f"{sheep} sheep and {dogs} dogs, where the shape {shape} is needed"
            )
    return world


def decide(
    world: World,
    shepherd: Shepherd,
    state: State,
    *,
    seen: State | None = None,
    key: PRNGKeyArray | None = None,
) -> Decision:
    """Everything that is decided in an instant, from what is seen.

    The sheep decide on `state`, and subgoals and behaviours are those of `state`; the dogs
    decide on `seen`, if they see something else. `key` draws what is random in the sheep's law.
    The kinematic world moves everyone as decided (`move`); bodies with physics try to.
    """
    state = memory.begin(world, state)
    velocity = asking.velocity(shepherd, world, perceive(world, state) if seen is None else seen)
    if jnp.shape(velocity) != state.dogs.shape:
        raise Refusal(
            f"the shepherd gave velocities of the shape {jnp.shape(velocity)}, not one x and y "
            f"for each dog: {state.dogs.shape}"
        )
    subgoal, drives = herding.gate(world, state.sheep, state.dogs)
    return Decision(
        velocity=limited(world.dog, velocity),
        force=memory.flock(world, state).force(state, key),
        subgoal=subgoal,
        drives=drives,
    )


def move(
    world: World,
    state: State,
    velocity: Float[Array, "dogs 2"],
    force: Float[Array, "sheep 2"],
    key: PRNGKeyArray | None = None,
) -> State:
    """The world one `dt` later (paper, Eqs 10 and 11): all move at once, as decided.

    `velocity` is in m/s and within the dogs' limits; `key` draws its error.
    """
    if key is not None:
        velocity = velocity + world.dog.actuation_noise * jax.random.normal(key, velocity.shape)
    speed = column(world.sheep.speed, len(state.sheep))
    sheep = state.sheep + speed * world.arena.dt * force
    sheep = jnp.clip(sheep, 0.0, world.arena.sides)
    dogs = herding.within_airspace(world, state.dogs + world.arena.dt * velocity)
    if world.obstacles is not None:
        sides, beyond = world.arena.sides, world.dog.airspace
        sheep = obstacles.moved(world.obstacles, state.sheep, sheep, 0.0, sides)
        if world.obstacles.tall:
            dogs = obstacles.moved(world.obstacles, state.dogs, dogs, -beyond, sides + beyond)
    state = memory.begin(world, state)
    return memory.update(world, state, State(sheep=sheep, dogs=dogs, force=force))


@numerics.untraced
def step(
    world: World,
    state: State,
    velocity: Float[Array, "dogs 2"],
    key: PRNGKeyArray | None = None,
) -> State:
    """The world one `dt` later, the dogs commanded to fly `velocity` in m/s.

    `key` draws the noise that the world's parameters ask for; without one there is none.
    """
    for_sheep, for_dogs = (None, None) if key is None else jax.random.split(key)
    state = memory.begin(world, state)
    force = memory.flock(world, state).force(state, for_sheep)
    return move(world, state, limited(world.dog, velocity), force, for_dogs)


@numerics.untraced
def accomplished(world: World, state: State) -> Bool[Array, ""]:
    """Whether the mission is accomplished: by default, all home and gathered (Eq. 12)."""
    return world.end.accomplished(world, state)


def perceive(world: World, state: State, key: PRNGKeyArray | None = None) -> State:
    """The state as the dogs see it: each sheep where it was last seen, if sight is limited.

    With a `key`, each coordinate is off by the world's perception noise.
    """
    if state.memory is not None and state.memory.last_seen is not None:
        state = replace(state, sheep=state.memory.last_seen)
    if key is None:
        return state
    for_sheep, for_dogs = jax.random.split(key)
    sd = world.dog.perception_noise
    return replace(
        state,
        sheep=state.sheep + sd * jax.random.normal(for_sheep, state.sheep.shape),
        dogs=state.dogs + sd * jax.random.normal(for_dogs, state.dogs.shape),
    )


class Record(eqx.Module):
    """What an instant leaves to record; stacked along the instants, all of a mission."""

    sheep: Float[Array, "*instants sheep 2"]
    dogs: Float[Array, "*instants dogs 2"]
    subgoal: Float[Array, "*instants dogs 2"]
    drives: Bool[Array, "*instants dogs"]
    command: Float[Array, "*instants dogs 2"]
    accomplished: Bool[Array, "*instants"]


def compiled_once(flown: Callable[..., Any]) -> Callable[..., Any]:
    """`flown(world, shepherd, ...)`, compiled; for a shepherd that is a module, only once.

    Any other shepherd may read what has changed by then: it is compiled anew each time.
    """
    compiled = eqx.filter_jit(flown)

    @wraps(flown)
    def fly(world: World, shepherd: Shepherd, *rest: Any) -> Any:
        with asking.heard():
            return (compiled if isinstance(shepherd, eqx.Module) else flown)(world, shepherd, *rest)

    return fly


@numerics.untraced
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
    steps = count(steps)
    return as_trace(world, _rollout(world, shepherd, state, steps, key), steps)


def count(steps: int) -> int:
    """The steps of a mission. Raises `Refusal` for fewer than none."""
    return 0 if isinstance(steps, int) and steps == 0 else quantities.STEPS.checked(steps)


@compiled_once
def _rollout(
    world: World, shepherd: Shepherd, state: State, steps: int, key: PRNGKeyArray | None
) -> Record:
    fly = instant(world, shepherd, steps, key)
    return jax.lax.scan(
        fly, (memory.begin(world, state), jnp.asarray(False)), jnp.arange(steps + 1)
    )[1]


def instant(
    world: World, shepherd: Shepherd, steps: int, key: PRNGKeyArray | None
) -> Callable[[tuple[State, Array], Array], tuple[tuple[State, Array], Record]]:
    """One step of a mission, for a scan: from (state, done) and its number to the next ones.

    The randomness of instant t is `jax.random.fold_in(key, t)`, split into one key to move and
    one to perceive; the former again into one for the sheep's law and one for the dogs' error.
    """

    def fly(carry, now: Int[Array, ""]):
        state, done = carry
        for_sheep = for_dogs = seen = None
        if key is not None:
            moving, perceiving = jax.random.split(jax.random.fold_in(key, now))
            for_sheep, for_dogs = jax.random.split(moving)
            seen = perceive(world, state, perceiving)
        done = done | accomplished(world, state)
        last = done | (now >= steps)
        decided = decide(world, shepherd, state, seen=seen, key=for_sheep)
        command = jnp.where(last, 0.0, decided.velocity)
        record = Record(state.sheep, state.dogs, decided.subgoal, decided.drives, command, done)
        after = move(world, state, command, decided.force, for_dogs)
        state = jax.tree.map(lambda old, new: jnp.where(last, old, new), state, after)
        return (state, done), record

    return fly


def as_trace(world: World, record: Record, steps: int) -> Trace:
    """The trace of a mission of at most `steps` steps, from the record of all its instants."""
    done = record.accomplished
    return Trace(
        world=world,
        time=jnp.arange(len(done)) * jnp.asarray(world.arena.dt, jnp.float32),
        sheep=record.sheep,
        dogs=record.dogs,
        subgoal=record.subgoal,
        drives=record.drives,
        command=record.command,
        accomplished=done,
        ending=Ending(how=jnp.where(done[-1], ACCOMPLISHED, OUT_OF_TIME), steps=jnp.asarray(steps)),
    )
