"""The paper's physical study: four rows beside its own, and what physics costs a sheepdog.

What flies a mission is given: this room knows no physics. A `Setting` says how to fly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape

import jax
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable

from skydog.flight.options import Steering
from skydog.study import evaluate, paper, report, verdict
from skydog.study.options import FlyableStarts, Results
from skydog.world.mission import MAX_STEPS, Fly, Shepherd
from skydog.world.params import World
from skydog.world.presets import at_speed, furthest_first, preset
from skydog.world.state import State
from skydog.world.trace import ENDINGS, Trace


@dataclass(frozen=True)
class Setting:
    """How missions are flown: by which bodies, and what goes wrong. None is the kinematic world."""

    profile: str | None = "tum-simulator"
    disturb: str = "none"
    wait: float | None = None  # m: the waypoint's tolerance, if the next set-point waits for it
    steering: Steering = "reference"
    ideal: tuple[str, ...] = ()  # bodies that move as decided


@dataclass(frozen=True)
class Mission:
    """A line of a table: who flies, how, where from, and how fast."""

    dog: str  # as it ships
    setting: Setting
    speed: float  # share of the speeds of the paper's Section 5
    starts: FlyableStarts
    cases: int
    steps: int
    gate_as_paper: bool = False  # the furthest stray first
    seed: int = 0

    def world(self) -> World:
        """The world of the line."""
        world = at_speed(preset("paper-physical"), self.speed)
        return furthest_first(world) if self.gate_as_paper else world


Flies = Callable[[Setting], Fly]
"""What flies by a setting."""

Draws = Callable[[World, Mission], State]
"""What draws the starts of a line."""

# The speeds that the paper flew at in its Section 6, which it does not print, as a share of those
# of Section 5. At a sixth our missions are a quarter too short; the first makes the 6 x 6 dog's Sim
# row as long as the paper's. `benchmarks/fit_physical.py` shows the search.
FITTED_SPEED = 0.12
SPEEDS = {"fitted, 0.12": FITTED_SPEED, "a sixth": 1.0 / 6.0, "full": 1.0}
TOLERANCE = 0.1  # m, of a waypoint; fitted, with the gusts of `lab`, on the 6 x 6 dog's Phy row
CASES = 30  # besides the paper's three

SIM = Setting("tum-simulator")
PHY = Setting("ardrone2", "lab", wait=TOLERANCE)
ROWS = {
    "H-DDPG-6x6-Sim": ("h-ddpg-6x6", SIM),
    "H-DDPG-4x4to6x6-Sim": ("h-ddpg-4x4", SIM),
    "H-DDPG-6x6-Phy": ("h-ddpg-6x6", PHY),
    "H-DDPG-4x4to6x6-Phy": ("h-ddpg-4x4", PHY),
}

# What physics costs, a cause at a time.
CAUSES = {
    "kinematic": Setting(None),
    "rovers turn": Setting(ideal=("dogs",)),
    "the drone lags": Setting(ideal=("sheep",)),
    "both: tum-simulator": Setting(),
    "and delay, drag: ardrone2": Setting("ardrone2"),
    "and noise: ardrone2, lab": Setting("ardrone2", "lab"),
    "crazyflie, lab": Setting("crazyflie", "lab"),
    "tum-simulator, rovers track": Setting(steering="track"),
    "tum-simulator, rovers turn, then drive": Setting(steering="turn"),
}
# Of the other dogs than the first, and at a sixth of the speed.
FOR_ALL = (
    "kinematic",
    "the drone lags",
    "both: tum-simulator",
    "and delay, drag: ardrone2",
    "and noise: ardrone2, lab",
)
AT_A_SIXTH = ("kinematic", "both: tum-simulator")
GAP_CASES, LAB_CASES = 100, 1000
METRICS = ("steps_gcm", "distance", "error_per_step", "dog_to_subgoal", "centre_to_target")


UNTAUGHT = ("h-ddpg-6x6", "h-ddpg-4x4")
TAUGHT = ("h-ddpg-6x6-physical", "h-ddpg-4x4-physical")
"""The sheepdogs whose lessons had bodies that obey late."""


def missions(dogs: tuple[str, ...]) -> dict[str, Mission]:
    """Every line of the study by name: the paper's rows, then what physics costs `dogs`."""
    lines = {}
    for called, speed in SPEEDS.items():
        for name, (dog, setting) in ROWS.items():
            cases = paper.PHYSICAL_CASES + CASES
            lines[f"{name}, {called}"] = Mission(
                dog, setting, speed, "paper", cases, 2 * MAX_STEPS, gate_as_paper=True
            )
    for dog in dogs:
        first = dog == dogs[0]
        for cause in CAUSES if first else FOR_ALL:
            lines[f"{dog}: {cause}, full"] = Mission(
                dog, CAUSES[cause], 1.0, "spaced", GAP_CASES, MAX_STEPS
            )
        for cause in AT_A_SIXTH:
            lines[f"{dog}: {cause}, a sixth"] = Mission(
                dog, CAUSES[cause], SPEEDS["a sixth"], "spaced", GAP_CASES, MAX_STEPS
            )
    for dog in UNTAUGHT:
        lab = Mission(dog, Setting("ardrone2", "lab"), 1.0, "spaced", LAB_CASES, MAX_STEPS, seed=1)
        lines[f"{dog}: lab"] = lab
    return lines


