"""Fly a shepherd through cases, and say how good it was."""

from operator import index
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, Key, PRNGKeyArray

from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics, statistics
from skydog.world import mission, params
from skydog.world.mission import MAX_STEPS, Shepherd, State, Trace
from skydog.world.params import World

CHUNK = 100  # instants between looks at whether all missions are accomplished
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


def fly(
    world: World,
    shepherd: Shepherd,
    cases: State,
    steps: int = MAX_STEPS,
    key: PRNGKeyArray | None = None,
) -> Trace:
    """One mission a case, all in one compiled call: a trace with the cases along its first axis.

    `key` draws the noise that the world's parameters ask for; None flies without any.
    """
    keys = None if key is None else jax.random.split(key, len(cases.sheep))
    return _fly(params.traced(world), params.traced(shepherd), cases, index(steps), keys)


def scenario(shepherd: Shepherd, world: World) -> str:
    """The paper's name for a shepherd in an arena: H-DDPG-4x4, or H-DDPG-4x4to6x6 if it learnt
    in another."""
    flown = f"{world.arena.size:g}x{world.arena.size:g}"
    if isinstance(shepherd, Strombom):
        return f"Strombom{'-arrive' if shepherd.at_point == 'arrive' else ''}-{flown}"
    if not isinstance(shepherd, Sheepdog):
        return f"{type(shepherd).__name__}-{flown}"
    home = f"{shepherd.arena:g}x{shepherd.arena:g}"
    learnt = "" if shepherd.arena == world.arena.size else f"{home}to"
    return f"{'H-DDPG' if shepherd.drive.stretches else 'DHRL'}-{learnt}{flown}"


def fly_noisily(world: World, shepherd: Shepherd, starts: State, seed: int) -> Trace:
    """Missions from `starts`, with the noise that the world asks for, if any."""
    key = jax.random.key(seed) if params.noisy(world) else None
    return fly(world, shepherd, starts, key=key)


def measure(traces: Trace) -> dict[str, np.ndarray]:
    """Every metric of every mission: `success` and `MEASURES`, by name."""
    return {name: np.asarray(values, np.float64) for name, values in _measure(traces).items()}


def row(traces: Trace) -> dict[str, Any]:
    """The figures of one scenario, over its cases.

    `success` is the share of missions accomplished, `success_ci95` its Wilson interval. Each of
    `MEASURES` is a mean, SD and 95 % interval over all cases: a mission that failed counts
    with all the steps it was given, so that giving up early never pays.
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
        **{how.__name__: statistics.summary(measured[how.__name__]) for how in MEASURES},
    }


def one_case(traces: Trace, case: int) -> Trace:
    """One mission out of those flown together."""
    return jax.tree.map(lambda leaf: leaf[case], traces)


@jax.jit
def _measure(traces: Trace) -> dict[str, Any]:
    return {how.__name__: jax.vmap(how)(traces) for how in (metrics.success, *MEASURES)}


@mission.kept
def _fly(
    world: World, shepherd: Shepherd, cases: State, steps: int, keys: Key[Array, " cases"] | None
) -> Trace:
    """`mission.rollout` of every case, no further than the last that is accomplished."""

    def on(
        state: State, done: Bool[Array, ""], key: PRNGKeyArray | None, now: Int[Array, " instants"]
    ) -> tuple[tuple[State, Array], mission.Records]:
        fly = mission.instant(world, shepherd, steps, key)
        return jax.lax.scan(fly, (state, done), now)

    def chunk(at: Int[Array, ""], state: State, done: Bool[Array, " cases"]):
        now = at + jnp.arange(CHUNK)
        return jax.vmap(on, in_axes=(0, 0, None if keys is None else 0, None))(
            state, done, keys, now
        )

    def more(carry):
        at, _, done, _ = carry
        return (at <= steps) & ~jnp.all(done)

    def write(carry):
        at, state, done, records = carry
        (state, done), new = chunk(at, state, done)
        records = jax.tree.map(
            lambda all, some: jax.lax.dynamic_update_slice_in_dim(all, some, at, 1), records, new
        )
        return at + CHUNK, state, done, records

    start = jnp.asarray(0), cases, jnp.zeros(len(cases.sheep), bool)
    whole = (steps // CHUNK + 1) * CHUNK
    blank = jax.tree.map(
        lambda leaf: jnp.zeros((leaf.shape[0], whole, *leaf.shape[2:]), leaf.dtype),
        jax.eval_shape(chunk, *start)[1],
    )
    flown, _, _, records = jax.lax.while_loop(more, write, (*start, blank))
    # Who is done stands still: what was not flown is as the last instant that was.
    at = jnp.minimum(jnp.arange(steps + 1), jnp.maximum(flown - 1, 0))
    records = jax.tree.map(lambda leaf: leaf[:, at], records)
    return jax.vmap(mission.recorded, in_axes=(None, 0))(world, records)
