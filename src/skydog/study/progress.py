"""How good a sheepdog was while it learnt: missions flown by the skills that were kept."""

from math import ceil
from typing import Any

from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, statistics
from skydog.study.cases import cases
from skydog.world.mission import MAX_STEPS, Fly, Shepherd
from skydog.world.params import World
from skydog.world.trace import Trace

CASES = 30
# Of their own: the test has 0, the study 0 and 1, and 2 chooses which of several seeds flies.
SEED = 3
MOST = 50  # sheepdogs that are flown, at most: of a longer training fewer of its steps

Row = dict[str, Any]
"""Of one shepherd: `success`, its interval, `cases`, and the `statistics.summary` of `steps`."""


def fly_all(
    world: World, dogs: dict[int, Shepherd], sheep: int, fly: Fly
) -> tuple[dict[int, Row], Row]:
    """How good each sheepdog is, by the steps that it was taught; and the rule dog beside.

    All fly the same `CASES`, with the sheep anywhere in the arena: from such starts a dog has to
    collect. The first and the last of `dogs` are always flown.
    """
    starts = cases(world, CASES, "anywhere", SEED, sheep)
    steps = sorted(dogs)
    shown = {*steps[:: ceil(len(steps) / MOST)], steps[-1]}
    rows = {step: _row(fly(world, dogs[step], starts, MAX_STEPS, None)) for step in sorted(shown)}
    return rows, _row(fly(world, Strombom(), starts, MAX_STEPS, None))


def csv(rows: dict[int, Row]) -> str:
    """The rows as a table for other tools, with the ends of their 95 % intervals."""
    head = "step,success,success_low,success_high,steps,steps_low,steps_high,cases"
    lines = [
        f"{step},{row['success']:.6g},{row['success_ci95'][0]:.6g},{row['success_ci95'][1]:.6g},"
        f"{row['steps']['mean']:.6g},{row['steps']['ci95'][0]:.6g},{row['steps']['ci95'][1]:.6g},"
        f"{row['cases']}"
        for step, row in rows.items()
    ]
    return "\n".join([head, *lines, ""])


def told(rows: dict[int, Row], rule: Row) -> str:
    """In a line: how many missions it accomplished untaught, early, and at the end."""
    steps = sorted(rows)
    names = {step: f"after {step:,} steps" for step in steps} | {0: "untaught"}
    shown = dict.fromkeys([*steps[:2], steps[-1]])
    parts = [f"{names[step]} {_of(rows[step])}" for step in shown]
    return f"Missions accomplished, sheep anywhere: {', '.join(parts)}; the rule dog {_of(rule)}."


def _of(row: Row) -> str:
    return f"{round(row['success'] * row['cases'])} of {row['cases']}"


def _row(flown: Trace) -> Row:
    measured = evaluate.measure(flown)
    success = measured["success"]
    share, interval = statistics.share(int(success.sum()), len(success))
    return {
        "success": share,
        "success_ci95": interval,
        "cases": len(success),
        "steps": statistics.summary(measured["steps"]),
    }