def fly(line: Mission, dog: Shepherd, flies: Flies, draws: Draws) -> tuple[Results, Trace]:
    """The figures of a line that a dog flies, and its first mission."""
    world = line.world()
    flown = flies(line.setting)(
        world, dog, draws(world, line), line.steps, jax.random.key(line.seed)
    )
    measured = evaluate.measure(flown)
    result = evaluate.figures(measured)
    if line.starts == "paper":
        first = {name: values[: paper.PHYSICAL_CASES] for name, values in measured.items()}
        result["first"] = evaluate.figures(first)
    if flown.ending is not None:
        ways = np.bincount(np.asarray(flown.ending.how), minlength=len(ENDINGS))
        result["endings"] = {ENDINGS[way]: int(count) for way, count in enumerate(ways) if count}
    return result, evaluate.one_case(flown, 0)


Table = tuple[list[str], list[list[str]]]


def rows_table(results: Results, called: str) -> Table:
    """The paper's four rows at a speed: ours of all cases, of the first three, the paper's, and
    the verdict on ours of all cases beside the paper's three."""
    head = ["row", "success", *(report.METRICS[metric][0] for metric in METRICS)]
    body = []
    for name, printed in paper.PHYSICAL.items():
        ours = results[f"{name}, {called}"]
        for who, row in ((name, ours), ("its first three", ours["first"]), ("the paper", printed)):
            body.append(
                [who, report.share(row["success"], row.get("cases"))]
                + [report.figure(row[metric], _form(metric)) for metric in METRICS]
            )
        body.append(
            ["ours, as a share of the paper's", ""]
            + [f"{ours[metric]['mean'] / printed[metric]['mean']:.2f}" for metric in METRICS]
        )
        held = verdict.verdicts(
            ours, {**printed, "steps": printed["steps_gcm"]}, paper.PHYSICAL_CASES
        )
        # Those of which the paper prints enough digits.
        words = {
            "success": held["success"],
            "steps_gcm": held["steps"],
            "distance": held["distance"],
        }
        body.append(["verdict", *(words.get(metric, "—") for metric in ("success", *METRICS))])
    return head, body


def gap_table(results: Results, dogs: tuple[str, ...]) -> Table:
    """What physics costs each dog in steps, a cause a line."""
    head = [
        "flown by",
        *(f"{dog}: {what}" for dog in dogs for what in ("success", "steps", "more")),
    ]
    body = []
    for speed in ("full", "a sixth"):
        for cause in CAUSES:
            if f"{dogs[0]}: {cause}, {speed}" not in results:
                continue
            cells = [f"{cause}, {speed} speed"]
            for dog in dogs:
                row = results.get(f"{dog}: {cause}, {speed}")
                if row is None:
                    cells += ["—"] * 3
                    continue
                base = results[f"{dog}: kinematic, {speed}"]["steps"]["mean"]
                cells += [
                    report.share(row["success"]),
                    report.figure(row["steps"], ".0f"),
                    f"{100 * (row['steps']['mean'] / base - 1):+.1f} %",
                ]
            body.append(cells)
    return head, body


