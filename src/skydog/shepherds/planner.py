"""The planner: searches for the shortest mission from one start, where every force is known.

A baseline to compare shepherds with, not one to fly: it knows the sheep's law, plans a whole
mission without noise before the first step, and needs seconds to minutes for it. What it finds is
the best that is known, an upper bound: nothing proves that no shorter mission exists.

The search is a genetic algorithm with restarts (an iterated local search). It varies where the
dogs fly *relative to the flock's centre* (a `Way`), and the velocities follow from that. So the
flock reacts to a dog that flies a little differently much as before; if velocities themselves
were varied, a small variation would change everything after it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.errors import Refusal
from skydog.world import herding, memory, mission, params
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.trace import Trace
from skydog.world.vectors import Scalar, norm, unit

BLOCK = 32  # steps: ways have a multiple of it as room, so that few lengths are compiled
DECIMALS = 3  # of a velocity in m/s, so that a file holds the plan that was flown

Flight = Float[Array, "_ dogs 2"] | Float[np.ndarray, "_ dogs 2"]
"""The velocities of dogs in m/s, step by step."""

Way = Float[Array, "room dogs 2"]
"""Where each dog is to be after each step, in metres from the flock's centre before it."""

Count = int | Int[Array, ""]
"""A number of steps, traced or not."""


@dataclass(frozen=True)
class Config:
    """How a plan is searched for. Lengths in metres."""

    candidates: int = 512  # ways flown at a time
    kept: int = 64  # of them that become parents
    iterations: int = 20  # of a round, which leads to a local optimum
    rounds: int = 16  # restarts from the best ways, after one round for each flight
    chains: int = 3  # ways that are restarted in turn in the first half of the rounds
    largest: float = 0.6  # SD of the largest variation of a way
    smallest: float = 0.006  # SD of the smallest; between them the logarithm is uniform
    longest: float = 32.0  # steps: SD in time of the longest variation; that of the shortest is 0.4
    mixed: float = 0.3  # share of candidates with two parents, one before a step and one after
    shifted: float = 0.2  # share that is up to 3 steps earlier or later from a step on
    kick: float = 0.3  # SD of each of the three variations that a restart begins with
    margin: float = 1e-4  # a plan must also do with every sheep this far outside of where it is


class Plan(eqx.Module):
    """A whole mission: what the dogs fly in each step, in m/s to three decimals."""

    velocity: Float[Array, "steps dogs 2"]
    accomplished: bool = eqx.field(static=True)  # by the last of the steps, and not before

    @property
    def steps(self) -> int:
        """How many steps the mission takes."""
        return len(self.velocity)


