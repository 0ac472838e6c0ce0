"""A flock in which sheep differ: some hardly fear the dog, some are slow.

Fly it:   skydog test h-ddpg-4x4 --world examples/mixed_flock.py:world --sheep 10 --starts random
"""

from dataclasses import replace

import jax.numpy as jnp

import skydog
from skydog.study import evaluate
from skydog.study.cases import cases


def world(arena: float = 8.0, sheep: int = 10, bold: float = 0.2) -> skydog.World:
    """The paper's world, in which the first sheep are bold and every other one is slow.

    A parameter of the sheep is one number, or an array with one number per sheep.
    """
    usual = skydog.preset("paper", arena, sheep)
    number = jnp.arange(sheep)
    escape = jnp.where(number < bold * sheep, 0.3, usual.flock.escape)
    speed = jnp.where(number % 2 == 0, usual.sheep.speed, 0.5 * usual.sheep.speed)
    return replace(
        usual,
        flock=replace(usual.flock, escape=escape),
        sheep=replace(usual.sheep, speed=speed),
    )


def main(count: int = 100) -> dict[str, dict]:
    """Fly the shipped sheepdog with flocks that are more and more bold; return the rows."""
    dog, rows = skydog.load("h-ddpg-4x4"), {}
    starts = cases(world(), count, starts="random", seed=1, sheep=10)
    for name, here in {
        "all alike": skydog.preset("paper", 8.0, 10),
        "half are slow": world(bold=0.0),
        "20 % bold too": world(bold=0.2),
    }.items():
        rows[name] = row = evaluate.row(evaluate.fly(here, dog, starts))
        print(f"{name:14} {row['success']:.0%} in {row['steps']['mean']:.0f} steps")
    return rows


if __name__ == "__main__":
    main()
