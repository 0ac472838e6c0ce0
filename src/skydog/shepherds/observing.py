"""What the dogs of a mission see as numbers, and what their actions mean.

The environments (`skydog.envs`) and other people's policies in missions share it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.shepherds import sheepdog
from skydog.shepherds.options import ObservationKind
from skydog.world import herding, mission
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar


def observe(
    world: World, state: State, subgoal: Float[Array, "dogs 2"], how: ObservationKind
) -> Float[Array, "dogs seen"]:
    """What each dog sees, in metres.

    `compact`: `skydog.shepherds.sheepdog.OBSERVES`. `full`: from the dog to each sheep, to the
    goal, and to each other dog, from the one after it round to the one before; x and y in turn.
    """
    if how == "compact":
        return sheepdog.observe(state.sheep, state.dogs, subgoal)
    count = len(state.dogs)
    goal = jnp.broadcast_to(herding.goal(world.arena), (count, 1, 2))
    sheep = jnp.broadcast_to(state.sheep, (count, *state.sheep.shape))
    after = jnp.arange(count)[:, None] + jnp.arange(1, count)
    others = state.dogs[after % count]
    everybody = jnp.concatenate([sheep, goal, others], axis=1)
    return (everybody - state.dogs[:, None]).reshape(count, -1)


def bound(world: World, widest: Scalar = 1.0) -> Scalar:
    """The furthest, in metres on an axis, that anything can be from a dog, as the dog sees it.

    `widest` is the largest scale that it sees the world at.
    """
    return jnp.max(jnp.asarray(world.arena.sides)) + 2.0 * widest * world.dog.airspace


def size(how: ObservationKind, sheep: int, dogs: int) -> int:
    """How many numbers a dog sees."""
    return 4 if how == "compact" else 2 * (sheep + dogs)


def velocity(world: World, action: Float[Array, "dogs 2"]) -> Float[Array, "dogs 2"]:
    """The velocity in m/s that an action commands: shares of the speed limit, within the limits."""
    return mission.limited(world.dog, world.dog.speed * action)
