"""The best-known plans of the fixed cases, and steps as times the best known.

A best-known plan is the shortest mission that the planner (`skydog.shepherds.planner`) found for a
case. It is an upper bound of the fewest steps. Nothing proves that there is no shorter one, unless
it takes as few as `metrics.fewest_steps`.
"""

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from skydog.errors import Refusal
from skydog.study import statistics
from skydog.study.options import ShippedStarts

SHIPPED: dict[tuple[ShippedStarts, float], str] = {
    ("paper", 4.0): "plans-paper-4.csv",
    ("paper", 6.0): "plans-paper-6.csv",
    ("random", 4.0): "plans-random-4.csv",
}
"""The file of each set of cases with plans: their starts, and the arena of the preset `paper`."""

FASTEST = 1000.0  # m/s: a velocity beyond it is no plan of ours
LONGEST = 100_000  # steps


@dataclass(frozen=True)
class Plans:
    """The plans of the first cases of a set, for one dog.

    Velocities are in m/s; after its last step each plan holds zeros, so that all have one length.
    """

    steps: Int[np.ndarray, " cases"]
    velocity: Float[np.ndarray, "cases longest dogs 2"]


def plans(starts: ShippedStarts, arena: float) -> Plans | None:
    """The best-known plans of the first of `cases.shipped`, in the world of the preset `paper`.

    They are replayed by `planner.fly`. None for a set or an arena that has none.
    """
    name = SHIPPED.get((starts, float(arena)))
    return None if name is None else _shipped(name)


def steps(starts: ShippedStarts, arena: float) -> Int[np.ndarray, " cases"] | None:
    """The best-known steps of the first of `cases.shipped`; None where there are no plans."""
    known = plans(starts, arena)
    return None if known is None else known.steps


def times_best(
    steps: Int[np.ndarray, " cases"] | Float[np.ndarray, " cases"],
    known: Int[np.ndarray, " known"],
) -> dict[str, Any]:
    """The `statistics.summary` of steps as times the best known, case by case.

    `steps` are a shepherd's on the first cases of a set, as `metrics.steps` counts: a mission that
    failed counts with all that it was given. `known` are the best-known of that set (`best.steps`),
    for at least as many cases. Below 1 the shepherd was faster than the plan. A plan of no steps
    counts as one. Raises `Refusal` for fewer known than flown, or for steps that are no number.
    """
    steps = np.asarray(steps, np.float64)
    if not 1 <= len(steps) <= len(known):
        raise Refusal(
            f"best-known steps are there for {len(known)} cases, not for {len(steps)}; "
            f"give those of the first {len(known)} or fewer"
        )
    if not np.all(np.isfinite(steps)) or np.any(steps < 0):
        raise Refusal("steps are finite numbers from 0 on; give what metrics.steps measured")
    return statistics.summary(steps / np.maximum(known[: len(steps)], 1))


def as_table(found: list[Float[np.ndarray, "_ 2"]]) -> str:
    """Plans of one dog as CSV: a row a case, its steps, then x and y of each step in m/s."""
    longest = max(map(len, found), default=0)
    head = ["case", "steps", *(f"{axis}{step}" for step in range(1, longest + 1) for axis in "xy")]
    rows = [
        [str(case), str(len(plan)), *(f"{number:.3f}" for number in np.ravel(plan))]
        for case, plan in enumerate(found, 1)
    ]
    return "".join(",".join(row) + "\n" for row in (head, *rows)).replace("-0.000", "0.000")


def read(text: str, name: str) -> list[Float[np.ndarray, "_ 2"]]:
    """What `as_table` wrote. Raises `Refusal`, with `name` and the line, for anything else."""
    try:
        lines = list(csv.reader(text.splitlines()))
    except csv.Error as problem:
        raise Refusal(f"{name} holds no plans: {problem}; make plans again") from None
    if not lines or lines[0][:2] != ["case", "steps"]:
        raise Refusal(f"{name} holds no plans: its first line is not case,steps,x1,y1,...")
    return [_row(row, case, f"{name}, line {case + 1},") for case, row in enumerate(lines[1:], 1)]


def _row(row: list[str], case: int, where: str) -> Float[np.ndarray, "_ 2"]:
    try:
        number, steps = int(row[0]), int(row[1])
        velocity = np.array([float(entry) for entry in row[2:]])
    except (ValueError, IndexError):
        raise Refusal(f"{where} is damaged: it does not hold numbers; make plans again") from None
    if number != case:
        raise Refusal(f"{where} is damaged: it is of case {number}, not {case}; make plans again")
    if not 0 <= steps <= LONGEST or len(velocity) != 2 * steps:
        raise Refusal(
            f"{where} is damaged: {len(velocity)} numbers are no x and y of {steps} steps; "
            "make plans again"
        )
    if not np.all(np.abs(velocity) <= FASTEST):
        raise Refusal(f"{where} is damaged: a velocity is no number in m/s; make plans again")
    return velocity.reshape(-1, 2)


@cache
def _shipped(name: str) -> Plans | None:
    file = resources.files("skydog.study").joinpath("data", name)
    if not file.is_file():
        return None
    return padded(read(file.read_text(encoding="utf-8"), name))


def padded(found: list[Float[np.ndarray, "_ 2"]]) -> Plans:
    """Plans of one dog, each with zeros after its last step."""
    counts = np.array([len(plan) for plan in found], int)
    velocity = np.zeros((len(found), counts.max(initial=0), 1, 2), np.float32)
    for whole, plan in zip(velocity, found, strict=True):
        whole[: len(plan), 0] = plan
    return Plans(counts, velocity)
