"""`skydog reproduce --herdability`: how few dogs capture how many diffusing sheep."""

import json
import math
from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.study import herdability as study
from skydog.study import herdability_page as page
from skydog.study import report
from skydog.study.options import Results
from skydog.view import figures, heat

CELLS = "cells.json"


def run(
    out: Path,
    command: str,
    sheep: tuple[int, ...] = study.SHEEP,
    runs: int = study.RUNS,
    steps: int = study.STEPS,
) -> Results:
    """Fly the herdability map into a run folder, and return its results.

    Cells that were flown before are not flown again.
    """
    kept = Kept(files.folder(out) / CELLS)

    def cell(name: str, many: int, dogs: int, runs: int, steps: int) -> Results:
        return kept.cell(name, many, dogs, runs, steps)

    rows = []
    for many in sheep:
        root = math.sqrt(many)
        found = {
            name: study.least(
                lambda dogs, name=name, many=many: cell(name, many, dogs, runs, steps),
                round(study.GUESS[name] * root),
            )
            for name in study.SHEPHERDS
        }
        equal = study.fewest(found[study.RULE])
        found[study.OURS][equal] = cell(study.OURS, many, equal, runs, steps)
        rows.append(study.row(many, found[study.RULE], found[study.OURS]))
    results = study.summary(rows)
    chart = {
        name: [
            [cell(name, many, dogs, study.MAP_RUNS, study.MAP_STEPS) for many in sheep]
            for dogs in study.MAP_DOGS
        ]
        for name in study.SHEPHERDS
    }
    results["map"] = study.chart(chart)
    report.write(out, results)
    figures.save(heat.chart(results), out / "herdability")
    files.write_text(out / "herdability.md", page.document(results, command))
    console.say(f"Everything is in {out}; read {out / 'herdability.md'}.")
    return results


class Kept:
    """The cells that were flown, in a file that is written after each."""

    def __init__(self, path: Path):
        self.path = path
        self.cells: dict[str, Results] = {}
        try:
            before = json.loads(path.read_text("utf-8"))
        except (OSError, ValueError):
            before = {}
        if isinstance(before, dict) and before.get("asked") == self._asked():
            self.cells = before["cells"]

    def cell(self, name: str, sheep: int, dogs: int, runs: int, steps: int) -> Results:
        """A cell of the map, flown if it was not before."""
        called = f"{name}, {sheep} sheep, {dogs} dogs, {runs} runs of {steps} steps"
        if called not in self.cells:
            with console.missions(runs, called) as update:
                self.cells[called] = study.fly(name, sheep, dogs, runs, steps, update)
            kept = {"asked": self._asked(), "cells": self.cells}
            files.write_text(self.path, json.dumps(kept))
        return self.cells[called]

    def _asked(self) -> Results:
        """What the cells stand on: another seed or other numbers of a shepherd make others."""
        return {"seed": study.SEED, "shepherds": {n: repr(s) for n, s in study.SHEPHERDS.items()}}
