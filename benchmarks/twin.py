"""How fast the twin flies, beside other simulators of drones: `twin.py --help`."""

import os
import platform
import shlex
import statistics
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import tyro
from bench import OURS, Side, Slice, Worker
from rich.console import Console
from tyro.conf import arg

from skydog import files
from skydog.errors import Refusal

REMEDY = "run: make twinbench"

TOGETHER = 20  # missions, or worlds
DECISIONS = 10  # a second, of our shepherd


@dataclass(frozen=True)
class Flown(Slice):
    """A timed slice of flights or missions."""

    simulated: float  # seconds, in all worlds together
    miss: float = 0.0  # metres from the goal, at most, of a peer's flights
    missions: int = 0  # of ours
    home: int = 0  # missions that brought the sheep home

    @property
    def real_time(self) -> float:
        """How many seconds are simulated in a second."""
        return self.simulated / self.seconds


@dataclass(frozen=True)
class Row:
    """A simulator in the table, and what it flies there."""

    name: str
    flies: str
    side: Side


def contests(peers: Path) -> dict[str, list[Row]]:
    """What is flown by title: ours first, then the peers, each at its own defaults."""
    python = peers / "bin" / "python"

    def ours(missions: int) -> Row:
        return Row(
            "skydog twin",
            "herding missions from take-off to home: a drone and 3 rovers each, decided every "
            "0.1 s",
            Side(OURS, "twin_worker.py", {"profile": "tum-simulator", "missions": missions}),
        )

    def crazyflow(command_rate: int, worlds: int) -> Row:
        return Row(
            "crazyflow" + (", as in its quick start" if command_rate == 100 else ""),
            f"a drone in free air, 1 m steps, commanded every {1 / command_rate:g} s",
            Side(python, "crazyflow_worker.py", {"command_rate": command_rate, "worlds": worlds}),
        )

    def rotorpy(sensors: bool) -> Row:
        what = "IMU and motion capture simulated, all recorded" if sensors else "nothing recorded"
        return Row(
            "RotorPy" + (", `Environment.run`" if sensors else ", vehicle and controller alone"),
            f"a drone in free air, 1 m steps, {what}",
            Side(python, "rotorpy_worker.py", {"sensors": sensors}),
        )

    return {
        "One at a time": [
            ours(1),
            crazyflow(100, 1),
            crazyflow(DECISIONS, 1),
            rotorpy(True),
            rotorpy(False),
        ],
        f"{TOGETHER} at a time": [
            ours(TOGETHER),
            crazyflow(100, TOGETHER),
            crazyflow(DECISIONS, TOGETHER),
        ],
    }


def twin(
    rounds: int = 5,
    seconds: float = 2.0,
    peers: Annotated[Path, arg(metavar="FOLDER")] = Path(".venv-twin-peers"),
    out: Annotated[Path | None, arg(metavar="FILE.md")] = None,
) -> None:
    """Time the twin beside crazyflow and RotorPy, and write one table.

    All run alternately on one core, after compiling and warming up; the ratio is taken round by
    round, of simulated seconds per second, as their physics steps are not equally long.

    Example: .venv/bin/python benchmarks/twin.py --out docs/twin_benchmarks.md

    Args:
        rounds: How many times each is timed.
        seconds: About how long a slice of each lasts.
        peers: The virtual environment of the peers, made from benchmarks/twin-peers.txt.
        out: Where to write the table as Markdown, if given.
    """
    if not (peers / "bin" / "python").exists():
        raise Refusal(f"{peers} is no virtual environment; {REMEDY}")
    if rounds < 1:
        raise Refusal(f"rounds must be 1 or more, got {rounds}; try --rounds 5")
    if not 0.0 < seconds < 3600.0:
        raise Refusal(f"seconds must be between 0 and 3600, got {seconds:g}; try --seconds 2")
    # It imports jax, for which a refusal need not wait.
    from scaling import processor

    cores = sorted(os.sched_getaffinity(0))
    versions = {"skydog's python": platform.python_version()}
    progress = Console(stderr=True)
    lines = [
        "# How fast the twin flies",
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by `{shlex.join(sys.orig_argv)}` on "
        f"{processor()}, {len(cores)} cores, no accelerator. One core each, measured "
        f"alternately in {rounds} rounds of about {seconds:g} s, or of one call where that takes "
        "longer; compiling and warming up are not timed. Speeds are medians over the rounds.",
        "",
    ]
    for title, rows in contests(peers).items():
        progress.print(f"{title}: starting and warming up ...", highlight=False)
        timed = _in_turns(rows, cores[-1], rounds, seconds, versions, progress)
        lines += [f"## {title}", "", *_table(rows, timed), ""]
    lines += [
        *_notes(),
        "",
        "Versions: " + ", ".join(f"{name} {number}" for name, number in versions.items()) + ".",
    ]
    print("\n".join(lines))
    if out is not None:
        files.write_text(out, "\n".join([*lines, ""]))


