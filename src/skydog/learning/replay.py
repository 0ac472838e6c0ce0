"""The replay memory: a ring buffer of the latest transitions, sampled uniformly."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int


class Transition(eqx.Module):
    """What happened in one step. `terminated` is the end of the task, never of the time."""

    observation: Float[Array, "*batch seen"]
    action: Float[Array, "*batch action"]
    reward: Float[Array, "*batch"]
    next_observation: Float[Array, "*batch seen"]
    terminated: Float[Array, "*batch"]


class Replay(eqx.Module):
    """The memory P of Algorithm 1; `written` counts every transition ever stored."""

    # One packed row a transition: XLA then writes in place (several rings it copies).
    ring: Float[Array, "capacity packed"]
    written: Int[Array, ""]


def empty(capacity: int, like: Transition) -> Replay:
    """A memory for `capacity` transitions of the shapes of `like`."""
    packed, _ = ravel_pytree(like)
    return Replay(jnp.zeros((capacity, len(packed))), jnp.asarray(0))


def add(replay: Replay, transition: Transition) -> Replay:
    """The memory with one more transition, which replaces the oldest one if the memory is full."""
    packed, _ = ravel_pytree(transition)
    at = replay.written % len(replay.ring)
    return Replay(replay.ring.at[at].set(packed), replay.written + 1)


def sample(replay: Replay, picks: Float[Array, " batch"], like: Transition) -> Transition:
    """The transitions that `picks`, uniform in [0, 1), choose among those stored."""
    stored = jnp.minimum(replay.written, len(replay.ring))
    rows = replay.ring[(picks * stored).astype(jnp.int32)]
    _, unpack = ravel_pytree(like)
    return jax.vmap(unpack)(rows)
