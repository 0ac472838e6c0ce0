"""The study of the ways home as Markdown and for a terminal."""

from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable

from skydog.study import navigate, report
from skydog.study.options import Results
from skydog.study.page import Table

TITLES = {
    "known": "On a map that is right",
    "wrong": "On a map that is wrong",
    "moving": "Among obstacles that move",
}

INTRODUCTION = (
    "Three ways home, flown by the same skills collect and drive, those of `h-ddpg-4x4`. The "
    "`field` has a map: the geodesic distance home "
    "([`AroundHome`](#skydog.world.home.AroundHome)). `navigate` has none: its third skill sees "
    "how far the way is free in 16 directions, 4 m at most "
    "([`skydog.shepherds.navigate`](#skydog.shepherds.navigate)). `straight` knows nothing of "
    "obstacles.",
    f"Each cell is of {navigate.SHEEP} sheep and {navigate.CASES} random starts, the same ones "
    "for all three. Success has "
    "its Wilson 95 % interval. Steps are mean ± SD; a mission that fails counts with all its "
    f"{navigate.STEPS:,} steps. A cell of `navigate` or `straight` is marked ▲ where it succeeds "
    "more often than the field, and ▼ where less often (McNemar's exact test, 5 %, each row by "
    "itself).",
)


def table(results: Results, part: str) -> Table:
    """Success and steps of one part of the study, a line each."""
    rows = [
        [where, *(_cell(by[way]) for way in navigate.WAYS)] for where, by in results[part].items()
    ]
    return ["success, steps", *navigate.WAYS], rows


def _cell(row: Results) -> str:
    low, high = row["success_ci95"]
    mark = {1: " ▲", -1: " ▼", 0: ""}[row["against the field"]["sign"]]
    steps = report.figure(row["steps"], ".0f").split("\n")[0]
    return f"{report.share(row['success'])} [{100 * low:.0f}, {100 * high:.0f}], {steps}{mark}"


def summary(results: Results) -> RichTable:
    """All parts in one table, for a terminal."""
    drawn = RichTable(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for number, name in enumerate(table(results, "known")[0]):
        drawn.add_column(name, justify="right" if number else "left", overflow="fold")
    for part in TITLES:
        for cells in table(results, part)[1]:
            drawn.add_row(*cells)
        drawn.add_section()
    return drawn


def document(results: Results, command: str) -> str:
    """The tables as Markdown."""
    lines = [f"Made by `{command}`.", ""]
    for paragraph in INTRODUCTION:
        lines += [paragraph, ""]
    for part, title in TITLES.items():
        lines += [f"## {title}", "", report.markdown_table(*table(results, part))]
    return "\n".join(lines)
