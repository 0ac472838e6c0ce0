"""What came of a comparison of shepherds, and how it shows itself."""

import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from skydog import files
from skydog.study import evaluate, report, statistics

MEASURES = ("steps", "distance")  # of which there are differences
WIDTH = 200  # columns of a table as text


@dataclass(frozen=True)
class Comparison:
    """Shepherds on the same missions: a table, wherever it is shown.

    `rows` has the figures of each shepherd (`skydog.study.evaluate.row`), and `differences` those
    to the first, mission by mission: `success`, `steps` and `distance`, each with `mean` and
    `ci95`. `missions` has every metric of every mission, `asked` what was flown, and `named` what
    each was named.
    """

    rows: dict[str, dict[str, Any]]
    differences: dict[str, dict[str, Any]]
    asked: dict[str, Any]
    named: dict[str, str | None]
    missions: dict[str, dict[str, np.ndarray]] = field(repr=False)

    @property
    def first(self) -> str:
        """The shepherd that the others are compared with."""
        return next(iter(self.rows))

    def plain(self) -> dict[str, Any]:
        """Everything but the single missions, as plain data for JSON."""
        rows = {
            name: {"shepherd": self.named[name], **row}
            | ({f"less {self.first}": self.differences[name]} if name in self.differences else {})
            for name, row in self.rows.items()
        }
        return files.plain({"asked": self.asked, "first": self.first, "rows": rows})

    def columns(self) -> list[str]:
        """The heads of the table."""
        ours = ["shepherd", "success", "steps", "distance (m)"]
        less = ["success", "steps", "distance"] if len(self.rows) > 1 else []
        return ours + [f"{name}, less {self.first}" for name in less]

    def cells(self) -> list[list[str]]:
        """What stands under `columns`, a list a shepherd; a line break parts the interval."""
        return [self._cells(name) for name in self.rows]

    def how_to_read(self) -> str:
        """What the figures are, in sentences."""
        told = (
            f"Each shepherd flew the same {self.asked['cases']:,} missions of at most "
            f"{self.asked['steps']:,} steps. Figures are mean ± SD, with 95 % intervals in "
            "brackets (of success Wilson's, else bootstrap). A mission that failed counts with all "
            "its steps."
        )
        if len(self.rows) > 1:
            told += (
                f" Differences are to {self.first}, mission by mission: where the interval does "
                "not hold 0, there is one at the 5 % level."
            )
        return told

    def table(self) -> Table:
        """The table for a terminal."""
        drawn = Table(
            box=SIMPLE_HEAD,
            show_edge=False,
            padding=0,
            caption=self.how_to_read(),
            caption_justify="left",
        )
        for place, name in enumerate(self.columns()):
            justify = "right" if place else "left"
            drawn.add_column(Text(name.replace(", ", ",\n")), justify=justify, no_wrap=True)
        for row in self.cells():
            drawn.add_row(*map(Text, row))
        return drawn

    def markdown(self) -> str:
        """The table as Markdown, and how to read it."""
        return f"{report.markdown_table(self.columns(), self.cells())}\n{self.how_to_read()}\n"

    def __repr__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=WIDTH, color_system=None).print(self.table())
        return "\n".join(line.rstrip() for line in text.getvalue().rstrip().split("\n"))

    def _repr_html_(self) -> str:
        table = report.html_table(self.columns(), self.cells())
        return f"{table}<p><small>{self.how_to_read()}</small></p>"

    def _cells(self, name: str) -> list[str]:
        row, less = self.rows[name], self.differences.get(name)
        low, high = (100 * bound for bound in row["success_ci95"])
        cells = [
            name,
            f"{report.share(row['success'])}\n[{low:.3g}, {high:.3g}]",
            report.figure(row["steps"], ".0f"),
            report.figure(row["distance"], ".1f"),
        ]
        if len(self.rows) == 1:
            return cells
        if less is None:
            return cells + ["—"] * (1 + len(MEASURES))
        points = 100 * less["success"]["mean"]
        low, high = (100 * bound for bound in less["success"]["ci95"])
        cells.append(f"{points:+.3g} %\n[{low:+.3g}, {high:+.3g}]")
        forms = {"steps": "+.0f", "distance": "+.1f"}
        return cells + [report.figure(_without_sd(less[name]), forms[name]) for name in forms]


def compared(
    measured: dict[str, dict[str, np.ndarray]],
    asked: dict[str, Any],
    named: dict[str, str | None],
) -> Comparison:
    """The comparison of shepherds whose missions have been measured, the first first."""
    first, *others = measured
    than = measured[first]
    differences = {
        name: {
            "success": statistics.paired_share(
                measured[name]["success"] > 0.0, than["success"] > 0.0
            ),
            **{each: statistics.paired(measured[name][each], than[each]) for each in MEASURES},
        }
        for name in others
    }
    rows = {name: evaluate.figures(by) for name, by in measured.items()}
    return Comparison(rows, differences, asked, named, measured)


def _without_sd(summary: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in summary.items() if name != "sd"}
