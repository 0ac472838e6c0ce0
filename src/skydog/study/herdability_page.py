"""The herdability map as a document and as a table."""

import math

from rich.box import SIMPLE_HEAD
from rich.table import Table

from skydog.study import report
from skydog.study.herdability import (
    CAPTURED,
    DT,
    GOAL,
    MAP_DOGS,
    MAP_RUNS,
    MAP_STEPS,
    OURS,
    PUBLISHED,
    RULE,
    RUNS,
    STEPS,
)
from skydog.study.options import Results

HEAD = [
    "M",
    "√M",
    "published rule, PPO",
    "rule: fewest dogs",
    "χ with one fewer",
    "ring: fewest dogs",
    "of √M",
    "χ with one fewer",
    "all home, rule",
    "all home, ring",
]
AT_EQUAL = [
    "M",
    "dogs",
    "rule settles (s)",
    "ring settles (s)",
    "sooner by",
    "all home, rule",
    "all home, ring",
]


def fewest_rows(results: Results) -> list[list[str]]:
    """A row a herd: the least number of dogs of each shepherd."""
    body = []
    for row in results["rows"]:
        root, rule, ours = math.sqrt(row["sheep"]), row[RULE], row[OURS]
        printed = ", ".join(f"{a * root + b:.1f}" for a, b in PUBLISHED.values())
        body.append(
            [
                f"{row['sheep']}",
                f"{root:g}",
                printed,
                f"{rule['fewest']}",
                _chi(rule["chi_one_fewer"]),
                f"{ours['fewest']}",
                f"{ours['fewest'] / root:.2f}",
                _chi(ours["chi_one_fewer"]),
                _all(row, RULE, "all"),
                _all(row, OURS, "all"),
            ]
        )
    return body


def equal_rows(results: Results) -> list[list[str]]:
    """A row a herd: how soon both settle with as many dogs as the rule needs."""
    return [
        [
            f"{row['sheep']}",
            f"{row['equal']}",
            _seconds(row, RULE),
            _seconds(row, OURS),
            f"{row['faster']['ratio']:.1f} × [{row['faster']['ci95'][0]:.1f}, "
            f"{row['faster']['ci95'][1]:.1f}]",
            _all(row, RULE, "all_at_equal"),
            _all(row, OURS, "all_at_equal"),
        ]
        for row in results["rows"]
    ]


def lines(results: Results) -> list[list[str]]:
    """A row a line N = a √M + b: the published ones and ours, with intervals."""
    body = [[f"published, {name}", f"{a:.2f}", f"{b:.2f}"] for name, (a, b) in PUBLISHED.items()]
    for name, called in ((RULE, "the rule, here"), (OURS, "ring")):
        line = results["lines"][name]
        body.append([called, *(_interval(line[part], line[f"{part}_ci95"]) for part in "ab")])
    return body


def summary(results: Results) -> Table:
    """What the command prints."""
    shown = Table(box=SIMPLE_HEAD)
    for column in HEAD:
        shown.add_column(column, justify="right")
    for row in fewest_rows(results):
        shown.add_row(*row)
    return shown


def document(results: Results, command: str) -> str:
    """The study as Markdown."""
    most = max(row[OURS]["fewest"] / math.sqrt(row["sheep"]) for row in results["rows"])
    slowest = min(row["faster"]["ratio"] for row in results["rows"])
    return f"""# Herdability: how few dogs for how many sheep

Made by `{command}`. The question is that of Lama & di Bernardo 2024 (arXiv 2307.16797): how few \
herders N capture M targets that do not hold together? The figures of the field are those of \
Covone et al. 2025 (arXiv 2504.02479). The [glossary](glossary.md) explains the words.

## What is measured

- The world is the preset `lama2024`: a box of 50 m, a goal of radius 5 m in its middle, sheep \
that diffuse (D = 1 m²/s) and that a dog pushes at 3 (2.5 − d) m/s from a distance d below 2.5 m, \
dogs of 8 m/s, a step of {DT:g} s.
- Sheep and dogs start on a ring around the goal, from 6 to 22.5 m. A run ends when every sheep is \
home at one instant, or after {STEPS:,} steps ({STEPS * DT:,.0f} s).
- χ of a run is the largest share of the sheep that was home at one instant. A herd counts as \
captured if χ, averaged over {RUNS} runs, is at least {CAPTURED:g}. *Fewest dogs* is the least N \
that captures; N − 1 was flown too, and its χ stands beside it.
- A run settles at the first instant with 99 % of the sheep home, which is every sheep of fewer \
than 100; one that never does counts with the cap.
- The starts and the noise of both shepherds are the same, run by run. What tuned the ring had \
other seeds.
- A dog flies at most 8 m/s on each axis, 11.3 on a diagonal, as in Covone's code. Lama & di \
Bernardo limit the velocity's length.

The *rule* is that of Lama & di Bernardo (`skydog test lama --preset lama2024`), the *ring* is \
ours ([`Ring`](#skydog.shepherds.ring.Ring), `skydog test ring --preset lama2024`).

## The fewest dogs

{report.markdown_table(HEAD, fewest_rows(results))}

The ring needs at most {most:.2f} √M; the goal was {GOAL:.2f}.

{report.markdown_table(["N = a √M + b", "a", "b"], lines(results))}

Intervals are 95 %, of a line through {len(results["rows"])} numbers.

## How soon, with as many dogs

{report.markdown_table(AT_EQUAL, equal_rows(results))}

Means over {RUNS} runs with 95 % bootstrap intervals; the factor is a ratio of means, its runs \
paired. The least is {slowest:.1f}; the goal was 4.

## The map

![χ by the number of dogs and √M](herdability.png)

Each cell of the map is {MAP_RUNS} runs of at most {MAP_STEPS:,} steps \
({MAP_STEPS * DT:g} s), for every other number of dogs up to {MAP_DOGS[-1]}; the \
thresholds on it are those of the table.
"""


def _chi(value: float | None) -> str:
    return "—" if value is None else f"{value:.3f}"


def _interval(value: float, interval: list[float]) -> str:
    return f"{value:.2f} [{interval[0]:.2f}, {interval[1]:.2f}]"


def _seconds(row: Results, name: str) -> str:
    settled, failed = row[name]["settled_at_equal"], row[name]["unsettled_at_equal"]
    low, high = settled["ci95"]
    never = f", {failed} never" if failed else ""
    return f"{settled['mean']:.0f} [{low:.0f}, {high:.0f}]{never}"


def _all(row: Results, name: str, which: str) -> str:
    return f"{row[name][which]} of {row['runs']}"
