"""Teams: how many steps several dogs need, beside one, and how near they come to each other."""

import jax.numpy as jnp
import numpy as np

from skydog.study import evaluate, statistics
from skydog.study.cases import cases
from skydog.study.options import Results, Track
from skydog.world.mission import Fly, Shepherd
from skydog.world.presets import preset
from skydog.world.trace import Trace

PRESET = "strombom2014"
FLOCKS = (10, 30, 100)
DOGS = (1, 2, 3)
CASES = 50
SEED = 11  # the numbers of `Team` were tuned on seeds 100 and 101
STEPS = 1_500
NAMES = ("strombom", "h-ddpg-4x4", "arc", "team", "team:h-ddpg-4x4")
"""Who flies: the first is what the others are measured against."""


def fly_all(shepherds: dict[str, Shepherd], fly: Fly, track: Track) -> tuple[Results, Trace]:
    """Rows of figures by flock, shepherd and number of dogs, and a mission of three dogs to show.

    The sheep of a case start at the same places for every shepherd and number of dogs.
    `share of one rule dog` is the ratio of the mean steps to those of one dog of the first
    shepherd, `share of one` to those of one dog of the same shepherd; both with the bootstrap
    95 % interval over cases.
    """
    results: Results = {}
    for sheep in FLOCKS:
        rows: Results = {}
        steps: dict[tuple[str, int], np.ndarray] = {}
        for name in track(f"{sheep} sheep", list(shepherds)):
            for dogs in DOGS:
                world = preset(PRESET, sheep=sheep)
                starts = cases(world, CASES, "random", SEED, sheep, dogs)
                key = evaluate.noise_key(world, SEED)
                flown = fly(world, shepherds[name], starts, STEPS, key)
                measured = evaluate.measure(flown)
                steps[name, dogs] = measured["steps"]
                row = evaluate.figures(measured)
                rows.setdefault(name, {})[str(dogs)] = row | {"nearest": _nearest(flown)}
        first = next(iter(shepherds))
        for name, by in rows.items():
            for dogs in DOGS:
                own = steps[name, dogs]
                by[str(dogs)]["share of one rule dog"] = _ratio(own, steps[first, 1])
                by[str(dogs)]["share of one"] = _ratio(own, steps[name, 1])
        results[str(sheep)] = rows
    return {"flocks": results}, _shown(shepherds["team"])


def _shown(shepherd: Shepherd) -> Trace:
    world = preset(PRESET, sheep=30)
    starts = cases(world, 1, "random", SEED, 30, 3)
    flown = evaluate.fly(world, shepherd, starts, 400, evaluate.noise_key(world, SEED))
    return evaluate.one_case(flown, 0)


def _nearest(flown: Trace) -> float | None:
    """The least distance in metres between two dogs in all missions; None for one dog."""
    dogs = flown.dogs
    if dogs.shape[2] == 1:
        return None
    apart = jnp.linalg.norm(dogs[:, :, :, None] - dogs[:, :, None, :], axis=-1)
    return float(jnp.min(jnp.where(jnp.eye(dogs.shape[2], dtype=bool), jnp.inf, apart)))


def _ratio(ours: np.ndarray, theirs: np.ndarray) -> Results:
    """The ratio of two means over the same cases, and its bootstrap 95 % interval."""
    draw = np.random.default_rng(0)
    picked = draw.integers(0, len(ours), (statistics.RESAMPLES, len(ours)))
    ratios = ours[picked].mean(axis=1) / theirs[picked].mean(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return {"mean": float(ours.mean() / theirs.mean()), "ci95": [float(low), float(high)]}
