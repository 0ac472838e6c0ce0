"""The leaderboard as Markdown."""

import statistics
from typing import Any

from skydog.shepherds import finding
from skydog.study import bench, board, report
from skydog.study.options import Results

GOOD = 0.95  # the share of missions from which on a task counts as accomplished

INTRODUCTION = (
    "The benchmark is a fixed list of tasks with fixed starts: version {version}, "
    "`bench-{version}.safetensors`, SHA-256 `{digest}`. All shepherds fly the same "
    "cases with the same noise, at the speed limits of the task's world.",
    "A mission that fails counts with all the steps that it was given. *Times best* is a task's "
    "mean steps divided by the best known: the fewest of a shepherd that accomplishes all its "
    "missions, or, for the paper's cases, those of the best-known plans.",
)

HEAD = ["shepherd", "tasks accomplished", "times best, median", "not run", "trained", "command"]


def document(rows: dict[str, Results], command: str) -> str:
    """The whole page, of rows by their shepherd's name. `command` made it."""
    digest = bench.SHA256
    parts = ["# The leaderboard", f"Made by `{command}`."]
    parts += [text.format(version=bench.VERSION, digest=digest) for text in INTRODUCTION]
    parts += [
        "## Shepherds",
        f"A task counts as accomplished if at least {100 * GOOD:g} % of its missions are. The "
        "median is over the tasks that a shepherd accomplished.",
        report.markdown_table(HEAD, overview(rows)),
        "## Tasks",
        "In each cell: the share of missions that were accomplished, if not all, with its Wilson "
        "95 % interval; and the mean steps, as times the best known.",
        report.markdown_table(*tasks(rows)),
        "## What was not run",
        not_run(rows),
    ]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def overview(rows: dict[str, Results]) -> list[list[str]]:
    """A line for each shepherd, those that accomplish most tasks first."""
    lines = []
    for name, row in rows.items():
        flown = {task: each for task, each in row["tasks"].items() if "refused" not in each}
        done = [task for task, each in flown.items() if each["success"] >= GOOD]
        times = [_times(task, flown[task], rows) for task in done]
        known = [each for each in times if each is not None]
        missing = [task for task in bench.TASKS if task not in flown]
        median = f"{statistics.median(known):.2f}" if known else "—"
        cells = [f"`{name}`", f"{len(done)} of {len(bench.TASKS)}", median, str(len(missing))]
        lines.append((-len(done), median, [*cells, row["trained"], f"`{row['command']}`"]))
    return [line for *_, line in sorted(lines)]


def tasks(rows: dict[str, Results]) -> tuple[list[str], list[list[str]]]:
    """A line for each task, and a column for each shepherd."""
    body = []
    for name, task in bench.TASKS.items():
        known = board.best_known(name, rows)
        steps = "—" if known is None else f"{known[0]:.0f} ({known[1]})"
        cells = [cell(name, row["tasks"].get(name), rows) for row in rows.values()]
        body.append([f"`{name}`: {task.says}", steps, *cells])
    return ["task", "best known steps", *rows], body


def cell(task: str, figures: dict[str, Any] | None, rows: dict[str, Results]) -> str:
    """What a shepherd reached in a task."""
    if figures is None or "refused" in figures:
        return "—"
    times = _times(task, figures, rows)
    steps = f"{figures['steps']['mean']:.0f}" + ("" if times is None else f" (×{times:.2f})")
    if figures["success"] == 1.0:
        return steps
    low, high = figures["success_ci95"]
    share = f"{100 * figures['success']:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{share}, {steps}" if figures["success"] > 0.0 else share


def not_run(rows: dict[str, Results]) -> str:
    """Which shepherds that ship have no row; in which tasks others were not flown, and why."""
    without = [f"`{name}`" for name in (*finding.RULES, *finding.ships()) if name not in rows]
    lines = [f"- These ship, and have no row yet: {', '.join(without)}."] if without else []
    for name, row in rows.items():
        reasons: dict[str, list[str]] = {}
        for task in bench.TASKS:
            figures = row["tasks"].get(task)
            if figures is None:
                reasons.setdefault("not flown", []).append(task)
            elif "refused" in figures:
                reasons.setdefault(figures["refused"], []).append(task)
        lines += [f"- `{name}`: {', '.join(each)} ({why})" for why, each in reasons.items()]
    return "\n".join(lines) or "All shepherds were flown in all tasks."


def _times(task: str, figures: dict[str, Any], rows: dict[str, Results]) -> float | None:
    known = board.best_known(task, rows)
    return None if known is None else figures["steps"]["mean"] / known[0]
