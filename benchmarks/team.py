"""Search for the numbers of `skydog.shepherds.team.Team`: the cross-entropy method.

Every candidate flies the same missions of two and three dogs. The numbers that ship are the mean
that such a search ended with, rounded:

    python benchmarks/team.py

It takes 15 minutes on one core. `skydog reproduce --teams` judges them, on starts of another seed.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from skydog.shepherds.team import Team
from skydog.study import cases
from skydog.world import mission, params
from skydog.world.presets import preset

FLOCKS = ((30, 2), (30, 3), (10, 3), (100, 3))  # sheep and dogs
SEEDS = (100, 101)  # taken in turns
MISSIONS = 12
STEPS = 600
CANDIDATES, KEPT = 24, 6
# The least and the greatest value of each number, and where the search begins.
BOUNDS = {
    "spacing": (0.0, 2.0, 0.4),
    "narrow": (0.0, 2.0, 1.2),
    "near": (0.0, 2.0, 0.6),
    "gathered": (0.3, 2.5, 1.2),
    "inward": (0.0, 1.0, 0.3),
    "behind": (0.05, 3.0, 1.4),
    "clearance": (0.0, 1.0, 0.1),
    "shy": (0.0, 6.0, 2.0),
    "aligned": (0.2, 2.0, 0.7),
}


def cost(sheep: int, dogs: int, seed: int) -> Callable[[jax.Array], jax.Array]:
    """A function of candidates, a row of numbers each: the mean steps of each."""
    world = params.traced(preset("strombom2014", sheep=sheep))
    starts = cases.cases(world, MISSIONS, "random", seed, sheep, dogs)
    keys = jax.random.split(jax.random.key(seed), MISSIONS)

    def fly(numbers, start, key):
        team = replace(Team(), **dict(zip(BOUNDS, numbers, strict=True)))

        def on(carry):
            state, taken, _ = carry
            noise = jax.random.fold_in(key, taken)
            state = mission.step(world, state, team(world, state), noise)
            return state, taken + 1, mission.accomplished(world, state)

        def goes_on(carry):
            return (carry[1] < STEPS) & ~carry[2]

        return jax.lax.while_loop(goes_on, on, (start, 0, jnp.asarray(False)))[1]

    each = jax.vmap(jax.vmap(fly, (None, 0, 0)), (0, None, None))
    return jax.jit(lambda candidates: jnp.mean(each(candidates, starts, keys), axis=1))


def main(generations: int) -> None:
    low, high, mean = np.array(list(BOUNDS.values())).T
    spread = (high - low) / 4
    draw = np.random.default_rng(0)
    costs = {(flock, seed): cost(*flock, seed) for flock in FLOCKS for seed in SEEDS}
    for generation in range(generations):
        drawn = mean + spread * draw.standard_normal((CANDIDATES, len(BOUNDS)))
        candidates = np.clip(drawn, low, high)
        candidates[0] = mean
        seed = SEEDS[generation % len(SEEDS)]
        steps = np.mean(
            [costs[flock, seed](jnp.asarray(candidates, jnp.float32)) for flock in FLOCKS], axis=0
        )
        best = candidates[np.argsort(steps)[:KEPT]]
        mean = 0.2 * mean + 0.8 * best.mean(axis=0)
        spread = 0.2 * spread + 0.8 * (best.std(axis=0) + 0.02 * (high - low))
        found = ", ".join(f"{name} {value:.2f}" for name, value in zip(BOUNDS, mean, strict=True))
        print(f"{generation + 1}: {steps.min():.0f} steps; {found}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=14)
    main(parser.parse_args().generations)
