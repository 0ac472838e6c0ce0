"""How fast the learner learns, beside Stable-Baselines3's: `training_speed.py --help`."""

import json
import os
import platform
import shlex
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table
from tyro.conf import arg

from skydog import files
from skydog.errors import Refusal

HERE = Path(__file__).resolve().parent
AIM = 30  # times as fast as the peer: what the project asks of itself
PLAY_SECONDS = 0.5  # the peer's task alone needs no longer slice: nothing in it varies
UNDISTURBED = 0.95  # share of the core above which nothing else is thought to have run there
WARM_UP = {"ours": 20_000, "theirs": 1_000, "task": 20_000}  # steps, which also set the slices


@dataclass(frozen=True)
class Slice:
    """One timed piece of work."""

    steps: int
    seconds: float
    busy: float  # seconds that its process computed: fewer if it shared its core

    @property
    def speed(self) -> float:
        """Steps per second."""
        return self.steps / self.seconds

    @property
    def had(self) -> float:
        """The share of the core that it had."""
        return self.busy / self.seconds


@dataclass(frozen=True)
class Spread:
    """The middle of the rounds, and their ends."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: list[float]) -> "Spread":
        return cls(statistics.median(values), min(values), max(values))


class Worker:
    """A process of its own, pinned to the core, asleep except during its slices."""

    def __init__(self, python: Path, script: str, core: int, remedy: str, **task: Any):
        self.name, self._remedy = script, remedy
        self._process = subprocess.Popen(
            [str(python), str(HERE / script), str(core)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.versions = self.ask(**task) if task else self._hear()

    def ask(self, **request: Any) -> dict[str, Any]:
        pipe = self._process.stdin
        assert pipe is not None
        try:
            pipe.write(json.dumps(request) + "\n")
            pipe.flush()
        except BrokenPipeError:
            pass  # it died: what it said on the standard error is on the screen
        return self._hear()

    def work(self, steps: int, what: str = "learn") -> Slice:
        return Slice(**self.ask(steps=steps, what=what))

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()

    def _hear(self) -> dict[str, Any]:
        pipe = self._process.stdout
        assert pipe is not None
        line = pipe.readline()
        if not line:
            raise Refusal(f"{self.name} died, as told above; {self._remedy}")
        return json.loads(line)


def measure(
    rounds: int = 7,
    seconds: float = 3.0,
    peers: Annotated[Path, arg(metavar="FOLDER")] = Path(".venv-peers"),
    core: int | None = None,
    out: Annotated[Path | None, arg(metavar="FILE.md")] = None,
    as_json: Annotated[Path | None, arg(name="json", metavar="FILE")] = None,
) -> None:
    """Environment steps per second, each with one gradient update: skydog and its peer.

    Teaches the drive lesson to skydog's DDPG and to Stable-Baselines3's, with the same
    networks, batch and memory, on the same core, in turns; a round is a slice of each. First
    it checks that the peer's NumPy task is the same as skydog's. Compiling and warming up are
    not timed. The share of the core that a slice got tells whether other work disturbed it.

    Example: .venv/bin/python benchmarks/training_speed.py --rounds 9 --out speed.md

    Args:
        rounds: How many times each is timed.
        seconds: About how long a slice of each lasts.
        peers: The virtual environment of the peer, made from benchmarks/peers.txt.
        core: The core that both work on, in turns; the last one if not given.
        out: Where to write the figures as Markdown, if given.
        as_json: Where to write every slice as JSON, if given.
    """
    python = _peer(peers)
    core = _core(core)
    if rounds < 1:
        raise Refusal(f"rounds must be 1 or more, got {rounds}; try --rounds 7")
    if not 0.0 < seconds < 3600.0:
        raise Refusal(f"seconds must be between 0 and 3600, got {seconds:g}; try --seconds 3")
    for path in (out, as_json):
        if path is not None:
            files.folder(path.parent)

    progress = Console(stderr=True)
    progress.print("Comparing the two tasks ...")
    from same_task import check, lesson, numbers

    from skydog.learning import ddpg

    agreement = check()
    if not agreement.same:
        raise Refusal(f"NumpyLesson is not the lesson: {agreement}; mend benchmarks/numpy_lesson")

    workers: list[Worker] = []
    try:
        progress.print("Compiling and warming up ...")
        mend = f"to install the peer again, run: {_install(peers)}"
        task = {"numbers": numbers(lesson()), "config": asdict(ddpg.Config())}
        workers.append(theirs := Worker(python, "sb3_worker.py", core, mend, **task))
        workers.append(ours := Worker(Path(sys.executable), "skydog_worker.py", core, ""))
        timed = _in_turns(ours, theirs, rounds, seconds, progress)
    finally:
        for worker in workers:
            worker.stop()

    results = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": shlex.join(sys.orig_argv),
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "core": core},
        "versions": {
            "skydog": {"python": platform.python_version(), **ours.versions},
            "peer": theirs.versions,
        },
        "config": task["config"],
        "agreement": asdict(agreement),
        "slices": {name: [asdict(one) for one in slices] for name, slices in timed.items()},
        "ratio": [a.speed / b.speed for a, b in zip(timed["ours"], timed["theirs"], strict=True)],
    }
    Console().print(_table(timed, results["ratio"]))
    Console().print(_remarks(timed), highlight=False)
    if out is not None:
        files.write_text(out, _markdown(timed, results))
    if as_json is not None:
        files.write_text(as_json, json.dumps(results, indent=2) + "\n")


def _in_turns(
    ours: Worker, theirs: Worker, rounds: int, seconds: float, progress: Console
) -> dict[str, list[Slice]]:
    work: dict[str, Callable[[int], Slice]] = {
        "ours": ours.work,
        "theirs": theirs.work,
        "task": lambda steps: theirs.work(steps, "play"),
    }
    lasts = {"ours": seconds, "theirs": seconds, "task": min(seconds, PLAY_SECONDS)}
    steps = {
        name: max(1, round(lasts[name] * do(WARM_UP[name]).speed)) for name, do in work.items()
    }
    timed: dict[str, list[Slice]] = {name: [] for name in work}
    for number in range(rounds):
        for name, do in work.items():
            timed[name].append(do(steps[name]))
        one, other = timed["ours"][-1].speed, timed["theirs"][-1].speed
        progress.print(
            f"Round {number + 1} of {rounds}: {one:,.0f} and {other:,.0f} steps/s, "
            f"{one / other:.1f} times",
            highlight=False,
        )
    return timed


def _rows(timed: dict[str, list[Slice]], ratio: list[float]) -> list[list[str]]:
    names = {
        "ours": "skydog DDPG",
        "theirs": "Stable-Baselines3 DDPG",
        "task": "its NumPy task alone, no learner",
    }
    rows = []
    for key, name in names.items():
        speed = Spread.of([one.speed for one in timed[key]])
        had = min(one.had for one in timed[key])
        numbers = [f"{value:,.0f}" for value in (speed.median, speed.least, speed.most)]
        rows.append([name, *numbers, f"{had:.0%}"])
    times = Spread.of(ratio)
    numbers = [f"{value:.1f} ×" for value in (times.median, times.least, times.most)]
    return [*rows, [f"ratio, round by round (aim: {AIM} ×)", *numbers, ""]]


HEADS = ["steps/s, one update each", "median", "least", "most", "of the core, at least"]


def _table(timed: dict[str, list[Slice]], ratio: list[float]) -> Table:
    table = Table(title="Training speed on one core")
    for head in HEADS:
        table.add_column(head, justify="left" if head is HEADS[0] else "right")
    for row in _rows(timed, ratio):
        table.add_row(*row)
    return table


def _remarks(timed: dict[str, list[Slice]]) -> str:
    whole = Spread.of([one.speed for one in timed["theirs"]]).median
    alone = Spread.of([one.speed for one in timed["task"]]).median
    remarks = (
        f"Of its time, Stable-Baselines3 spends about {whole / alone:.1%} in the task; "
        "the rest is its learner and its loop."
    )
    pairs = list(zip(timed["ours"], timed["theirs"], strict=True))
    if min(one.had for pair in pairs for one in pair) > UNDISTURBED:
        return remarks
    times = Spread.of([(a.speed / a.had) / (b.speed / b.had) for a, b in pairs])
    return (
        f"{remarks} Other work ran on the core: counted by the time that each had of it, the "
        f"ratio is {times.median:.1f} × ({times.least:.1f} to {times.most:.1f})."
    )


def _markdown(timed: dict[str, list[Slice]], results: dict[str, Any]) -> str:
    machine, agreement = results["machine"], results["agreement"]
    skydog, peer = results["versions"]["skydog"], results["versions"]["peer"]
    furthest = max(agreement[name] for name in ("observation", "reward", "state"))
    config = results["config"]
    slices = zip(timed["ours"], timed["theirs"], results["ratio"], strict=True)
    rounds = [
        [str(n + 1), f"{one.speed:,.0f}", f"{other.speed:,.0f}", f"{times:.1f} ×"]
        for n, (one, other, times) in enumerate(slices)
    ]

    def layers(sizes: Sequence[int]) -> str:
        return "-".join(map(str, sizes))

    return f"""# Training speed

