"""Shepherds on the same cases, in one table, with the differences to the first of them."""

import csv
import hashlib
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import is_dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import PRNGKeyArray

from skydog import files, quantities
from skydog.errors import Refusal, short
from skydog.shepherds import finding, named
from skydog.study import cases as draws
from skydog.study import evaluate, report
from skydog.study.comparison import Comparison, compared
from skydog.study.options import Starts, Track
from skydog.world import serialise
from skydog.world.mission import MAX_STEPS, Fly, Shepherd
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State

MISSIONS = "results.csv"
LARGEST = 1 << 28  # bytes of a file of results

Measured = dict[str, np.ndarray]


class Entry(NamedTuple):
    """A shepherd of a comparison, what it was named, a mark of what that means by now, its card."""

    shepherd: Shepherd
    named: str | None = None
    digest: str | None = None
    card: Mapping[str, Any] = MappingProxyType({})


class Missions(NamedTuple):
    """What every shepherd flies: one mission per start. `about` says what it is, as plain data."""

    world: World
    starts: State
    steps: int
    key: PRNGKeyArray | None
    about: dict[str, Any]


def compare(
    shepherds: Sequence[str | Shepherd] | Mapping[str, str | Shepherd],
    world: World | None = None,
    cases: int | State = 30,
    starts: Starts | None = None,
    seed: int = 0,
    sheep: int = 3,
    dogs: int = 1,
    steps: int = MAX_STEPS,
    out: str | Path | None = None,
    fly: Fly | None = None,
) -> Comparison:
    """Fly shepherds from the same starts; the result shows itself as a table.

    A shepherd is a name, as `skydog.load` takes it, or a function of world and state; a dict gives
    them names of your own. The first is what the others are compared with. `world` is the preset
    `paper` if not given. `cases` is how many are drawn (`skydog.study.cases.cases`, with `starts`,
    `seed`, `sheep` and `dogs`), or the starts themselves, stacked; `starts` are `paper` for three
    sheep in an open arena if not given, else `random`. A mission that needs more than `steps` has
    failed. `fly` flies the missions, such as `skydog.twin.Twin()`; the kinematic world if not
    given.

    With `out`, the folder has results.json, results.md and results.csv, written after every
    shepherd: the same call continues, and flies who is new. Raises `Refusal` for what cannot be
    flown, before anything is.
    """
    world = preset("paper") if world is None else world
    if starts is None:
        starts = "paper" if sheep == 3 and world.obstacles is None else "random"
    missions = asked(world, cases, starts, seed, sheep, dogs, steps)
    if fly is not None:
        missions.about["flown by"] = str(fly) if is_dataclass(fly) else type(fly).__name__
    return flown(entries(shepherds), missions, None if out is None else Path(out), fly)


def entries(
    shepherds: Sequence[str | Shepherd] | Mapping[str, str | Shepherd],
) -> dict[str, Entry]:
    """Shepherds by what they are called in a table. Raises `Refusal`."""
    if isinstance(shepherds, str) or not isinstance(shepherds, Sequence | Mapping) or not shepherds:
        raise Refusal(f"shepherds are a list or a dict, got {short(shepherds)}; try ['strombom']")
    if isinstance(shepherds, Mapping):
        return {str(name): _entry(each) for name, each in shepherds.items()}
    titles = [_title(each) for each in shepherds]
    found: dict[str, Entry] = {}
    for each, title in zip(shepherds, titles, strict=True):
        name = title if titles.count(title) == 1 else str(each)
        if name in found:
            raise Refusal(f"{name} stands twice; leave one out")
        found[name] = _entry(each)
    return found


def asked(
    world: World,
    cases: int | State,
    starts: Starts,
    seed: int,
    sheep: int,
    dogs: int,
    steps: int,
) -> Missions:
    """The missions of a comparison. Raises `Refusal` for starts that cannot be drawn."""
    steps = quantities.STEPS.checked(steps)
    drawn = (
        draws.cases(world, cases, starts, seed, sheep, dogs) if isinstance(cases, int) else cases
    )
    key = evaluate.noise_key(world, seed)
    where = np.concatenate([np.ravel(drawn.sheep), np.ravel(drawn.dogs)]).astype(np.float32)
    about = {
        "cases": len(drawn.sheep),
        "starts": starts if isinstance(cases, int) else "given",
        "seed": seed,
        "sheep": drawn.sheep.shape[1],
        "dogs": drawn.dogs.shape[1],
        "steps": steps,
        "SHA-256 of the starts": hashlib.sha256(where.tobytes()).hexdigest(),
        "world": files.plain(serialise.flatten(world)),
    }
    return Missions(world, drawn, steps, key, about)


