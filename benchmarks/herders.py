"""Find the numbers of the ring: how dogs herd sheep that do not hold together with the fewest.

    python benchmarks/herders.py [--seed 1] [--generations 40]

Needs `pip install cma` (CMA-ES, Hansen). Tunes on herds that a few dogs can just capture, on
starts and noise of its own (`skydog.study.herdability` judges on others), and prints the numbers.
"""

import argparse
import time
from dataclasses import replace
from functools import partial

import cma  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np

from skydog.shepherds.ring import Ring
from skydog.study import herds
from skydog.world import herding, mission, params
from skydog.world.presets import preset
from skydog.world.vectors import norm

# Sheep, dogs, steps, runs: near the threshold, so that better numbers show.
CELLS = ((64, 4, 8_000, 3), (100, 6, 6_000, 2), (225, 9, 5_000, 1))
POPULATION = 14
# Where the search begins, and what is a step in each number; the others stay as they are.
BEGIN = {
    "outside": (2.4, 1.0),
    "far": (0.9, 0.4),
    "offset": (0.57, 0.2),
    "lift": (0.25, 0.2),
    "swing": (1.0, 0.6),
    "guard": (2.8, 1.0),
    "gain": (22.0, 8.0),
}
LEAST = 0.01  # of the sheep: that many outside are as good as none


@partial(jax.jit, static_argnames=("sheep", "dogs", "steps", "runs"))
def outside(numbers, key, sheep, dogs, steps, runs):
    """The share of the sheep that is not home, of each row of numbers and run.

    Half the mean over the run and half that over its last third.
    """
    world = params.traced(preset("lama2024", sheep=sheep))
    for_starts, for_noise = jax.random.split(key)
    begun = jax.vmap(lambda key: herds.draw(world, key, sheep, dogs))(
        jax.random.split(for_starts, runs)
    )
    keys = jax.random.split(for_noise, runs)

    def run(ring, state, key):
        def instant(carry, now):
            state, whole, late = carry
            away = jnp.mean(norm(state.sheep - herding.goal(world.arena)) > world.arena.goal_radius)
            decided = mission.decide(world, ring, state, key=jax.random.fold_in(key, now))
            state = mission.move(world, state, decided.velocity, decided.force)
            late = late + jnp.where(3 * now >= 2 * steps, 3.0 * away, 0.0)
            return (state, whole + away, late), None

        zero = jnp.zeros(())
        (_, whole, late), _ = jax.lax.scan(instant, (state, zero, zero), jnp.arange(steps))
        return (whole + late) / (2 * steps)

    over_runs = jax.vmap(run, in_axes=(None, 0, 0))
    return jax.vmap(lambda row: over_runs(ring(row), begun, keys))(numbers)


def ring(numbers):
    """A ring of the searched numbers; each may be an array."""
    return replace(Ring(), **dict(zip(BEGIN, numbers, strict=True)))


def main():
    asked = argparse.ArgumentParser()
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--generations", type=int, default=40)
    asked = asked.parse_args()
    begin, scale = np.array(list(BEGIN.values())).T
    search = cma.CMAEvolutionStrategy(
        begin / scale, 0.4, {"seed": asked.seed, "popsize": POPULATION, "verbose": -9}
    )
    began = time.time()
    for generation in range(asked.generations):
        tried = search.ask()
        numbers = jnp.asarray(np.array(tried) * scale, jnp.float32)
        key = jax.random.fold_in(jax.random.key(asked.seed), generation)
        left = [outside(numbers, key, *cell) for cell in CELLS]
        badness = sum(np.mean(np.log(LEAST + np.asarray(each)), axis=1) for each in left)
        search.tell(tried, np.asarray(badness / len(CELLS)).tolist())
        shown = ", ".join(
            f"{name} {value:.3g}" for name, value in zip(BEGIN, search.mean * scale, strict=True)
        )
        print(
            f"{generation + 1}: {np.median(badness) / len(CELLS):.3f}; {shown} "
            f"({time.time() - began:.0f} s)",
            flush=True,
        )


if __name__ == "__main__":
    main()
