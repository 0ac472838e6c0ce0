"""The state of a mission: where everyone is."""

import math
from dataclasses import field

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from skydog.errors import Refusal


class Memory(eqx.Module):
    """What is remembered of each sheep (`skydog.world.memory`); None is not remembered."""

    fear: Float[Array, "*batch sheep"] | None = None  # its share of the first fear: 1 to 0
    last_seen: Float[Array, "*batch sheep 2"] | None = None  # where dogs last saw it, metres


class State(eqx.Module):
    """Where everyone is. Metres; the force is dimensionless."""

    sheep: Float[Array, "*batch sheep 2"]
    dogs: Float[Array, "*batch dogs 2"]
    force: Float[Array, "*batch sheep 2"]  # what moved the sheep in the step before
    # Of worlds that ask for one: see `skydog.world.memory.begin`.
    memory: Memory | None = field(default=None, kw_only=True)


def start(sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]) -> State:
    """The state in which nobody has moved yet. Positions in metres.

    Raises `Refusal` for a position that is not finite, unless it is being traced.
    """
    sheep, dogs = jnp.asarray(sheep), jnp.asarray(dogs)
    for who, positions in (("sheep", sheep), ("dogs", dogs)):
        if isinstance(positions, Tracer):
            continue
        for number, position in enumerate(positions.tolist()):
            if not all(map(math.isfinite, position)):
                raise Refusal(
                    f"position {number} of the {who} is {position}; give finite numbers in metres"
                )
    return State(sheep=sheep, dogs=dogs, force=jnp.zeros_like(sheep))
