"""El-Fiqi's six patterns: how a flock of 100 starts, in the field of El-Fiqi et al. 2020."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from skydog import numerics, quantities
from skydog.world import params
from skydog.world.params import World
from skydog.world.state import State, start

# The cells of a grid of 5 by 5 that sheep start in: row by row, from the side far from the goal.
PATTERNS = {
    "P1": tuple(range(25)),
    "P2": (1, 2, 3, 6, 7, 8),
    "P3": (1, 3, 10, 12, 14),
    "P4": (0, 4, 10, 14, 22),
    "P5": (2, 10, 14, 20, 24),
    "P6": (0, 4, 20, 24),
}
GRID = 5
# In sides of the arena, x and y: where the grid begins and how wide it is; where dogs start.
SHEEP_FROM, SHEEP_WIDE = 0.4, 0.2
DOGS_FROM, DOGS_TO = (0.3, 0.9), (0.7, 1.0)


@numerics.ours()
def cases(
    world: World, pattern: str, count: int = 10, seed: int = 0, sheep: int = 100, dogs: int = 1
) -> State:
    key = jax.random.key(quantities.SEED.checked(seed))
    keys = jax.random.split(key, quantities.CASES.checked(count))
    cells = jnp.asarray(PATTERNS[pattern])
    return _drawn(params.traced(world), keys, cells, sheep, dogs)


@eqx.filter_jit
def _drawn(
    world: World, keys: Key[Array, " cases"], cells: Array, sheep: int, dogs: int
) -> State:
    def draw(key: Array) -> State:
        for_cell, for_sheep, for_dogs = jax.random.split(key, 3)
        cell = jax.random.choice(for_cell, cells, (sheep,))
        corner = jnp.stack([cell % GRID, cell // GRID], axis=-1)
        within = jax.random.uniform(for_sheep, (sheep, 2))
        place = SHEEP_FROM + SHEEP_WIDE * (corner + within) / GRID
        low, high = jnp.asarray(DOGS_FROM), jnp.asarray(DOGS_TO)
        dog = jax.random.uniform(for_dogs, (dogs, 2), minval=low, maxval=high)
        return start(world.arena.size * place, world.arena.size * dog)

    return jax.vmap(draw)(keys)
