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


def row(traces: Trace) -> dict[str, Any]:
    """The figures of one scenario, over its cases.

    `success` is the share of missions accomplished. `steps`, `steps_gcm` and `distance`
    (metres) are each a mean, SD and 95 % interval over all cases: a mission that failed
    counts with all the steps it was given, so that giving up early never pays.
    """
    measured = _measure(traces)
    return {
        "success": float(np.mean(measured["success"])),
        "cases": len(measured["success"]),
        **{
            name: statistics.summary(np.asarray(measured[name], np.float64))
            for name in ("steps", "steps_gcm", "distance")
        },
    }


@jax.jit
def _measure(traces: Trace) -> dict[str, Any]:
    measures = (metrics.success, metrics.steps, metrics.steps_gcm, metrics.distance)
    return {measure.__name__: jax.vmap(measure)(traces) for measure in measures}


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
