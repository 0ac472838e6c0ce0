"""El-Fiqi's six patterns: how a flock of 100 starts, and who herds it in how many steps."""

import math
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from skydog import numerics, quantities
from skydog.errors import Refusal, short
from skydog.shepherds.arc import Arc
from skydog.study import cases as draws
from skydog.study import evaluate, statistics
from skydog.study.options import Results, Track
from skydog.world import herding, params
from skydog.world.mission import Fly, Shepherd
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State, start
from skydog.world.trace import Trace
from skydog.world.vectors import norm

# The cells of a grid of 5 by 5 that sheep start in, row by row from the side far from the goal
# (Hebaelfiqi/Shepherding, ShepherdingLibC/Flock.cpp).
PATTERNS = {
    "P1": tuple(range(25)),
    "P2": (1, 2, 3, 6, 7, 8),
    "P3": (1, 3, 10, 12, 14),
    "P4": (0, 4, 10, 14, 22),
    "P5": (2, 10, 14, 20, 24),
    "P6": (0, 4, 20, 24),
}
GRID = 5
# In sides of the arena, x and y: where the grid begins and how wide it is, and where dogs start
# (the same, tools/native_battery.py: 20 to 30 of 50, and 15 to 35 by 45 to 50).
SHEEP_FROM, SHEEP_WIDE = 0.4, 0.2
DOGS_FROM, DOGS_TO = (0.3, 0.9), (0.7, 1.0)

# What they print of their own dog: mean steps of ten missions, all of them accomplished (the
# same, docs/web_simulator_validation.md, column "Native").
PRINTED = {"P1": 81.2, "P2": 91.2, "P3": 85.3, "P4": 261.5, "P5": 260.7, "P6": 281.1}
PRINTED_CASES = 10

SHEEP = 100
CASES = 30
SEED = 0  # the numbers of `Arc` were tuned on seeds from 500 on
STEPS = 2_000  # as they allow
THEIR_DOG, OURS = "elfiqi", "arc"
NAMES = (THEIR_DOG, OURS, "strombom", "h-ddpg-4x4")
"""Who flies: the first is their dog, the others are compared with it."""

FLOCKS = (10, 30, 200)
FLOCK_CASES = 10  # of each pattern

ELSEWHERE = {  # preset, side in metres, sheep
    "paper, 4 m, 3 sheep": ("paper", 4.0, 3),
    "paper, 6 m, 3 sheep": ("paper", 6.0, 3),
    "paper, 12 m, 30 sheep": ("paper", 12.0, 30),
    "strombom2014, 150 m, 46 sheep": ("strombom2014", 150.0, 46),
    "strombom2014, 150 m, 100 sheep": ("strombom2014", 150.0, 100),
}
"""Worlds that nothing was tuned in."""


def lesser(world: World) -> dict[str, Shepherd]:
    """Our dog, and what it is without each of its parts, one at a time, as `elfiqi` has them."""
    f, dog = world.spread.radius(SHEEP), world.dog
    return {
        "arc": Arc(),
        "flies straight to its point": Arc(aligned=math.pi),
        "flies around as far out": Arc(clearance=(dog.collecting + world.flock.reach) / f),
        "collects the furthest stray": Arc(nearness=0.0),
        "collects from f(N) on": Arc(gathered=1.0),
        "stands as far behind": Arc(
            driving=dog.driving * math.sqrt(SHEEP) / f, collecting=dog.collecting / f
        ),
    }


@numerics.ours()
def cases(
    world: World,
    pattern: str,
    count: int = CASES,
    seed: int = SEED,
    sheep: int = SHEEP,
    dogs: int = 1,
) -> State:
    """`count` starts of one of the `PATTERNS`, stacked along a first axis.

    Each sheep draws a cell of the pattern and a place in it; the dogs start near the goal, which
    is meant to be in the middle of the upper side. Everything is in sides of the arena. Raises
    `Refusal` for a pattern that there is not, and for a count below one.
    """
    if not isinstance(pattern, str) or pattern not in PATTERNS:
        raise Refusal(f"no pattern is called {short(pattern)}; choose from {', '.join(PATTERNS)}")
    key = jax.random.key(quantities.SEED.checked(seed))
    keys = jax.random.split(key, quantities.CASES.checked(count))
    sheep, dogs = quantities.SHEEP.checked(sheep), quantities.DOGS.checked(dogs)
    cells = PATTERNS[pattern]
    # All patterns in one shape, so that what is compiled for one serves all.
    padded = jnp.resize(jnp.asarray(cells), (GRID * GRID,))
    return _drawn(params.traced(world), keys, padded, jnp.asarray(len(cells)), sheep, dogs)


