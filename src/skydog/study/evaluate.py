"""Fly a shepherd through cases, and say how good it was."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Int, Key, PRNGKeyArray

from skydog import numerics, quantities
from skydog.errors import Refusal
from skydog.numerics import fits, single
from skydog.shepherds.foreign import Policy
from skydog.shepherds.onnx_dog import OnnxDog
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.shepherds.team import Team
from skydog.study import metrics, statistics
from skydog.world import memory, mission, params
from skydog.world.mission import MAX_STEPS, Record, Shepherd
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.trace import Trace

CHUNK = 100  # instants between looks at whether all missions are accomplished, at most
FOREIGN_CHUNK = 10  # the same, of a shepherd that is not compiled
CHUNK_NUMBERS = 1 << 24  # coordinates of sheep in a chunk, at most: 64 MB
MEASURES = (
    metrics.steps,
    metrics.steps_gcm,
    metrics.steps_ratio,
    metrics.distance,
    metrics.cumulative_reward,
    metrics.error_per_step,
    metrics.dog_to_subgoal,
    metrics.centre_to_target,
    metrics.turn,
)


@numerics.ours()
def fly(
    world: World,
    shepherd: Shepherd,
    starts: State,
    steps: int = MAX_STEPS,
    key: PRNGKeyArray | None = None,
    every: int | None = 1,
) -> Trace:
    """One mission per start, all in one compiled call: a trace with the cases along its first axis.

    `key` draws the noise that the world's parameters ask for; None flies without any. The sheep
    are recorded at every `every`-th instant and at the last; None is the first and the last
    alone. Every metric is the same for it, to rounding. The trace takes 8 bytes per sheep, mission
    and recorded instant, and some 40 per dog, mission and instant.
    """
    if every is not None:
        every = quantities.EVERY.checked(every)
    keys = None if key is None else jax.random.split(key, len(starts.sheep))
    steps = mission.count(steps)
    every = steps + 1 if every is None else every
    count, sheep, _ = starts.sheep.shape
    a_mission = (steps + 1) * (40 * starts.dogs.shape[1] + 24) + (steps // every + 2) * 8 * sheep
    fits(count * a_mission, f"the trace of {count:,} missions of {steps:,} steps")
    trace = _fly(params.traced(world), params.traced(shepherd), single(starts), steps, keys, every)
    _refuse_lost(trace)
    return trace


def scenario(
    shepherd: Shepherd,
    world: World,
    called: str | None = None,
    sheep: int = 3,
    dogs: int = 1,
) -> str:
    """The name of a row of figures: the paper's where it is the paper's scenario.

    H-DDPG-4x4 has learnt in 4 m and flies there, H-DDPG-4x4to6x6 flies in 6 m. `called` is what
    the shepherd's card calls it; one that was trained in another way keeps a name of its own.
    Another flock than the paper's 3 sheep and 1 dog is in the name too.
    """
    flown = "{:g}x{:g}".format(*world.arena.plain_sides)
    name = f"{called or type(shepherd).__name__}-{flown}"
    if isinstance(shepherd, Strombom):
        name = f"Strombom{'-arrive' if shepherd.at_point == 'arrive' else ''}-{flown}"
    elif isinstance(shepherd, Sheepdog):
        kind = "H-DDPG" if shepherd.drive.stretches else "DHRL"
        home = f"{shepherd.arena:g}x{shepherd.arena:g}"
        plain = f"{kind}-{home}"
        called = called or plain + "-paper-frame" * (shepherd.frame == "paper")
        to = "" if home == flown else f"to{flown}"
        own = called == plain or called.startswith(f"{plain}-")
        name = f"{plain}{to}{called.removeprefix(plain)}" if own else f"{called}-{flown}"
    elif isinstance(shepherd, Team) and shepherd.skill is not None:
        name = f"Team-{scenario(shepherd.skill, world, called)}"
    return name + f"-{sheep}-sheep" * (sheep != 3) + f"-{dogs}-dogs" * (dogs != 1)


def noise_key(world: World, seed: int) -> PRNGKeyArray | None:
    """The key that draws a mission's noise; None in a world without any."""
    return jax.random.key(seed) if params.noisy(world) else None


@numerics.ours()
def measure(traces: Trace) -> dict[str, np.ndarray]:
    """Every metric of every mission: `success` and `MEASURES`, by name."""
    measured = _measure(single(traces))
    return {name: np.asarray(values, np.float64) for name, values in measured.items()}


def row(traces: Trace) -> dict[str, Any]:
    """The figures of one scenario, over its cases.

    `success` is the share of missions accomplished, `success_ci95` its Wilson interval. Each of
    `MEASURES` is a mean, SD and 95 % interval over all cases: a mission that failed counts
    with all the steps it was given, so that giving up early never pays. None for a metric that is
    not known of every mission.
    """
    return figures(measure(traces))


def figures(measured: dict[str, np.ndarray]) -> dict[str, Any]:
    """`row`, of missions that have been measured."""
    success = measured["success"]
    share, interval = statistics.share(int(success.sum()), len(success))
    return {
        "success": share,
        "success_ci95": interval,
        "cases": len(success),
        **{
            name: None if np.isnan(measured[name]).any() else statistics.summary(measured[name])
            for name in (how.__name__ for how in MEASURES)
        },
    }