Measured on {results["date"]} by

    {results["command"]}

{_grid(HEADS, _rows(timed, results["ratio"]))}
{_remarks(timed)}

**Machine.** {machine["processor"]}, {machine["cores"]} cores, of which both used core \
{machine["core"]}, in turns. No accelerator.

**Versions.** skydog on Python {skydog["python"]} with jax {skydog["jax"]} and equinox \
{skydog["equinox"]}; Stable-Baselines3 {peer["stable_baselines3"]} on Python {peer["python"]} \
with torch {peer["torch"]}, gymnasium {peer["gymnasium"]} and numpy {peer["numpy"]}.

**Task.** The *drive* lesson: three sheep, the `paper` preset's arena of 4 m, `progress` reward, \
episodes of 200 steps. The peer's is written anew in plain Python and NumPy, so that it pays \
for no JAX. From {agreement["cases"]} random states and actions the two differ by at most \
{furthest:.1e} in observation, reward and next state; {agreement["starts"]} starts of each are \
alike (least p of ten Kolmogorov-Smirnov tests: {agreement["starts_p"]:.2f}).

**Alike.** Actor {layers(config["actor"])}, critic {layers(config["critic"])}, ReLU, Adam, \
batches of {config["batch"]}, a memory of {config["memory"]:,}, γ = {config["discount"]}, \
λ = {config["follow"]}, Ornstein-Uhlenbeck noise (θ = {config["theta"]}, σ = {config["sigma"]}), \
one environment, one update a step, one core, nothing written or logged.

