"""Is a sheepdog luck? Train ten with each reward, test each, and write a table."""

import shlex
import sys
from pathlib import Path
from typing import Any

import tyro

from skydog import console, files, herd
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.words import Reward
from skydog.world import params
from skydog.world.mission import Shepherd
from skydog.world.params import World

PREFACE = {
    "progress": "The default reward: metres gained by the dog on its subgoal and by the flock.",
    "paper": "The paper's reward: ±0.1 a step for getting nearer or not. Never arriving games it.",
}


def main(
    out: Path = Path("docs/seeds.md"),
    seeds: int = 10,
    steps: int = 100_000,
    runs: Path = Path("runs/seeds"),
) -> None:
    """Train sheepdogs with each reward in the 4 x 4 arena, and write docs/seeds.md.

    Example: python benchmarks/seeds.py --seeds 10

    Args:
        out: The Markdown file.
        seeds: Sheepdogs for each reward.
        steps: Of training, for each of the two skills.
        runs: Where the trainings are kept; what is finished there is not trained again.
    """
    four, six = params.preset("paper", 4.0), params.preset("paper", 6.0)
    command = shlex.join(["python", "benchmarks/seeds.py", *sys.argv[1:]])
    text = [
        "# Is it luck? Ten sheepdogs for each reward",
        "",
        f"Made by `{command}`. Each sheepdog was trained from nothing for {steps:,} steps a skill "
        "in the 4 x 4 m arena, and then flown through 30 cases (`paper` starts), through 1,000 "
        "random starts (sheep and dog), and, with ξ scaling, through the 30 cases in the 6 x 6 m "
        "arena. Steps last until every sheep is home and gathered; a failed mission counts 1,000. "
        "All fly at ±1 m/s on each axis. Mean ± SD over the cases.",
        "",
    ]
    rewards: tuple[Reward, ...] = ("progress", "paper")
    for reward in rewards:
        text += table(reward, four, six, seeds, steps, runs / reward)
    text += ["## The rule dog on the same cases", "", *header("at its point")]
    for at_point in ("constant", "arrive"):
        text.append(line(at_point, figures(Strombom(at_point=at_point), four, six)))
    files.write_text(out, "\n".join([*text, ""]))


def table(reward: Reward, four: World, six: World, seeds: int, steps: int, runs: Path) -> list[str]:
    """A section: one line a sheepdog, and how many of them can herd."""
    course = herd.Course(arena=4.0, reward=reward, steps=steps)
    folders = {seed: runs / f"seed-{seed}" for seed in range(seeds)}
    if not herd.teach(course, folders, resume=True):
        sys.exit(herd.stopped(f"python benchmarks/seeds.py --runs {runs.parent}"))
    console.say(f"Testing {seeds} sheepdogs ...")
    rows = {
        seed: figures(herd.fuse(course, folder, seed)[0], four, six)
        for seed, folder in folders.items()
    }
    good = sum(row[0]["success"] >= 29 / 30 for row in rows.values())
    return [
        f"## `{reward}`",
        "",
        PREFACE[reward] + f" {good} of {seeds} succeed in at least 29 of the 30 cases.",
        "",
        *header("seed"),
        *(line(str(seed), row) for seed, row in rows.items()),
        "",
    ]


def figures(shepherd: Shepherd, four: World, six: World) -> list[dict[str, Any]]:
    """The rows of the three tests: 30 cases, 1,000 random starts, 30 cases in 6 x 6."""
    return [
        evaluate.row(evaluate.fly(four, shepherd, cases(four, 30))),
        evaluate.row(evaluate.fly(four, shepherd, cases(four, 1000, "random", seed=1))),
        evaluate.row(evaluate.fly(six, shepherd, cases(six, 30))),
    ]


def header(first: str) -> list[str]:
    tests = ("30 cases", "1,000 random", "6 x 6")
    columns = [first] + [f"{test}: {what}" for test in tests for what in ("success", "steps", "m")]
    return [f"| {' | '.join(columns)} |", "|" + " ---: |" * len(columns)]


def line(first: str, rows: list[dict[str, Any]]) -> str:
    cells = [first]
    for row in rows:
        steps, distance = row["steps"], row["distance"]
        cells.append(f"{row['success']:.1%}")
        cells.append(f"{steps['mean']:.0f} ± {steps['sd']:.0f}")
        cells.append(f"{distance['mean']:.1f} ± {distance['sd']:.1f}")
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    tyro.cli(main)