def stack(missions: Sequence[Trace]) -> Trace:
    """Missions of one world and one length as they are flown together: cases first."""
    worlds = [mission.world for mission in missions]
    parts = [replace(mission, world=None) for mission in missions]
    return replace(jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts), world=worlds[0])


def one_case(traces: Trace, case: int) -> Trace:
    """One mission out of those flown together."""
    parts = {each.name: getattr(traces, each.name) for each in fields(Trace)}
    world = parts.pop("world")
    if not _one_world(traces):
        world = jax.tree.map(lambda leaf: leaf[case], world)
    return Trace(world=world, **jax.tree.map(lambda leaf: leaf[case], parts))


def _one_world(traces: Trace) -> bool:
    """Whether missions share the world that they were given; else each has its own of it."""
    return jnp.ndim(traces.world.arena.size) == 0


def _refuse_lost(trace: Trace) -> None:
    """Raise `Refusal` if sheep are nowhere: only a law of one's own can have sent them there."""
    last = trace.sheep[:, -1]
    if isinstance(last, Tracer) or bool(jnp.all(jnp.isfinite(last))):
        return
    case = int(jnp.argmax(jnp.any(~jnp.isfinite(last), axis=(1, 2))))
    raise Refusal(
        f"the flock's law ({type(trace.world.flock).__name__}) gave a force that is not a finite "
        f"number in mission {case}; does it divide by zero where two positions are the same?"
    )


@jax.jit
def _measure(traces: Trace) -> dict[str, Any]:
    if _one_world(traces):
        count = len(traces.time)
        world = jax.tree.map(
            lambda leaf: jnp.broadcast_to(jnp.asarray(leaf), (count, *jnp.shape(leaf))),
            traces.world,
        )
        traces = eqx.tree_at(lambda trace: trace.world, traces, world)
    return {how.__name__: jax.vmap(how)(traces) for how in (metrics.success, *MEASURES)}


@mission.compiled_once
def _fly(
    world: World,
    shepherd: Shepherd,
    starts: State,
    steps: int,
    keys: Key[Array, " cases"] | None,
    every: int,
) -> Trace:
    """`mission.rollout` of every start, no further than the last that is accomplished."""
    cases, sheep, _ = starts.sheep.shape
    # Of the largest flocks fewer instants at a time: a chunk holds its sheep at each of them. A
    # policy that is not compiled costs more than a look.
    most = FOREIGN_CHUNK if isinstance(shepherd, Policy | OnnxDog) else CHUNK
    chunk = max(1, min(most, CHUNK_NUMBERS // (2 * cases * sheep)))

    def on(
        state: State, done: Bool[Array, ""], key: PRNGKeyArray | None, now: Int[Array, " instants"]
    ) -> tuple[tuple[State, Array], Record]:
        fly = mission.instant(world, shepherd, steps, key)
        return jax.lax.scan(fly, (state, done), now)

    def next_chunk(at: Int[Array, ""], state: State, done: Bool[Array, " cases"]):
        now = at + jnp.arange(chunk)
        (state, done), record = jax.vmap(on, in_axes=(0, 0, None if keys is None else 0, None))(
            state, done, keys, now
        )
        sheep = record.sheep
        if every > 1:  # in place of the sheep, their centre
            record = replace(record, sheep=jnp.mean(sheep, axis=-2, keepdims=True))
        return state, done, record, sheep

    def more(carry):
        at, _, done, _, _ = carry
        return (at <= steps) & ~jnp.all(done)

    def write(carry):
        at, state, done, record, seen = carry
        state, done, new, positions = next_chunk(at, state, done)
        record = jax.tree.map(
            lambda whole, part: jax.lax.dynamic_update_slice_in_dim(whole, part, at, 1), record, new
        )
        if every > 1:
            now = at + jnp.arange(chunk)
            place = jnp.where((now % every == 0) & (now <= steps), now // every, seen.shape[1])
            seen = seen.at[:, place].set(positions, mode="drop")
        return at + chunk, state, done, record, seen

    starts = jax.vmap(lambda case: memory.begin(world, case))(starts)
    start = jnp.asarray(0), starts, jnp.zeros(cases, bool)
    whole = (steps // chunk + 1) * chunk
    blank = jax.tree.map(
        lambda leaf: jnp.zeros((cases, whole, *leaf.shape[2:]), leaf.dtype),
        jax.eval_shape(next_chunk, *start)[2],
    )
    none = jnp.zeros((cases, steps // every + 1 if every > 1 else 0, sheep, 2))
    flown, state, _, record, seen = jax.lax.while_loop(more, write, (*start, blank, none))
    # Who is done stands still: what was not flown is as the last instant that was.
    at = jnp.minimum(jnp.arange(steps + 1), jnp.maximum(flown - 1, 0))
    record = jax.tree.map(lambda leaf: leaf[:, at], record)
    trace = jax.vmap(mission.as_trace, in_axes=(None, 0, None))(world, record, steps)
    if every == 1:
        return trace
    recorded = jnp.arange(0, steps + 1, every)
    seen = jnp.where((recorded >= flown)[:, None, None], state.sheep[:, None], seen)
    if steps % every:
        recorded = jnp.append(recorded, steps)
        seen = jnp.concatenate([seen, state.sheep[:, None]], axis=1)
    recorded = jnp.broadcast_to(recorded, (cases, len(recorded)))
    return replace(trace, sheep=seen, centre=trace.sheep[:, :, 0], recorded=recorded)
