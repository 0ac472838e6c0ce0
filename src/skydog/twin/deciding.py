"""What is decided in the twin: on what motion capture sees, with the world's own noise."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from skydog.flight.limits import Corner
from skydog.flight.setpoints import Slide
from skydog.world import mission, obstacles
from skydog.world.mission import Decision, Shepherd
from skydog.world.obstacles import Obstacles
from skydog.world.params import World
from skydog.world.state import State


@mission.compiled_once
def decide(
    world: World,
    shepherd: Shepherd,
    seen: State,
    real: State,
    keys: Key[Array, " batch"] | None,
    now: Int[Array, ""],
) -> tuple[Decision, Bool[Array, " batch"]]:
    """`mission.decide` on what is seen, with the world's own noise; and whether all are home."""

    def one(seen: State, real: State, key: PRNGKeyArray | None) -> tuple[Decision, Bool[Array, ""]]:
        for_sheep, shown = None, seen
        error = 0.0
        if key is not None:
            for_sheep, for_dogs, perceiving = jax.random.split(jax.random.fold_in(key, now), 3)
            shown = mission.perceive(world, seen, perceiving)
            error = world.dog.actuation_noise * jax.random.normal(for_dogs, seen.dogs.shape)
        decided = mission.decide(world, shepherd, seen, seen=shown, key=for_sheep)
        decided = replace(decided, velocity=decided.velocity + error)
        return decided, mission.accomplished(world, real)

    keyed = None if keys is None else 0
    return jax.vmap(one, in_axes=(0, 0, keyed))(seen, real, keys)


def sliding(closed: Obstacles | None, sides: Corner) -> Slide | None:
    """How set-points of rovers slide along obstacles: as the sheep of the kinematic world do.

    `closed` is what `bodies.closed_to` returns, `sides` are those of the arena in metres.
    """
    if closed is None:
        return None
    most = jnp.asarray(sides, jnp.float32)

    def slide(
        before: Float[np.ndarray, "batch sheep 2"], after: Float[np.ndarray, "batch sheep 2"]
    ) -> Float[np.ndarray, "batch sheep 2"]:
        start, end = jnp.asarray(before, jnp.float32), jnp.asarray(after, jnp.float32)
        return np.asarray(_moved(closed, start, end, most), float)

    return slide


@jax.jit
def _moved(
    closed: Obstacles,
    before: Float[Array, "batch sheep 2"],
    after: Float[Array, "batch sheep 2"],
    most: Float[Array, "..."],
) -> Float[Array, "batch sheep 2"]:
    move = jax.vmap(obstacles.moved, in_axes=(None, 0, 0, None, None))
    return move(closed, before, after, 0.0, most)
