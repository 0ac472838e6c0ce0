"""The rows of the benchmark's leaderboard: a file for each shepherd, and the best known of a task.

A row is JSON: who flew, the command that made it, what its training cost, and the figures of
each task as `bench.fly` gives them.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skydog import __version__, files
from skydog.errors import Refusal
from skydog.study import bench, best
from skydog.study.options import Results

SHIPPED = Path(__file__).parent / "data" / "board"
LARGEST = 1 << 20  # bytes
PLANS = {"paper-4m": 4.0, "paper-6m": 6.0}
"""Tasks whose cases have best-known plans, and their arenas."""


def blank(name: str, digest: str, command: str, trained: str) -> Results:
    """A row without figures.

    `digest` is what the name means (`named.digest`); `trained` tells what the training cost.
    """
    return {
        "version": bench.VERSION,
        "shepherd": name,
        "digest": digest,
        "command": command,
        "trained": trained,
        "skydog": __version__,
        "tasks": {},
    }


def path(folder: Path, name: str) -> Path:
    """The file of a row: the shepherd's name, with dashes for what no file is called."""
    plain = "".join(each if each.isalnum() or each in "-_.+" else "-" for each in name)
    return folder / f"{plain.strip('.-') or 'shepherd'}.json"


def check_names(folder: Path, names: Sequence[str]) -> None:
    """Raise `Refusal` if the row of one of these shepherds would replace that of another."""
    whose: dict[Path, str] = {}
    for name in names:
        file = path(folder, name)
        other = whose.setdefault(file, read(file)["shepherd"] if files.exists(file) else name)
        if other != name:
            raise Refusal(
                f"{file} is the row of {other}, not of {name}; give {name} another name, or "
                "choose another --out"
            )


def save(folder: Path, row: Results) -> None:
    """Write a row into a folder."""
    text = json.dumps(files.plain(row), indent=1, allow_nan=False, ensure_ascii=False)
    files.write_text(path(folder, row["shepherd"]), text + "\n")


def read(file: Path) -> Results:
    """A row. Raises `Refusal` for a file that is none, or is of another version's cases."""
    content = files.read_bytes(file, "row of the benchmark", LARGEST)
    no_row = Refusal(f"{file} is no row of the benchmark; delete it, or choose another --out")
    try:
        row = json.loads(content)
        version, tasks = row["version"], dict(row["tasks"])
        known = all(
            isinstance(row[name], str) for name in ("shepherd", "digest", "command", "trained")
        )
        fits = all(_fits(each) for each in tasks.values())
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise no_row from None
    if not known or not fits:
        raise no_row
    if version != bench.VERSION:
        raise Refusal(
            f"{file} is of version {version!r:.20} of the benchmark, this is {bench.VERSION}; "
            "fly it again with skydog bench"
        )
    for name, each in tasks.items():
        if name not in bench.TASKS or each["cases of"] != bench.digest(name):
            raise Refusal(
                f"{file} flew other cases of {name!r:.40}; fly it again with skydog bench"
            )
    return row


def _fits(figures: Any) -> bool:
    if "refused" in figures:
        return isinstance(figures["refused"], str) and isinstance(figures["cases of"], str)
    numbers = [figures["success"], *figures["success_ci95"], figures["steps"]["mean"]]
    if not all(isinstance(each, int | float) and np.isfinite(each) for each in numbers):
        return False
    each = figures["each"]
    shown = figures["success"], figures["steps"]["mean"]
    return np.allclose((np.mean(each["success"]), np.mean(each["steps"])), shown)


def rows(*folders: Path) -> dict[str, Results]:
    """The rows of folders by their shepherd's name; a later folder's replaces an earlier one's."""
    found = (read(file) for folder in folders for file in sorted(folder.glob("*.json")))
    return {row["shepherd"]: row for row in found}


def best_known(task: str, board: dict[str, Results]) -> tuple[float, str] | None:
    """The fewest mean steps of a task by a shepherd that accomplished all of it, and who that is.

    Where the cases have best-known plans, those count too. None if nobody accomplished it.
    """
    known = [
        (figures["steps"]["mean"], name)
        for name, row in board.items()
        if (figures := row["tasks"].get(task, {})).get("success") == 1.0
    ]
    if task in PLANS:
        plans = best.steps("paper", PLANS[task])
        assert plans is not None
        known.append((float(np.mean(plans)), "planner"))
    return min(known, default=None)