def lab_table(results: Results) -> Table:
    """Success in an emulated laboratory, over many starts."""
    head = ["ardrone2, lab", "success", "steps", "error a step (m)", "ended"]
    body = []
    for dog in UNTAUGHT:
        row = results[f"{dog}: lab"]
        ended = ", ".join(f"{count} {how}" for how, count in row["endings"].items())
        body.append(
            [
                dog,
                report.share(row["success"], row["cases"]),
                report.figure(row["steps"], ".0f"),
                report.figure(row["error_per_step"], ".3f"),
                ended,
            ]
        )
    return head, body


def summary(results: Results) -> RichTable:
    """The four rows at the fitted speed, for a terminal."""
    head, body = rows_table(results, next(iter(SPEEDS)))
    drawn = RichTable(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for number, name in enumerate(head):
        drawn.add_column(name, justify="right" if number else "left", overflow="fold")
    for cells in body:
        drawn.add_row(*(cell.split("\n")[0] for cell in cells))
    return drawn


NOTES = (
    "The paper flies its Section 6 at dt 0.2 s and prints no speed. At the speeds of its Section 5 "
    "a mission of this kind takes some 80 steps, where it prints 505 and more. At a sixth of them "
    "ours are still shorter than the paper's. The share 0.12 was chosen so that the 6 x 6 dog's "
    "Sim row has the paper's steps: there, a verdict of compatible on the steps is no test. The "
    "row of the other dog is one.",
    "The Phy rows are no laboratory: they are the profile ardrone2 with the disturbances lab, "
    f"and the next set-point waits until the drone is within {TOLERANCE:g} m of the last one. The "
    "gusts of lab and that tolerance were fitted on H-DDPG-6x6-Phy, at the fitted speed; "
    "H-DDPG-4x4to6x6-Phy is their test.",
    "A verdict holds success, steps (GCM) and distance of our 33 cases against the paper's three. "
    "Better and worse mean that a two-sided test at the 5 % level finds a difference (Fisher's for "
    "success, else Welch's); more success, fewer steps and fewer metres are better. Compatible "
    "means that it finds none, which with three cases is easy. The paper rounds its other figures "
    "too much for a test. Its speed is not known: at another one, better or worse says little of "
    "the sheepdog.",
    "The paper does not print its start layouts; the cases are ours, three as in the paper and 30 "
    "more, and starts in which the drone's pad is not clear are drawn anew. In these rows the "
    "furthest stray is collected first, as in the paper.",
    "Steps of the gap are those to the end of the mission, mean of 100 random spaced starts, and "
    "`more` is against the kinematic world of the same starts. A mission that crashes is a failure "
    "and counts with all 1000 steps.",
)


def sections(results: Results, dogs: tuple[str, ...]) -> dict[str, Table]:
    """Every table of the study, by its title."""
    titled = {
        f"The four rows, at the speed: {called}": rows_table(results, called) for called in SPEEDS
    }
    titled["What physics costs, cause by cause"] = gap_table(results, dogs)
    titled["An emulated laboratory, 1,000 missions each"] = lab_table(results)
    return titled


def document(results: Results, dogs: tuple[str, ...], command: str) -> str:
    """The study as Markdown."""
    lines = [
        "# The physical study",
        "",
        f"Made by `{command}`: Section “Evaluating on physical system” of Nguyen et al. 2020 "
        "(arXiv 2004.11543), flown by the [physics twin](twin.md). The [glossary](glossary.md) "
        "explains the words.",
        "",
    ]
    for title, (head, body) in sections(results, dogs).items():
        lines += [f"## {title}", "", report.markdown_table(head, body)]
    lines += ["## How to read this", "", report.HOW_TO_READ, ""]
    for note in NOTES:
        lines += [note, ""]
    return "\n".join(lines)


def page(results: Results, dogs: tuple[str, ...], player: str, command: str) -> str:
    """The study as one HTML page."""
    parts = {
        title: report.html_table(head, body)
        for title, (head, body) in sections(results, dogs).items()
    }
    parts["Replay"] = player
    parts["Notes"] = f"<p>{report.HOW_TO_READ}</p>" + "".join(
        f"<p>{escape(note)}</p>" for note in NOTES
    )
    return report.document(
        "The physical study",
        f"<p>Made by <code>{escape(command)}</code>.</p>"
        + "".join(f"<h2>{escape(title)}</h2>{body}" for title, body in parts.items()),
    )


def _form(metric: str) -> str:
    return report.METRICS[metric][1]
