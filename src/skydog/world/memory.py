"""What a mission remembers besides where everyone is: fear that fades, and sheep last seen."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp

from skydog.errors import Refusal
from skydog.world import sight
from skydog.world.laws import terms
from skydog.world.params import World
from skydog.world.state import Memory, State
from skydog.world.vectors import column


def begin(world: World, state: State) -> State:
    """The state with the memory that its world asks for; what it remembers already is kept.

    At first every sheep is fully afraid, and the dogs know where each is. A state may be made by
    hand without a memory, or drawn in another world: whatever flies it begins it here.
    """
    had = state.memory or Memory()
    fear = last_seen = None
    if world.habituation is not None:
        fear = jnp.ones_like(state.sheep[..., 0]) if had.fear is None else had.fear
    if world.sight is not None:
        last_seen = state.sheep if had.last_seen is None else had.last_seen
    nothing = fear is None and last_seen is None
    memory = None if nothing else Memory(fear=fear, last_seen=last_seen)
    return state if memory is state.memory else replace(state, memory=memory)


def flock(world: World, state: State) -> Any:
    """The flock's law, as it is in this state: fear that has faded makes `escape` weaker."""
    if state.memory is None or state.memory.fear is None:
        return world.flock
    if not all(hasattr(world.flock, name) for name in ("escape", "sensing")):
        raise Refusal(
            f"the sheep of {type(world.flock).__name__} cannot get used to dogs: it has no escape "
            "and no sensing; leave habituation out of the world"
        )
    return replace(world.flock, escape=world.flock.escape * state.memory.fear)


def update(world: World, before: State, after: State) -> State:
    """The state after a step, with what its memory has become in it."""
    if before.memory is None:
        return after
    fear, last_seen = before.memory.fear, before.memory.last_seen
    if fear is not None and world.habituation is not None:
        near = terms.sees(before.sheep, before.dogs, world.flock.sensing)
        left = jnp.exp(-column(world.habituation, len(fear)) * world.arena.dt)
        afraid = jnp.any(near, axis=1)
        fear = jnp.where(afraid, fear * jnp.ravel(left), fear)
    if last_seen is not None and world.sight is not None:
        sees = sight.seen(world.sight, after.sheep, after.dogs, last_seen, world.obstacles)
        last_seen = jnp.where(sees[:, None], after.sheep, last_seen)
    return replace(after, memory=Memory(fear=fear, last_seen=last_seen))


def none(world: World, who: str) -> None:
    """Raise `Refusal` for a world that asks for a memory, where `who` flies it without one."""
    for name in ("sight", "habituation"):
        if getattr(world, name) is not None:
            raise Refusal(f"{who} does not know {name} yet; give it a world without")