def flown(
    shepherds: dict[str, Entry],
    missions: Missions,
    out: Path | None = None,
    fly: Fly | None = None,
    track: Track = lambda _, things: iter(things),
) -> Comparison:
    """The comparison; with `out`, its rows are kept as they come, and those kept are not flown."""
    for name, entry in shepherds.items():
        named.trial(entry.named or name, entry.shepherd, missions.world, missions.starts)
    # The metrics need the sheep at the start and at the end alone.
    fly = partial(evaluate.fly, every=None) if fly is None else fly
    with nullcontext() if out is None else files.claimed(out):
        kept = {} if out is None else _kept(out, missions.about)
        measured: dict[str, Measured] = {}
        for name, entry in track("Flying", shepherds.items()):
            mark, before = kept.get(name, (None, {}))
            if entry.digest is None or mark != entry.digest:
                world, starts, steps, key, _ = missions
                before = evaluate.measure(fly(world, entry.shepherd, starts, steps, key))
            measured[name] = before
            if out is not None:
                _keep(out, missions.about, shepherds, measured)
        found = compared(measured, missions.about, {n: e.named for n, e in shepherds.items()})
        if out is not None:
            plain = found.plain()
            for name, row in plain["rows"].items():
                row["digest"] = shepherds[name].digest
            report.write(out, plain)
            files.write_text(out / "results.md", found.markdown())
    return found


def _entry(each: str | Shepherd) -> Entry:
    if isinstance(each, str):
        shepherd, card = named.read(each)
        return Entry(shepherd, each, named.digest(each), card)
    if not callable(each):
        raise Refusal(f"a shepherd is a name or a function, got {short(each)}; try 'strombom'")
    return Entry(each)


def _title(each: str | Shepherd) -> str:
    if isinstance(each, str):
        return finding.title(each)
    return getattr(each, "__name__", type(each).__name__)


def _keep(
    out: Path, about: dict[str, Any], shepherds: dict[str, Entry], measured: dict[str, Measured]
) -> None:
    """Write the missions that have been flown, a line each, and whose they are."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    names = list(next(iter(measured.values())))
    lines.writerow(["shepherd", "case", *names])
    for shepherd, by in measured.items():
        for case, values in enumerate(zip(*(by[name] for name in names), strict=True), 1):
            lines.writerow([shepherd, case, *map(float, values)])
    files.write_text(out / MISSIONS, text.getvalue())
    rows = {name: {"digest": shepherds[name].digest} for name in measured}
    report.write(out, {"asked": about, "rows": rows})


def _kept(out: Path, about: dict[str, Any]) -> dict[str, tuple[str | None, Measured]]:
    """What a folder holds of the same missions: by name, its mark and the metrics.

    Raises `Refusal` if the folder holds other missions, or is damaged.
    """
    if not files.exists(out / report.RESULTS):
        return {}
    try:
        results = json.loads(files.read_bytes(out / report.RESULTS, "results", LARGEST))
        marks = {name: row["digest"] for name, row in results["rows"].items()}
        before = results["asked"]
        measured = {}
        if files.exists(out / MISSIONS):
            text = files.read_bytes(out / MISSIONS, "results", LARGEST).decode()
            measured = _measured(csv.reader(io.StringIO(text)), before["cases"])
    except (ValueError, KeyError, TypeError, AttributeError, StopIteration, RecursionError) as odd:
        if isinstance(odd, Refusal):
            raise
        raise Refusal(
            f"{out / report.RESULTS} is of no comparison, or is damaged; choose another --out"
        ) from None
    if other := [name for name in about if before.get(name) != files.plain(about)[name]]:
        raise Refusal(
            f"{out} holds a comparison of other missions ({', '.join(other)}); choose another --out"
        )
    return {name: (mark, measured[name]) for name, mark in marks.items() if name in measured}


def _measured(lines: Iterator[list[str]], cases: int) -> dict[str, Measured]:
    names = next(lines)[2:]
    by: dict[str, list[list[float]]] = {}
    for shepherd, _, *values in lines:
        by.setdefault(shepherd, []).append([float(value) for value in values])
    return {
        shepherd: dict(zip(names, _columns(rows, len(names)), strict=True))
        for shepherd, rows in by.items()
        if len(rows) == cases
    }


def _columns(rows: Iterable[list[float]], count: int) -> np.ndarray:
    return np.array(list(rows)).reshape(-1, count).T