def plan(
    world: World,
    state: State,
    flights: Sequence[Flight],
    key: PRNGKeyArray,
    config: Config = Config(),
    accept: Callable[[Plan], bool] = lambda _: True,
) -> Plan:
    """The shortest mission from a start that was found: never longer than the best flight.

    `flights` are the velocities in m/s of one or more missions from the same start, step by
    step, such as a trace's `command`; the more they differ, the more is found. A plan that is
    found is kept only if `accept` says so: it may replay it in another way. The same key gives
    the same plan on the same processor. Raises `Refusal` without a flight, for one of another
    number of dogs, and for one that holds what is no number.
    """
    if not flights:
        raise Refusal("a plan is searched for from one flight or more, got none")
    state = memory.begin(world, state)
    # As it was flown, if rounding would make it longer.
    exact = [flown(world, state, flight, decimals=None) for flight in flights]
    best = min([*(flown(world, state, flight) for flight in flights), *exact], key=_rank)
    if best.steps <= 1:
        return best
    world = params.traced(world)
    room = -(-best.steps // BLOCK) * BLOCK
    numbers = {name: jnp.float32(value) for name, value in vars(config).items()}

    def horizon() -> int:
        """The last step at which an accomplished mission would be an improvement."""
        return best.steps - best.accomplished

    def costs(way: Way) -> float:
        return float(_cost(world, state, way, horizon(), config.margin))

    def improved(ways: Float[Array, "room kept dogs 2"], number: int) -> Way:
        """A round: the way at its end. The shortest mission is kept."""
        nonlocal best
        fresh = jax.random.fold_in(key, number)
        way, winner, found = _round(
            world, state, ways, horizon(), fresh, numbers, config.candidates
        )
        if found:
            velocity = _velocity(world, state, winner)[: horizon()]
            shorter = flown(world, state, velocity, config.margin)
            if _rank(shorter) < _rank(best) and accept(shorter):
                best = shorter
        return way

    chains = []
    for number, flight in enumerate(flight for flight in flights if len(flight)):
        way = _way(world, state, _fitted(jnp.asarray(flight), room))
        chains.append(improved(jnp.repeat(way[:, None], config.kept, axis=1), number))
    for turn in range(config.rounds):
        chains.sort(key=costs)
        if 2 * turn == config.rounds:
            del chains[1:]
        number = len(flights) + turn
        nth = turn % min(config.chains, len(chains))
        fresh = jax.random.fold_in(jax.random.fold_in(key, number), 1)
        kicked = _kicked(chains[nth], horizon(), fresh, config.kick, config.kept)
        after = improved(kicked, number)
        chains[nth] = min(chains[nth], after, key=costs)
    return best


def flown(
    world: World,
    state: State,
    velocity: Flight,
    margin: float = 0.0,
    decimals: int | None = DECIMALS,
) -> Plan:
    """Velocities in m/s as a plan, cut where the mission is accomplished.

    They are rounded to so many decimals, towards zero; None leaves them as they are. The mission
    counts as accomplished only if it also is with every sheep `margin` metres further out. Raises
    `Refusal` for velocities of another number of dogs, or that are not finite.
    """
    if jnp.ndim(velocity) != 3 or jnp.shape(velocity)[1:] != jnp.shape(state.dogs):
        raise Refusal(
            f"a flight has the shape (steps, dogs, 2), here (steps, {len(state.dogs)}, 2), "
            f"got {jnp.shape(velocity)}"
        )
    if not np.all(np.isfinite(velocity)):
        raise Refusal("a flight holds a velocity that is not finite; give numbers in m/s")
    state, given = memory.begin(world, state), len(velocity)
    rounded = np.asarray(velocity, np.float64)
    if decimals is not None:
        # To a thousandth of the last decimal first: 0.123 in float32 is not to become 0.122.
        rounded = np.trunc(np.round(rounded * 10**decimals, 3)) / 10**decimals
    rounded = rounded.astype(np.float32)
    room = -(-max(given, 1) // BLOCK) * BLOCK
    padded = jnp.zeros((room, *state.dogs.shape)).at[:given].set(rounded)
    done = np.asarray(_done(params.traced(world), state, padded, margin))[: given + 1]
    steps = int(np.argmax(done)) if done.any() else given
    return Plan(jnp.asarray(rounded[:steps]), bool(done.any()))


def fly(
    world: World, state: State, velocity: Float[Array, "steps dogs 2"], steps: int | None = None
) -> Trace:
    """The trace of a plan's velocities in m/s, as `mission.rollout` gives it of a shepherd.

    The mission is given `steps` steps, by default as many as there are velocities; the dogs hover
    after those. Fit for jit, and for vmap over starts and over velocities of one length.
    """
    steps = mission.count(len(velocity) if steps is None else steps)

    def instant(carry, at):
        now, command = at
        return mission.instant(world, lambda *_: command, steps, None)(carry, now)

    commands = jnp.zeros((steps + 1, *state.dogs.shape))
    commands = commands.at[: len(velocity)].set(velocity[:steps])
    begin = memory.begin(world, state), jnp.asarray(False)
    _, record = jax.lax.scan(instant, begin, (jnp.arange(steps + 1), commands))
    return mission.as_trace(world, record, steps)


def shortfall(world: World, state: State) -> Float[Array, ""]:
    """How far from accomplished a state is, in metres: gives the search a slope.

    What the furthest sheep has still to go to the goal disc, a little of what they all have to
    go, and how far the furthest sheep strays beyond f(N).
    """
    away = norm(state.sheep - herding.goal(world.arena)) - world.arena.goal_radius
    away = jnp.maximum(away, 0.0)
    stray = jnp.max(herding.way_home(world, state.sheep).stray_distance)
    beyond = jnp.maximum(stray - herding.gathered_radius(world, len(state.sheep)), 0.0)
    # 0.3: so that sheep which are not the last come home too.
    return jnp.max(away) + 0.3 * jnp.mean(away) + beyond


def _rank(plan: Plan) -> tuple[bool, int]:
    # Of missions that fail the longest leaves the most room for one that does not.
    return not plan.accomplished, plan.steps if plan.accomplished else -plan.steps


def _fitted(velocity: Float[Array, "_ dogs 2"], room: int) -> Float[Array, "room dogs 2"]:
    """A flight cut to `room` steps, or its last velocity repeated."""
    return velocity[jnp.minimum(jnp.arange(room), len(velocity) - 1)]


def _surely(world: World, state: State, margin: Scalar) -> Bool[Array, ""]:
    """Whether the mission is accomplished, and would be with every sheep a little further out."""
    from_goal = unit(state.sheep - herding.goal(world.arena))
    from_centre = unit(state.sheep - herding.gcm(state.sheep))
    further = eqx.tree_at(
        lambda s: s.sheep, state, state.sheep + margin * (from_goal + from_centre)
    )
    return mission.accomplished(world, state) & mission.accomplished(world, further)


@jax.jit
def _done(
    world: World, state: State, velocity: Float[Array, "room dogs 2"], margin: Scalar
) -> Bool[Array, " instants"]:
    """Whether the mission is accomplished at each instant."""

    def step(state, velocity):
        after = mission.step(world, state, velocity)
        return after, _surely(world, after, margin)

    return jnp.append(_surely(world, state, margin), jax.lax.scan(step, state, velocity)[1])


@jax.jit
def _way(world: World, state: State, velocity: Float[Array, "room dogs 2"]) -> Way:
    """The way that velocities lead."""

    def step(state, velocity):
        there = state.dogs + world.arena.dt * mission.limited(world.dog, velocity)
        return mission.step(world, state, velocity), there - herding.gcm(state.sheep)

    return jax.lax.scan(step, state, velocity)[1]


def _towards(world: World, state: State, place: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocities, rounded, that bring dogs to a place relative to the flock's centre."""
    wanted = (herding.gcm(state.sheep) + place - state.dogs) / world.arena.dt
    # Towards zero, so that no limit is passed.
    return jnp.trunc(mission.limited(world.dog, wanted) * 10**DECIMALS) / 10**DECIMALS


@jax.jit
def _velocity(world: World, state: State, way: Way) -> Float[Array, "room dogs 2"]:
    """The velocities of a way, as its candidate flew them."""

    def step(state, place):
        velocity = _towards(world, state, place)
        return mission.step(world, state, velocity), velocity

    return jax.lax.scan(step, state, way)[1]


def _costs(
    world: World,
    state: State,
    ways: Float[Array, "room ways dogs 2"],
    horizon: Int[Array, ""],
    margin: Scalar,
) -> Float[Array, " ways"]:
    """What each way costs: its shortfall in metres at the horizon, if it is not accomplished.

    If it is, the steps by which it passes the first step beyond the horizon: negative.
    """

    def one(state, place):
        state = mission.step(world, state, _towards(world, state, place))
        return state, _surely(world, state, margin)

    def step(now, carry):
        states, first = carry
        states, done = jax.vmap(one)(states, ways[now])
        return states, jnp.where(done, jnp.minimum(first, now + 1), first)

    count = ways.shape[1]
    states = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), state)
    begin = states, jnp.full(count, horizon + 1)
    states, first = jax.lax.fori_loop(0, horizon, step, begin)
    left = jax.vmap(lambda state: shortfall(world, state))(states)
    return jnp.where(first <= horizon, (first - horizon - 1).astype(left.dtype), left)


@jax.jit
def _cost(world: World, state: State, way: Way, horizon: Count, margin: Scalar) -> Float[Array, ""]:
    return _costs(world, state, way[:, None], jnp.asarray(horizon), margin)[0]


def _bumps(
    room: int,
    centre: Float[Array, " ways"],
    width: Float[Array, " ways"],
    size: Float[Array, "ways dogs 2"],
) -> Float[Array, "room ways dogs 2"]:
    """For each way a variation that is `size` metres in step `centre`, and less around it."""
    away = (jnp.arange(room)[:, None] - centre) / width
    return jnp.exp(-0.5 * away**2)[:, :, None, None] * size


@partial(jax.jit, static_argnames="count")
def _kicked(
    way: Way, horizon: Count, key: PRNGKeyArray, kick: Scalar, count: int
) -> Float[Array, "room count dogs 2"]:
    """Variations of a way that are large enough to lead to another local optimum."""
    room, dogs, _ = way.shape
    for_times, for_size = jax.random.split(key)
    times = jax.random.uniform(for_times, (2, 3 * count))
    size = kick * jax.random.normal(for_size, (3 * count, dogs, 2))
    bumps = _bumps(room, horizon * times[0], 3.0 * 10.0 ** times[1], size)
    return way[:, None] + jnp.sum(bumps.reshape(room, 3, count, dogs, 2), axis=1)


def _children(
    ways: Float[Array, "room kept dogs 2"],
    horizon: Int[Array, ""],
    key: PRNGKeyArray,
    numbers: dict[str, Float[Array, ""]],
    count: int,
) -> Float[Array, "room count dogs 2"]:
    """New candidates. `ways` are sorted, the best first, which has the most children."""
    room, kept, dogs, _ = ways.shape
    for_shares, for_size = jax.random.split(key)
    u = jax.random.uniform(for_shares, (9, count))
    now = jnp.arange(room)[:, None]
    late = now > u[0] * horizon
    parent = (kept * u[1] ** 2).astype(int)
    other = (kept * u[2]).astype(int)
    parents = jnp.where(late & (u[3] < numbers["mixed"]), other, parent)
    shift = jnp.where(u[4] < numbers["shifted"], jnp.round(6.0 * u[5] - 3.0), 0.0).astype(int)
    source = jnp.clip(jnp.where(late, now + shift, now), 0, room - 1)
    sd = numbers["largest"] * (numbers["smallest"] / numbers["largest"]) ** u[6]
    width = 0.4 * (numbers["longest"] / 0.4) ** u[7]
    size = sd[:, None, None] * jax.random.normal(for_size, (count, dogs, 2))
    return ways[source, parents] + _bumps(room, u[8] * horizon, width, size)


@partial(jax.jit, static_argnames="candidates")
def _round(
    world: World,
    state: State,
    ways: Float[Array, "room kept dogs 2"],
    horizon: Count,
    key: PRNGKeyArray,
    numbers: dict[str, Float[Array, ""]],
    candidates: int,
) -> tuple[Way, Way, Bool[Array, ""]]:
    """A local optimum near some ways, the way that was accomplished the earliest, whether any was.

    Whenever a mission is accomplished by the horizon, the horizon moves to the step before.
    """

    def ordered(ways, cost, count):
        lowest, which = jax.lax.top_k(-cost, count)
        return ways[:, which], -lowest

    def sorted_anew(ways, horizon):
        return ordered(ways, _costs(world, state, ways, horizon, numbers["margin"]), kept)

    def iterate(number, carry):
        ways, cost, horizon, winner, moved = carry
        ways, cost = jax.lax.cond(moved, lambda: sorted_anew(ways, horizon), lambda: (ways, cost))
        children = _children(ways, horizon, jax.random.fold_in(key, number), numbers, candidates)
        costs = _costs(world, state, children, horizon, numbers["margin"])
        both = jnp.concatenate([ways, children], axis=1)
        ways, cost = ordered(both, jnp.append(cost, costs), kept)
        earlier = cost[0] < 0.0
        winner = jnp.where(earlier, ways[:, 0], winner)
        horizon = jnp.where(earlier, horizon + cost[0].astype(int), horizon)
        return ways, cost, horizon, winner, earlier

    kept, begin = ways.shape[1], jnp.asarray(horizon)
    carry = ways, jnp.full(kept, jnp.inf), begin, ways[:, 0], jnp.asarray(True)
    iterations = numbers["iterations"].astype(int)
    ways, _, last, winner, _ = jax.lax.fori_loop(0, iterations, iterate, carry)
    return ways[:, 0], winner, last < begin
