"""The herdability map: how few dogs capture how many sheep that do not hold together.

Lama & di Bernardo 2024 (arXiv 2307.16797) ask for the least number of herders; the figures of the
field are those of Covone et al. 2025 (arXiv 2504.02479; github.com/stefanocovone/shepherding),
measured as here, in the world `lama2024`.
"""

from collections.abc import Callable, Iterable

import jax
import numpy as np
from jaxtyping import Float
from scipy import stats

from skydog.shepherds.lama import Lama
from skydog.shepherds.ring import Ring
from skydog.study import herds, statistics
from skydog.study.herds import NEVER
from skydog.study.options import Progress, Results
from skydog.world.mission import Shepherd
from skydog.world.presets import preset

SHEEP = (4, 25, 64, 100, 225, 400, 625)
RUNS = 50
STEPS = 100_000
DT = 0.05  # seconds, of `lama2024`
CAPTURED = 0.99  # χ, the mean over the runs
SEED = 11  # those that tuned the ring have others
RESAMPLES = 9_999

RULE, OURS = "lama", "ring"
SHEPHERDS: dict[str, Shepherd] = {RULE: Lama(), OURS: Ring()}
PUBLISHED = {"rule": (0.84, -0.18), "PPO": (0.70, -0.46)}
"""Least herders N = a √M + b: of the rule, and with driving learnt by PPO (Covone et al.)."""

GOAL = 0.60  # of √M: ours should be at most that

# The heat map has more cells, of fewer and shorter runs.
MAP_DOGS = range(1, 24, 2)
MAP_RUNS = 10
MAP_STEPS = 10_000

# The number of dogs to begin with, as a share of √M: near where each shepherd's threshold is.
GUESS = {RULE: 0.84, OURS: 0.60}

Cell = Callable[[int], Results]
"""Herds with so many dogs; what came of it."""


def fly(
    name: str,
    sheep: int,
    dogs: int,
    runs: int = RUNS,
    steps: int = STEPS,
    progress: Progress = lambda step, over: None,
) -> Results:
    """A cell of the map, as plain data: what came of each run, in the order of the starts.

    The starts and the noise of two shepherds are the same for the same numbers of sheep and dogs.
    """
    world = preset("lama2024", sheep=sheep)
    begun = herds.starts(world, runs, SEED, sheep, dogs)
    found = herds.herd(world, SHEPHERDS[name], begun, steps, jax.random.key(SEED), progress)
    return {field: values.tolist() for field, values in found._asdict().items()}


def least(cell: Cell, guess: int) -> dict[int, Results]:
    """The cells from `guess` to the threshold: the fewest dogs that capture, and one fewer.

    Walks down while the herd is captured and up while it is not; more dogs are taken to capture
    no worse. Cells by number of dogs.
    """
    found: dict[int, Results] = {}
    dogs = max(1, guess)
    while dogs not in found:
        found[dogs] = cell(dogs)
        dogs += -1 if captured(found[dogs]) else 1
        if dogs == 0:
            break
    return found


def captured(cell: Results) -> bool:
    """Whether the herd counts as captured: χ, averaged over the runs, is at least 0.99."""
    return float(np.mean(cell["share"])) >= CAPTURED


def fewest(cells: dict[int, Results]) -> int:
    """The least number of dogs that capture, among cells by number of dogs."""
    return min(dogs for dogs, cell in cells.items() if captured(cell))


def line(sheep: list[int], dogs: list[int]) -> Results:
    """The straight line N = a √M + b of least squares, with 95 % intervals (Student's t)."""
    line, covariance = np.polyfit(np.sqrt(sheep), dogs, 1, cov=True)
    wide = stats.t.ppf(0.975, len(sheep) - 2) * np.sqrt(np.diag(covariance))
    found: Results = {}
    for name, value, off in zip("ab", line, wide, strict=True):
        found[name] = float(value)
        found[f"{name}_ci95"] = [float(value - off), float(value + off)]
    return found


def settling(cell: Results, steps: int = STEPS) -> Float[np.ndarray, " runs"]:
    """Seconds to the first instant with 99 % home; a run that has none counts with the cap."""
    settled = np.asarray(cell["settled"])
    return DT * np.where(settled == NEVER, steps, settled)


def faster(ours: Float[np.ndarray, " runs"], theirs: Float[np.ndarray, " runs"]) -> Results:
    """By which factor ours settle sooner: a ratio of means, with its 95 % bootstrap interval.

    The runs are paired: the same starts are resampled of both.
    """
    picks = np.random.default_rng(0).integers(0, len(ours), (RESAMPLES, len(ours)))
    ratios = theirs[picks].mean(axis=1) / ours[picks].mean(axis=1)
    low, high = np.percentile(ratios, [2.5, 97.5])
    return {"ratio": float(theirs.mean() / ours.mean()), "ci95": [float(low), float(high)]}


def row(sheep: int, rule: dict[int, Results], ours: dict[int, Results]) -> Results:
    """What the cells of a herd say, by number of dogs: the thresholds, and both at the rule's."""
    fewest_of = {RULE: fewest(rule), OURS: fewest(ours)}
    equal = fewest_of[RULE]
    seconds = {RULE: settling(rule[equal]), OURS: settling(ours[equal])}
    found: Results = {
        "sheep": sheep,
        "runs": len(rule[equal]["share"]),
        "equal": equal,
        "faster": faster(seconds[OURS], seconds[RULE]),
    }
    for name, cells in ((RULE, rule), (OURS, ours)):
        dogs = fewest_of[name]
        all_home = np.asarray(cells[dogs]["captured"]) != NEVER
        found[name] = {
            "fewest": dogs,
            "chi": float(np.mean(cells[dogs]["share"])),
            "chi_one_fewer": float(np.mean(cells[dogs - 1]["share"])) if dogs > 1 else None,
            "all": int(np.sum(all_home)),
            "all_ci95": statistics.share(int(np.sum(all_home)), len(all_home))[1],
            "settled": float(np.mean(settling(cells[dogs]))),
            "settled_at_equal": statistics.summary(seconds[name]),
            "unsettled_at_equal": int(np.sum(np.asarray(cells[equal]["settled"]) == NEVER)),
            "all_at_equal": int(np.sum(np.asarray(cells[equal]["captured"]) != NEVER)),
        }
    return found


def summary(rows: Iterable[Results]) -> Results:
    """The study's results: its rows, and the line of each shepherd."""
    rows = list(rows)
    sheep = [row["sheep"] for row in rows]
    return {
        "rows": rows,
        "lines": {
            name: line(sheep, [row[name]["fewest"] for row in rows]) for name in (RULE, OURS)
        },
        "published": {name: {"a": a, "b": b} for name, (a, b) in PUBLISHED.items()},
    }


def chart(cells: dict[str, list[list[Results]]]) -> dict[str, list[list[float]]]:
    """χ, averaged over the runs of each cell: rows of dogs, columns of sheep."""
    return {
        name: [[float(np.mean(cell["share"])) for cell in line] for line in lines]
        for name, lines in cells.items()
    }
