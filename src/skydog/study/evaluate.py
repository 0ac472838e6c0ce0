"""Fly a shepherd through cases, and say how good it was."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key, PRNGKeyArray

from skydog.study import metrics, statistics
from skydog.world import mission
from skydog.world.mission import MAX_STEPS, Shepherd, State, Trace
from skydog.world.params import World

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
    return _fly(_traced(world), _traced(shepherd), cases, steps, keys)


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


@eqx.filter_jit
def _fly(
    world: World, shepherd: Shepherd, cases: State, steps: int, keys: Key[Array, " cases"] | None
) -> Trace:
    def one(case: State, key: PRNGKeyArray | None) -> Trace:
        return mission.rollout(world, shepherd, case, steps, key)

    return jax.vmap(one)(cases, keys)


def _traced(tree: Any) -> Any:
    # filter_jit compiles anew for every other plain number; as arrays they are arguments.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) else leaf, tree)