**Not alike.** Stable-Baselines3 has one learning rate for both networks, here the critic's, \
{config["critic_rate"]}; skydog's actor has {config["actor_rate"]}. Its first {config["batch"]} \
actions are random. skydog averages its actor besides, and the memory that it samples is the \
fuller one. Start-up and compilation are not timed.

Round by round, in steps/s:

{_grid(["round", "skydog", "Stable-Baselines3", "ratio"], rounds)}"""


def _grid(heads: list[str], rows: list[list[str]]) -> str:
    lines = [heads, ["---", *["--:"] * (len(heads) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _peer(folder: Path) -> Path:
    python = folder / "bin" / "python"
    if not python.exists():
        raise Refusal(f"{folder} is no virtual environment; run: {_install(folder)}")
    return python


def _install(folder: Path) -> str:
    make = shlex.join(["python3", "-m", "venv", str(folder)])
    pip, peers = str(folder / "bin" / "pip"), os.path.relpath(HERE / "peers.txt")
    return f"{make} && {shlex.join([pip, 'install', '-r', peers])}"


def _core(core: int | None) -> int:
    if hasattr(os, "sched_getaffinity"):
        cores = sorted(os.sched_getaffinity(0))
    else:
        cores = list(range(os.cpu_count() or 1))
    if core is None:
        return cores[-1]
    if core not in cores:
        raise Refusal(f"core {core} is not there; choose from {', '.join(map(str, cores))}")
    return core


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


if __name__ == "__main__":
    try:
        tyro.cli(measure, prog="training_speed.py", config=(tyro.conf.FlagCreatePairsOff,))
    except Refusal as refusal:
        print(f"training_speed: {refusal}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("training_speed: stopped", file=sys.stderr)
        sys.exit(130)
