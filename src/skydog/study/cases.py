"""Cases: the starts that every shepherd of a comparison flies from."""

from dataclasses import replace
from importlib import resources
from operator import index
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key, PRNGKeyArray

from skydog import numerics, quantities
from skydog.errors import Refusal, short
from skydog.numerics import fits
from skydog.study.options import ShippedStarts, Starts
from skydog.world import herding, mission, obstacles, params
from skydog.world.params import World
from skydog.world.state import State, start

# Where the three sheep start, in sides of the arena. The paper does not print its starts;
# these are ours, opposite the goal at (0, 0): gathered in 4 m, and with one to collect first in
# 6 m. For a goal beyond the middle of an axis they are mirrored.
PAPER_LAYOUT = ((0.55, 0.75), (0.60, 0.70), (0.75, 0.35))


@numerics.ours()
def cases(
    world: World,
    count: int = 30,
    starts: Starts = "paper",
    seed: int = 0,
    sheep: int = 3,
    dogs: int = 1,
) -> State:
    """`count` starts, stacked along a first axis: the same for the same arguments.

    `paper`: the three sheep of `PAPER_LAYOUT`, and only the dogs' start varies, uniform in
    the arena (paper, Section "Evaluation in Simulation"). `random`: the sheep vary too, opposite
    the goal, uniform in [L/2, 0.95 L]² for the goal at (0, 0) (`mission.reset`). `anywhere`: they
    are uniform in the arena. Raises `Refusal` for a count below one, unknown starts or,
    with `paper` starts, another number of sheep than three, or a sheep within an obstacle.
    """
    check(starts, sheep, dogs)
    key = jax.random.key(quantities.SEED.checked(seed))
    count = quantities.CASES.checked(count)
    fits(24 * count * (sheep + dogs), f"{count:,} starts of {sheep:,} sheep")
    keys = jax.random.split(key, count)
    return _clear(world, _drawn(params.traced(world), keys, starts, index(sheep), index(dogs)))


def draw(world: World, key: PRNGKeyArray, starts: Starts, sheep: int = 3, dogs: int = 1) -> State:
    """One start, of the kinds that `cases` explains."""
    # Without a memory: it may be moved, and flown in another world.
    drawn = replace(mission.reset(world, key, sheep, dogs), memory=None)
    if starts == "random":
        return drawn
    if starts == "anywhere":
        for_sheep, _ = jax.random.split(key)
        return start(mission.draw_sheep(world, for_sheep, sheep), drawn.dogs)
    return start(_opposite(world, jnp.asarray(PAPER_LAYOUT)) * world.arena.sides, drawn.dogs)


def _opposite(world: World, shares: Float[Array, "*places 2"]) -> Float[Array, "*places 2"]:
    """Places opposite a goal at (0, 0), mirrored to lie opposite this world's goal."""
    beyond = herding.goal(world.arena) > world.arena.sides / 2
    return jnp.where(beyond, 1.0 - shares, shares)


@eqx.filter_jit
def _drawn(
    world: World, keys: Key[Array, " cases"], starts: Starts, sheep: int, dogs: int
) -> State:
    return jax.vmap(lambda key: draw(world, key, starts, sheep, dogs))(keys)


def check(starts: str, sheep: int, dogs: int) -> None:
    """Raise `Refusal` for starts that cannot be drawn."""
    if not isinstance(starts, str) or starts not in get_args(Starts):
        raise Refusal(
            f"no starts are called {short(starts)}; choose from {', '.join(get_args(Starts))}"
        )
    quantities.SHEEP.checked(sheep)
    quantities.DOGS.checked(dogs)
    if starts == "paper" and sheep != len(PAPER_LAYOUT):
        raise Refusal(
            f"the paper starts place {len(PAPER_LAYOUT)} sheep, this flock has {sheep}; "
            "try --starts random"
        )


@numerics.ours()
def shipped(world: World, name: ShippedStarts) -> State:
    """The fixed cases of the simulation study, for an arena of any size.

    `paper`: 30 starts of the UAV with the three sheep of `PAPER_LAYOUT`, as the paper tests.
    `random`: 1,000 in which the three sheep vary too. Both ship as CSV, in sides of the arena,
    for other tools to fly, for a goal at (0, 0); `as_table` made them of `cases` with seed 0 and 1.
    For a goal beyond the middle of an axis they are mirrored.
    """
    if name not in ("paper", "random"):
        raise Refusal(f"no cases called {name!r} ship; choose from paper, random")
    file = resources.files("skydog.study").joinpath("data", f"{name}.csv")
    with file.open(encoding="utf-8") as lines:
        shares = np.loadtxt(lines, delimiter=",", skiprows=1, dtype=np.float32)
    placed = _opposite(world, jnp.asarray(shares.reshape(len(shares), -1, 2))) * world.arena.sides
    return _clear(world, jax.vmap(start)(placed[:, 1:], placed[:, :1]))


def _clear(world: World, drawn: State) -> State:
    """The starts, if no sheep is within an obstacle; those that are drawn never are."""
    if world.obstacles is not None:
        sheep = drawn.sheep.reshape(-1, 2)
        if bool(jnp.any(obstacles.clearance(world.obstacles, sheep) < 0.0)):
            raise Refusal("these starts place sheep within obstacles; try --starts random")
    return drawn


def as_table(world: World, drawn: State) -> str:
    """Cases of one dog as CSV: where the dog and each sheep start, in sides of the arena."""
    shares = jnp.concatenate([drawn.dogs, drawn.sheep], axis=1) / world.arena.sides
    who = ["dog", *(f"sheep{number}" for number in range(1, drawn.sheep.shape[1] + 1))]
    head = [f"{name}_{axis}" for name in who for axis in "xy"]
    # Nine digits bring every float32 back.
    rows = [[f"{share:.9g}" for share in np.ravel(case)] for case in np.asarray(shares)]
    return "".join(",".join(row) + "\n" for row in (head, *rows))
