"""What Ray costs beside this machine's own workers: `many.py --help`.

Both train the same study, in turns. The time of the processors counts all processes of either:
unlike the time on the clock, it is fair on a machine that others use too.
"""

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from skydog import files, processes
from skydog.learning import workers
from skydog.learning.curriculum import Curriculum

BEGIN, END = "<!-- made by: python benchmarks/many.py --out docs/many.md -->", "<!-- end -->"
SEEDS = 1_000  # of the estimate
MACHINES = 100
CORES = (2, 16)  # of each
SUBREAPER = 36  # prctl: who has lost his parent becomes our child, and its time ours to read


def main() -> None:
    """Train the study in both ways, in turns, and print and write what it cost."""
    parser = argparse.ArgumentParser(
        description="Measure what Ray costs beside this machine's own workers.",
        epilog="Example: python benchmarks/many.py --out docs/many.md",
    )
    parser.add_argument("--trainings", type=int, default=16)
    parser.add_argument("--steps", type=int, default=150_000, help="of each training")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--out", type=Path, help="the page whose table is written anew")
    parser.add_argument("--study", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.study:
        study(given.study, given.trainings, given.steps)
        return
    ctypes.CDLL(None, use_errno=True).prctl(SUBREAPER, 1, 0, 0, 0)
    costs: dict[str, list[Cost]] = {"home": [], "ray": []}
    for number in range(given.rounds):
        for way in sorted(costs, reverse=number % 2 == 1):
            options = ["--trainings", str(given.trainings), "--steps", str(given.steps)]
            costs[way].append(cost([sys.executable, __file__, "--study", way, *options]))
            print(f"{way:>4}: {costs[way][-1]}", flush=True)
    told = table(costs, given.trainings, given.steps)
    print(told)
    if given.out:
        page = given.out.read_text("utf-8")
        before, _, rest = page.partition(BEGIN)
        after = rest.partition(END)[2]
        files.write_text(given.out, f"{before}{BEGIN}\n{told}\n{END}{after}")


def study(way: str, trainings: int, steps: int) -> None:
    """Train a study in this process's own workers, or over Ray."""
    processes.settle()
    # As our own workers; Ray's default is 15, and it spells the name so.
    os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112
    with tempfile.TemporaryDirectory() as folder:
        jobs = [
            workers.Job(Curriculum(steps=steps), skill, seed, Path(folder) / f"{seed}-{skill}")
            for seed in range(trainings // 2)
            for skill in ("collect", "drive")
        ]
        for job in jobs:
            files.folder(job.folder)
        assert workers.run(jobs, lambda _: None, None if way == "home" else way)


@dataclass(frozen=True)
class Cost:
    """What a command took."""

    wall: float  # seconds
    processor: float  # seconds, of all its processes

    def __str__(self) -> str:
        return f"{self.wall:,.1f} s on the clock, {self.processor:,.1f} s of processors"


def cost(command: list[str]) -> Cost:
    """Run a command, and look at its processes every half a second.

    Not by what the kernel counts of children: Ray does not wait for its own.
    """
    used: dict[tuple[int, str], float] = {}
    began = time.perf_counter()
    process = subprocess.Popen(command)
    while process.poll() is None:
        used |= _used(process.pid)
        time.sleep(0.5)
    wall = time.perf_counter() - began
    if process.returncode:
        sys.exit(f"{command} ended with {process.returncode}")
    return Cost(wall, sum(used.values()))


def _used(root: int) -> dict[tuple[int, str], float]:
    """The seconds of processors of a process and all below it, by its number and its start."""
    parents: dict[int, int] = {}
    seconds: dict[int, tuple[str, float]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            fields = entry.read_text().rpartition(")")[2].split()
            number = int(entry.parent.name)
            parents[number] = int(fields[1])
            ticks = int(fields[11]) + int(fields[12])
            seconds[number] = fields[19], ticks / os.sysconf("SC_CLK_TCK")
    parents[root] = 0

    def ours(number: int) -> bool:
        # Whoever has lost its parent is a child of this process; see `SUBREAPER`.
        while number not in (0, 1, root, os.getpid()):
            number = parents.get(number, 0)
        return number in (root, os.getpid())

    mine = [number for number in seconds if number != os.getpid() and ours(number)]
    return {(number, seconds[number][0]): seconds[number][1] for number in mine}


def table(costs: dict[str, list[Cost]], trainings: int, steps: int) -> str:
    """What was found, as Markdown, and what it makes of a large study."""
    lines = [
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC: {trainings} trainings of {steps:,} "
        f"steps, {len(processes.cores())} cores, {len(costs['ray'])} rounds in turns, with the "
        f"start of all processes; Ray {version('ray')}, jax {version('jax')}. On average "
        f"{os.getloadavg()[2]:.1f} programs ran at once; these trainings alone are "
        f"{len(processes.cores())}.",
        "",
        "| | seconds of processors | seconds on the clock |",
        "| --- | --: | --: |",
    ]
    for way, name in {"home": "this machine's workers", "ray": "`--on ray`"}.items():
        spent, waited = ([getattr(one, of) for one in costs[way]] for of in ("processor", "wall"))
        lines.append(f"| {name} | {_spread(spent)} | {_spread(waited)} |")
    ratios = [
        [getattr(ray, of) / getattr(home, of) for home, ray in zip(*costs.values(), strict=True)]
        for of in ("processor", "wall")
    ]
    lines.append(f"| ratio | {' | '.join(_spread(ratio, '.3f') for ratio in ratios)} |")
    each = float(np.median([one.processor for one in costs["ray"]])) / trainings
    whole = 2 * SEEDS
    lines += [
        "",
        f"A training took {each:.0f} seconds of one core. {SEEDS:,} seeds are {whole:,} trainings, "
        f"or {whole * each / 3600:,.0f} hours of one core:",
        "",
        f"| {MACHINES} machines of | at a time | one after another | minutes |",
        "| --- | --: | --: | --: |",
    ]
    for cores in CORES:
        at_once = MACHINES * cores
        turns = -(-whole // at_once)
        lines.append(f"| {cores} cores | {at_once:,} | {turns} | {turns * each / 60:.1f} |")
    return "\n".join([*lines, ""])


def _spread(values: list[float], form: str = ",.0f") -> str:
    """The median, and in brackets the least and the greatest."""
    least, middle, most = np.quantile(values, (0.0, 0.5, 1.0))
    return f"{middle:{form}} ({least:{form}} to {most:{form}})"


if __name__ == "__main__":
    main()
