"""How good a shepherd is while it learns: the same missions flown again and again."""

from math import ceil
from pathlib import Path
from typing import Any

from skydog import files
from skydog.errors import Refusal, short
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, statistics
from skydog.study.cases import cases
from skydog.world.mission import MAX_STEPS, Fly, Shepherd
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.trace import Trace

CASES = 30
# Of their own: the test has 0, the study 0 and 1, and 2 chooses which of several seeds flies.
SEED = 3
MOST = 50  # sheepdogs that are flown, at most: of a longer training fewer of its steps

Row = dict[str, Any]
"""Of one shepherd: `success`, its interval, `cases`, and the `statistics.summary` of `steps`."""


class Evaluation:
    """A callback for any training loop: flies the same missions after every so many steps.

    Call it as often as you like, with the steps so far and the shepherd as it is now. `rows` has
    what was measured, by the step. With a `path` the rows are written there too, as CSV.
    """

    def __init__(
        self,
        world: World,
        starts: State,
        every: int,
        path: str | Path | None = None,
        fly: Fly = evaluate.fly,
    ):
        """`starts` are cases of `skydog.study.cases`, which nothing else should use."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise Refusal(f"every is a whole number of steps from 1 on, got {short(every)}")
        self.world, self.starts, self.every, self.path = world, starts, every, path
        self.rows: dict[int, Row] = {}
        self._fly, self._next = fly, 0

    def __call__(self, step: int, shepherd: Shepherd) -> Row | None:
        """The row of a shepherd; None where fewer than `every` steps passed since the last one."""
        if step < self._next:
            return None
        self._next = step - step % self.every + self.every
        row = _row(self._fly(self.world, shepherd, self.starts, MAX_STEPS, None))
        self.rows[step] = row
        if self.path is not None:
            files.write_text(Path(self.path), csv(self.rows))
        return row

    @property
    def best(self) -> int:
        """The step of the best row so far: most successes, then fewest steps on average.

        The choice is optimistic: fly the best from other starts before you report it.
        """

        def rank(step: int) -> tuple[float, float]:
            row = self.rows[step]
            return -row["success"], row["steps"]["mean"]

        return min(self.rows, key=rank)

    def __str__(self) -> str:
        """In a line: the last row, and the best so far."""
        if not self.rows:
            return "no missions flown yet"
        last, best = max(self.rows), self.best
        shown = {f"after {last:,} steps": last, f"best so far after {best:,}": best}
        return "; ".join(
            f"{when}: {_of(self.rows[step])}, {self.rows[step]['steps']['mean']:.0f} steps each"
            for when, step in shown.items()
        )


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
