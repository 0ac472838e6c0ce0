"""The report: the results table, in a terminal, in Markdown and in one self-contained page."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from skydog import files
from skydog.study import paper
from skydog.study.options import PAPER_FRAME

COLUMNS = (
    "scenario",
    "success",
    "steps",
    "steps (GCM)",
    "distance (m)",
    "paper: success",
    "paper: steps (GCM)",
    "paper: distance (m)",
)
RESULTS = "results.json"
OURS = 5  # columns that are ours; the others are the paper's
HOW_TO_READ = (
    "Each figure is mean ± SD over the cases, with the bootstrap 95 % interval of the mean in "
    "brackets. Steps last until the mission is accomplished, which is when every sheep is home and "
    "gathered unless the world says otherwise; steps (GCM) until the flock's centre is home, which "
    "is what the paper counts."
)

GLOSSARY = {
    "sheep": "A ground robot. It moves away from dogs and keeps a distance from other sheep.",
    "dog": "The drone, which herds.",
    "shepherd": "The program that steers the dog. Strombom is the rule dog: it follows the rules "
    "of Strömbom et al. 2014 and learns nothing. H-DDPG is the sheepdog of the paper, DHRL the one "
    "before it: two learnt skills, and a gate that chooses one of them at each step.",
    "collect, drive": "The two skills. While a sheep is further than f(N) from the GCM, the dog "
    "collects: it flies behind that sheep. Else it drives: it flies behind the flock.",
    "GCM": "Global centre of mass: the mean position of all sheep.",
    "f(N)": "The radius around the GCM within which a flock of N sheep counts as gathered.",
    "ξ": "The side of the arena in which a sheepdog learnt, divided by the side of the arena in "
    "which it flies. The sheepdog sees distances multiplied by ξ. 4x4to6x6 means: it learnt in "
    "4 m × 4 m and flies in 6 m × 6 m.",
    "step": "0.1 s, in which the dog and the sheep move once.",
}


@dataclass(frozen=True)
class Row:
    """One scenario: our figures as `study.evaluate.row` gives them, and the paper's, if any."""

    scenario: str
    ours: dict[str, Any]
    paper: dict[str, Any] | None = None
    verdict: str | None = None  # of `study.verdict`, on ours beside the paper's


def rows(results: dict[str, Any], as_paper: bool = True) -> list[Row]:
    """Results for a table: beside the paper's own figures, if the cases are as the paper's."""
    printed = paper.PRINTED if as_paper else {}
    return [
        Row(name, row, printed.get(name.removesuffix(PAPER_FRAME))) for name, row in results.items()
    ]


def write(out: Path, results: dict[str, Any]) -> None:
    """Write `results.json`."""
    files.write_text(out / RESULTS, json.dumps(files.plain(results), indent=2) + "\n")


def cells(row: Row) -> list[str]:
    """What stands under each of `COLUMNS`, to the digits that the paper prints.

    A line break parts a figure from its interval.
    """
    ours, paper = row.ours, row.paper or {}
    return [
        row.scenario,
        share(ours.get("success"), ours.get("cases")),
        figure(ours.get("steps"), ".0f"),
        figure(ours.get("steps_gcm"), ".0f"),
        figure(ours.get("distance"), ".1f"),
        share(paper.get("success")),
        figure(paper.get("steps"), "g"),
        figure(paper.get("distance"), "g"),
    ]


def table(rows: list[Row]) -> Table:
    """The results, for a terminal of 80 columns: the paper's figures in one column beside ours."""
    drawn = Table(
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=0,
        caption=HOW_TO_READ,
        caption_justify="left",
    )
    beside = ["the paper's own"] if any(row.paper for row in rows) else []
    for name in (*COLUMNS[:OURS], *beside):
        drawn.add_column(name, justify="left" if name == COLUMNS[0] else "right", no_wrap=True)
    for row in rows:
        success, steps, distance = cells(row)[OURS:]
        paper = f"{steps} steps\n{distance} m\n{success}" if row.paper else "—"
        paper += f"\n{row.verdict}" if row.verdict else ""
        drawn.add_row(*map(Text, [*cells(row)[:OURS], *([paper] if beside else [])]))
    return drawn


# The metrics of the paper's "Evaluation Metrics" and ours, by name: how a column calls each, and
# its digits.
METRICS = {
    "cumulative_reward": ("cumulative reward", ".1f"),
    "steps_gcm": ("steps (GCM)", ".0f"),
    "distance": ("distance (m)", ".1f"),
    "error_per_step": ("error a step (m)", ".3f"),
    "dog_to_subgoal": ("dog to subgoal (m)", ".2f"),
    "centre_to_target": ("centre to target, gained a step (m)", ".4f"),
    "turn": ("turn a step (°)", ".0f"),
}