@eqx.filter_jit
def _drawn(
    world: World,
    keys: Key[Array, " cases"],
    cells: Int[Array, " cells"],
    count: Int[Array, ""],
    sheep: int,
    dogs: int,
) -> State:
    def draw(key: Key[Array, ""]) -> State:
        for_cell, for_place, for_dogs = jax.random.split(key, 3)
        cell = cells[jax.random.randint(for_cell, (sheep,), 0, count)]
        corner = jnp.stack([cell % GRID, cell // GRID], axis=-1)
        place = (
            SHEEP_FROM + SHEEP_WIDE * (corner + jax.random.uniform(for_place, (sheep, 2))) / GRID
        )
        low, high = jnp.asarray(DOGS_FROM), jnp.asarray(DOGS_TO)
        dog = low + (high - low) * jax.random.uniform(for_dogs, (dogs, 2))
        return start(world.arena.sides * place, world.arena.sides * dog)

    return jax.vmap(draw)(keys)


def unfenced(world: World, starts: State) -> tuple[World, State]:
    """The same missions in the middle of an arena three times as wide: no wall is in reach."""
    arena, size = world.arena, world.arena.size
    wide = replace(arena, size=3 * size, goal_x=arena.goal_x + size, goal_y=arena.goal_y + size)
    moved = replace(starts, sheep=starts.sheep + size, dogs=starts.dogs + size)
    return replace(world, arena=wide), moved


def fly_all(
    shepherds: dict[str, Shepherd], fly: Fly, track: Track
) -> tuple[Results, dict[str, dict[str, Trace]]]:
    """Fly shepherds, by name, on all patterns; with and without walls, and in other worlds.

    The figures, and the first mission of each pattern and shepherd, with walls.
    """
    world = preset("elfiqi2020", sheep=SHEEP)
    parts = ("patterns", "without walls", "lesser", "flocks", "elsewhere")
    results: Results = {part: {} for part in parts}
    first: dict[str, dict[str, Trace]] = {}
    for pattern in track("On the six patterns", PATTERNS):
        starts = cases(world, pattern, CASES, SEED, SHEEP)
        results["patterns"][pattern] = {"least": statistics.summary(_least(world, starts))}
        flown = {name: _flown(fly, world, dog, starts) for name, dog in shepherds.items()}
        results["patterns"][pattern] |= _rows(flown)
        first[pattern] = {name: evaluate.one_case(traces, 0) for name, traces in flown.items()}
        wide, moved = unfenced(world, starts)
        flown = {name: _flown(fly, wide, shepherds[name], moved) for name in (THEIR_DOG, OURS)}
        results["without walls"][pattern] = _rows(flown)
        results["lesser"][pattern] = {
            name: _figures(evaluate.measure(_flown(fly, world, dog, starts)))
            for name, dog in lesser(world).items()
        }
    for sheep in track("Flocks of other sizes", FLOCKS):
        other = preset("elfiqi2020", sheep=sheep)
        drawn = [cases(other, pattern, FLOCK_CASES, SEED, sheep) for pattern in PATTERNS]
        starts = jax.tree.map(lambda *each: jnp.concatenate(each), *drawn)
        flown = {name: _flown(fly, other, dog, starts) for name, dog in shepherds.items()}
        results["flocks"][f"{sheep} sheep"] = _rows(flown)
    for name, (where, size, sheep) in track("In other worlds", ELSEWHERE.items()):
        other = preset(where, size, sheep)
        starts = draws.cases(other, CASES, "random", SEED, sheep)
        flown = {called: _flown(fly, other, dog, starts) for called, dog in shepherds.items()}
        results["elsewhere"][name] = _rows(flown)
    return results, first


def _flown(fly: Fly, world: World, shepherd: Shepherd, starts: State) -> Trace:
    return fly(world, shepherd, starts, STEPS, evaluate.noise_key(world, SEED))


def _rows(flown: dict[str, Trace]) -> Results:
    """A row of figures for each shepherd, that of the first ten, and steps less their dog's."""
    measured = {name: evaluate.measure(traces) for name, traces in flown.items()}
    theirs = measured[THEIR_DOG]["steps"]
    rows: Results = {}
    for name, values in measured.items():
        ten = {metric: each[:PRINTED_CASES] for metric, each in values.items()}
        rows[name] = {
            **_figures(values),
            "first": _figures(ten),
            "less than theirs": statistics.paired(values["steps"], theirs),
        }
    return rows


def _figures(measured: dict[str, np.ndarray]) -> dict[str, Any]:
    row = evaluate.figures(measured)
    return {name: row[name] for name in ("success", "success_ci95", "cases", "steps", "distance")}


def _least(world: World, starts: State) -> Float[np.ndarray, " cases"]:
    """Steps that the sheep with the longest way needs straight to the goal's disc, by case."""
    away = norm(starts.sheep - herding.goal(world.arena)) - world.arena.goal_radius
    stride = world.sheep.speed * world.arena.dt
    return np.ceil(np.asarray(jnp.max(away, axis=1) / stride, np.float64))