def _in_turns(
    rows: list[Row],
    core: int,
    rounds: int,
    seconds: float,
    versions: dict[str, str],
    progress: Console,
) -> list[list[Flown]]:
    workers: list[Worker] = []
    try:
        for row in rows:
            workers.append(Worker(row.side, core, REMEDY))
            told = workers[-1].versions
            versions |= {what: number for what, number in told.items() if what != "python"}
        repeats = [_warm_up(worker, seconds) for worker in workers]
        timed: list[list[Flown]] = [[] for _ in workers]
        for number in range(rounds):
            for worker, count, slices in zip(workers, repeats, timed, strict=True):
                slices.append(_fly(worker, count))
            speeds = ", ".join(f"{slices[-1].real_time:,.1f}" for slices in timed)
            progress.print(f"  round {number + 1} of {rounds}: {speeds} ×", highlight=False)
        return timed
    finally:
        for worker in workers:
            worker.stop()


def _fly(worker: Worker, repeats: int) -> Flown:
    """So many flights or missions, timed."""
    worker.tell(repeats=repeats)
    return Flown(**worker.hear())


def _warm_up(worker: Worker, seconds: float) -> int:
    """The flights or missions that last about so many seconds."""
    repeats = 1
    while (slice := _fly(worker, repeats)).seconds < seconds / 4:
        repeats = int(repeats * min(20.0, max(2.0, 0.5 * seconds / slice.seconds)))
    return max(1, round(repeats * seconds / slice.seconds))


def _table(rows: list[Row], timed: list[list[Flown]]) -> list[str]:
    lines = [
        "| simulator | what it flies | a step | physics-and-control steps/s | × real time "
        "| ours / theirs (least to most) | really flown | of the core |",
        "| --- | --- | --: | --: | --: | --: | --- | --: |",
    ]
    for row, slices in zip(rows, timed, strict=True):
        step = slices[0].simulated / slices[0].steps
        ratio = ""
        if slices is not timed[0]:
            pairs = zip(timed[0], slices, strict=True)
            times = [ours.real_time / theirs.real_time for ours, theirs in pairs]
            middle, least, most = (_times(how(times)) for how in (statistics.median, min, max))
            ratio = f"{middle} × ({least} to {most})"
        missions = sum(slice.missions for slice in slices)
        home = sum(slice.home for slice in slices)
        within = f"within {100 * max(slice.miss for slice in slices):.1f} cm"
        cells = [
            row.name,
            row.flies,
            f"{1000 * step:.3g} ms",
            f"{statistics.median(slice.speed for slice in slices):,.0f}",
            f"{statistics.median(slice.real_time for slice in slices):,.1f} ×",
            ratio,
            f"{home} of {missions} home" if missions else within,
            f"{min(slice.had for slice in slices):.0%}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _times(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio >= 2 else f"{ratio:.2g}"


def _notes() -> list[str]:
    return [
        "## What is compared",
        "",
        "**Not the same task.** Ours is a whole mission: a drone and three rovers on their wheels "
        "in one MuJoCo world, with contacts, motion capture, a base station and a shepherd. A peer "
        "flies one drone in free air, under its own position controller, at its own defaults. The "
        "ratio is of simulated seconds per second, in all worlds together: the steps are not "
        "equally long.",
        "",
        "**The drones really fly.** For our twin the table has how many missions were "
        "accomplished. A peer flies a metre in 5 s, from rest to rest, again and again; its worker "
        "stops with an error unless the drone began at least 0.85 m from the goal and ended at "
        "most 0.15 m from it. The table has the largest distance at the end.",
        "",
        "**crazyflow** flies its default Crazyflie (`cf21B_500`) from first principles: physics "
        "and attitude at 500 Hz, position at 100 Hz. Its quick start calls it from Python 100 "
        "times a simulated second, 5 steps a call, and the calls take most of the time. Commanded "
        f"{DECISIONS} times a second, as our shepherd decides, it runs 50 steps in one compiled "
        "call. It is made for thousands of worlds at once.",
        "",
        "**RotorPy** flies a Crazyflie under `SE3Control`, physics (RK45 with a step of its own "
        "choice) and control at 100 Hz. `Environment.run` simulates an IMU and a motion capture "
        "as well. Its batches need torch and were not timed.",
        "",
        "**gym-pybullet-drones** is left out: it is not on PyPI (`pip download --no-deps "
        "gym-pybullet-drones` finds no version), and the benchmark installs from there alone.",
    ]


if __name__ == "__main__":
    try:
        tyro.cli(twin, prog="twin.py", config=(tyro.conf.FlagCreatePairsOff,))
    except Refusal as refusal:
        print(f"twin: {refusal}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("twin: stopped", file=sys.stderr)
        sys.exit(130)