def metrics_table(results: dict[str, Any]) -> Table:
    """Every metric of each scenario, a line a metric, for a terminal."""
    drawn = Table(
        box=SIMPLE_HEAD, show_edge=False, caption=HOW_TO_READ, caption_justify="left", padding=0
    )
    drawn.add_column("")
    lines = {"steps": ("steps", ".0f"), **METRICS}
    for name in results:
        drawn.add_column(name, justify="right")
    drawn.add_row("success", *(share(row["success"], row["cases"]) for row in results.values()))
    for metric, (title, form) in lines.items():
        drawn.add_row(title, *(figure(row[metric], form) for row in results.values()))
    return drawn


def markdown(rows: list[Row]) -> str:
    """The results as a Markdown table."""
    return markdown_table(COLUMNS, [cells(row) for row in rows])


def markdown_table(head: Sequence[str], rows: list[list[str]]) -> str:
    """A table for a document; what a line break parts in a cell stands in one line."""
    lines = [head, ("---", *["---:"] * (len(head) - 1)), *rows]
    return "".join(
        "| " + " | ".join(_one_line(cell).replace("|", "\\|") for cell in line) + " |\n"
        for line in lines
    )


def html_table(head: Sequence[str], rows: list[list[str]]) -> str:
    """A table for a page; what follows a line break in a cell is small."""
    heads = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{_two_lines(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="wide">{table}</div>'


def figures_html(figures: dict[str, str]) -> str:
    """Figures, inline SVG by caption, for a page."""
    return "".join(
        f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, svg in figures.items()
    )


def report(
    rows: list[Row],
    replays: dict[str, str],
    figures: dict[str, dict[str, str]],
    command: str,
    notes: list[str],
) -> str:
    """One HTML page with everything in it.

    By the headings of their sections, `replays` are HTML fragments, and `figures` are inline SVG by
    caption, both from `skydog.view`; `command` is what the user typed and `notes` are sentences,
    as text.
    """
    text = "".join(f"<p>{escape(note)}</p>" for note in notes)
    sections = {
        **replays,
        "Results": glossary_html() + _html(rows),
        **{heading: figures_html(drawn) for heading, drawn in figures.items()},
        "Notes": text,
    }
    return document(
        "Aerial shepherding: results",
        "<p>A drone herds ground robots to a goal, as a sheepdog herds sheep. Each shepherd flew "
        "the same missions. The table shows how well it did, beside what the paper printed. "
        f"Made by <code>{escape(command)}</code>.</p>"
        + "".join(f"<h2>{name}</h2>{body}" for name, body in sections.items() if body),
    )


def glossary_html() -> str:
    """What the words of a table mean, for a page."""
    entries = (f"<dt>{name}</dt><dd>{meaning}</dd>" for name, meaning in GLOSSARY.items())
    return f"<dl>{''.join(entries)}</dl>"


def document(title: str, body: str) -> str:
    """A page of HTML that needs no other file; `title` is text and `body` is markup."""
    template = resources.files("skydog.study").joinpath("report.html").read_text("utf-8")
    return fill(template, title=escape(title), body=body)


def fill(template: str, **values: str) -> str:
    """The template with each `{{name}}` in it replaced, once, by the value of that name."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], template)


def share(value: float | None, cases: int | None = None) -> str:
    """A share as a percentage, and of how many."""
    if value is None:
        return "—"
    return f"{100 * value:.4g} %" + (f"\nof {cases}" if cases is not None else "")


def figure(summary: dict[str, Any] | None, form: str) -> str:
    """Mean ± SD of a `statistics.summary`, and below them the interval."""
    if summary is None:
        return "—"
    text = format(summary["mean"], form)
    if "sd" in summary:
        text += f" ± {summary['sd']:{form}}"
    if "ci95" in summary:
        low, high = summary["ci95"]
        text += f"\n[{low:{form}}, {high:{form}}]"
    return text


def _html(rows: list[Row]) -> str:
    return html_table(COLUMNS, [cells(row) for row in rows]) + (
        f'<p class="quiet">{HOW_TO_READ}</p>'
    )


def _one_line(cell: str) -> str:
    return cell.replace("\n", " ")


def _two_lines(cell: str) -> str:
    figure, *interval = escape(cell).split("\n")
    return figure + "".join(f"<br><small>{line}</small>" for line in interval)
