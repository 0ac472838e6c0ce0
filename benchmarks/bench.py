"""How fast skydog is, beside what a user would pick otherwise: `bench.py --help`."""

import json
import os
import platform
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from tyro.conf import arg

from skydog import files
from skydog.errors import Refusal

CHECKOUT = Path(__file__).resolve().parents[1]

OURS = Path(sys.executable)

# Has XLA compile a loop whole if a turn of it touches fewer bytes than this.
WHOLE = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=100000"


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


class Worker:
    """A process of its own, pinned to a core, asleep except during its slices."""

    def __init__(self, side: "Side", core: int, remedy: str = ""):
        self.name, self._remedy = side.script, remedy
        source = {"PYTHONPATH": str(side.checkout / "src")} if side.checkout != CHECKOUT else {}
        self._process = subprocess.Popen(
            [str(side.python), str(side.checkout / "benchmarks" / side.script), str(core)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **source},
        )
        if side.task:
            self.tell(**side.task)
        self.versions = self.hear()

    def tell(self, **request: Any) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        try:
            pipe.write(json.dumps(request) + "\n")
            pipe.flush()
        except BrokenPipeError:
            pass  # it died: what it said on the standard error is on the screen

    def hear(self) -> dict[str, Any]:
        pipe = self._process.stdout
        assert pipe is not None
        line = pipe.readline()
        if not line:
            raise Refusal(f"{self.name} died, as told above; {self._remedy}")
        return json.loads(line)

    def work(self, steps: int, what: str = "learn") -> Slice:
        self.tell(steps=steps, what=what)
        return Slice(**self.hear())

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()


@dataclass(frozen=True)
class Side:
    """Who takes part in a contest: an interpreter, its worker, and the task that it is given."""

    python: Path
    script: str
    task: dict[str, Any] = field(default_factory=dict)
    checkout: Path = CHECKOUT  # the revision of skydog, and of the worker


@dataclass(frozen=True)
class Contest:
    """A thing that ours and others do, measured alternately on one core."""

    title: str
    unit: str
    sides: dict[str, Side]
    aims: dict[str, float]  # by whom: how many times as fast ours shall be


def bench(
    rounds: int = 5,
    seconds: float = 2.0,
    peers: Annotated[Path, arg(metavar="FOLDER")] = Path(".venv-peers"),
    before: Annotated[Path | None, arg(metavar="FOLDER")] = None,
    out: Annotated[Path | None, arg(metavar="FILE.md")] = None,
) -> None:
    """Time skydog beside Stable-Baselines3, SBX and VMAS, and write one table.

    The programs of a contest run alternately on one core, after compiling and warming up; the
    ratio is taken round by round. Besides: what a second core brings, and the time and memory of
    `skydog herd`.

    Example: .venv/bin/python benchmarks/bench.py --out docs/benchmarks.md

    Args:
        rounds: How many times each is timed.
        seconds: About how long a slice of each lasts.
        peers: The virtual environment of the peers, made from benchmarks/peers.txt.
        before: A checkout of another revision of skydog, which takes part in every contest: a
            ratio below 1 is what the present one lost.
        out: Where to write the table as Markdown, if given.
    """
    python = peers / "bin" / "python"
    if not python.exists():
        raise Refusal(f"{peers} is no virtual environment; run: make bench")
    if rounds < 1:
        raise Refusal(f"rounds must be 1 or more, got {rounds}; try --rounds 5")
    if not 0.0 < seconds < 3600.0:
        raise Refusal(f"seconds must be between 0 and 3600, got {seconds:g}; try --seconds 2")
    cores = sorted(os.sched_getaffinity(0))
    progress = Console(stderr=True)
    progress.print("Comparing the task with its copy in NumPy ...")
    from same_task import check, lesson, numbers
    from scaling import processor

    from skydog.learning import ddpg

    agreement = check()
    if not agreement.same:
        raise Refusal(f"NumpyLesson is not the lesson: {agreement}; mend benchmarks/numpy_lesson")
    task = {"numbers": numbers(lesson()), "config": asdict(ddpg.Config())}
    contests = [
        Contest(
            "Training",
            "environment steps/s, one update each",
            {
                "skydog DDPG": Side(OURS, "skydog_worker.py"),
                "Stable-Baselines3 DDPG": Side(
                    python,
                    "peer_worker.py",
                    {"library": "stable_baselines3", **task},
                ),
                "SBX DDPG": Side(python, "peer_worker.py", {"library": "sbx", **task}),
            },
            {"Stable-Baselines3 DDPG": 40, "SBX DDPG": 15},
        ),
        *(
            Contest(
                f"Worlds, {count:,} at a time",
                "worlds stepped/s",
                {
                    "skydog, 3 sheep and a dog": Side(OURS, "worlds_worker.py", {"worlds": count}),
                    "VMAS flocking, 4 agents": Side(python, "vmas_worker.py", {"worlds": count}),
                },
                {"VMAS flocking, 4 agents": 100},
            )
            for count in (1, 1024)
        ),
        Contest(
            "Missions, one at a time",
            "mission steps/s: rule dog, gate, the end, all recorded",
            {
                "skydog.rollout, loops compiled whole": Side(
                    OURS,
                    "rollout_worker.py",
                    {"flags": WHOLE},
                ),
                "skydog.rollout": Side(OURS, "rollout_worker.py", {"flags": ""}),
            },
            {},
        ),
    ]
    if before is not None:
        contests = [_with_before(contest, before.resolve()) for contest in contests]
    lines = [
        "# Benchmarks",
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by `{shlex.join(sys.orig_argv)}` on "
        f"{processor()}, {len(cores)} cores, no accelerator. One core each, measured "
        f"alternately in {rounds} rounds of about {seconds:g} s; compiling and warming up are not "
        "timed.",
        "",
    ]
    versions: dict[str, str] = {"skydog's python": platform.python_version()}
    for contest in contests:
        progress.print(f"{contest.title}: starting and warming up ...")
        timed = _in_turns(contest, cores[-1], rounds, seconds, versions, progress)
        lines += [f"## {contest.title}", "", *_table(contest, timed), ""]
    progress.print("A second core ...")
    lines += ["## A second core", "", *_second_core(cores, rounds, seconds), ""]
    progress.print("The main job ...")
    lines += ["## The main job", "", *_main_job(), ""]
    furthest = max(agreement.observation, agreement.reward, agreement.state)
    lines += [
        "## What is compared",
        "",
        "**Training** is the *drive* lesson with the same networks, batch, memory, noise and one "
        "update a step. The peers run a copy of the lesson in plain NumPy, so that they do not "
        f"pay for JAX. From {agreement.cases} random states the two differ by at most "
        f"{furthest:.1e} in observation, reward and next state, and their starts are alike. "
        "Stable-Baselines3 and SBX have one learning rate for both networks, the critic's. skydog "
        "also averages its actor. torch has one thread.",
        "",
        "**Worlds** are not the same task: VMAS has no shepherding. Flocking with four agents is "
        "the most similar task. Its worlds have collisions and observations, ours have the "
        "flock's forces.",
        "",
        f"**Missions** are compiled whole with `XLA_FLAGS={WHOLE}`. XLA's own limit is 1,024 bytes "
        "a turn, beyond which it runs a loop operation by operation. It is not skydog's default: "
        "with it, the gradients of missions in which two start at one place are NaN (jax 0.10.1). "
        "What is only flown comes out the same.",
        "",
        "Versions: " + ", ".join(f"{name} {number}" for name, number in versions.items()) + ".",
        "",
        "How cost grows with sheep, worlds and seeds: [scaling.md](scaling.md).",
    ]
    print("\n".join(lines))
    if out is not None:
        files.write_text(out, "\n".join([*lines, ""]))


def _with_before(contest: Contest, checkout: Path) -> Contest:
    """The contest, in which another revision of skydog takes part beside this one."""
    ours = {name: side for name, side in contest.sides.items() if side.python == OURS}
    theirs = {f"{name}, before": replace(side, checkout=checkout) for name, side in ours.items()}
    return replace(contest, sides={**ours, **theirs, **contest.sides})


def _in_turns(
    contest: Contest,
    core: int,
    rounds: int,
    seconds: float,
    versions: dict[str, str],
    progress: Console,
) -> dict[str, list[Slice]]:
    workers: dict[str, Worker] = {}
    try:
        for name, side in contest.sides.items():
            workers[name] = Worker(side, core, "run: make bench")
            told = workers[name].versions
            versions |= {what: number for what, number in told.items() if what != "python"}
        steps = {name: _warm_up(worker, seconds) for name, worker in workers.items()}
        timed: dict[str, list[Slice]] = {name: [] for name in workers}
        for number in range(rounds):
            for name, worker in workers.items():
                timed[name].append(worker.work(steps[name]))
            speeds = ", ".join(f"{slices[-1].speed:,.0f}" for slices in timed.values())
            progress.print(f"  round {number + 1} of {rounds}: {speeds}", highlight=False)
        return timed
    finally:
        for worker in workers.values():
            worker.stop()


def _warm_up(worker: Worker, seconds: float) -> int:
    """The steps that last about so many seconds."""
    steps = 1_000
    while (slice := worker.work(steps)).seconds < seconds / 4:
        steps = int(steps * min(20.0, max(2.0, 0.5 * seconds / slice.seconds)))
    return max(1, round(slice.speed * seconds))


def _table(contest: Contest, timed: dict[str, list[Slice]]) -> list[str]:
    ours = next(iter(timed))
    lines = [
        f"| {contest.unit} | median | least | most | ratio (least to most) | aim | of the core |",
        "| --- | --: | --: | --: | --: | --: | --: |",
    ]
    for name, slices in timed.items():
        speeds = [slice.speed for slice in slices]
        cells = [f"{how(speeds):,.0f}" for how in (statistics.median, min, max)]
        ratio = aim = ""
        if name != ours:
            pairs = zip(timed[ours], slices, strict=True)
            times = [one.speed / other.speed for one, other in pairs]
            middle, least, most = map(_times, (statistics.median(times), min(times), max(times)))
            ratio = f"{middle} × ({least} to {most})"
            aim = f"{contest.aims[name]:g} ×" if name in contest.aims else ""
        had = f"{min(slice.had for slice in slices):.0%}"
        lines.append(f"| {' | '.join([name, *cells, ratio, aim, had])} |")
    return lines


def _times(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio >= 2 else f"{ratio:.3f}"


def _second_core(cores: list[int], rounds: int, seconds: float) -> list[str]:
    """What two pinned trainings do together, beside what one does alone."""
    if len(cores) < 2:
        return ["This machine has one core."]
    workers = [Worker(Side(OURS, "skydog_worker.py"), core) for core in cores[:2]]
    try:
        steps = [_warm_up(worker, seconds) for worker in workers]
        scaled = []
        for _ in range(rounds):
            alone = [worker.work(count) for worker, count in zip(workers, steps, strict=True)]
            for worker, count in zip(workers, steps, strict=True):
                worker.tell(steps=count, what="learn")
            both = [Slice(**worker.hear()) for worker in workers]
            one = statistics.mean(slice.speed for slice in alone)
            scaled.append(sum(slice.speed for slice in both) / one)
    finally:
        for worker in workers:
            worker.stop()
    middle = statistics.median(scaled)
    return [
        f"Two trainings, a core each, do {middle:.2f} × ({min(scaled):.2f} to {max(scaled):.2f}) "
        "what one does alone (aim: 1.8 ×)."
    ]


def _main_job() -> list[str]:
    """Time and memory of `skydog herd`, all its processes together."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(OURS), "-m", "skydog.cli", "herd", "--out", folder + "/run"]
        began, most = time.monotonic(), 0
        with open(folder + "/told", "w") as told:
            job = subprocess.Popen(command, stdout=told, stderr=told, start_new_session=True)
            while job.poll() is None:
                most = max(most, _memory(job.pid))
                time.sleep(0.1)
        took = time.monotonic() - began
        if job.returncode:
            raise Refusal(f"skydog herd failed: {Path(folder + '/told').read_text()[-500:]}")
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024**2
    return [
        f"`skydog herd` took {took:.0f} s, with {most / 1024**3:.2f} GB resident at most in all "
        f"its processes together (aim: 1.5 GB), {largest:.2f} GB in the largest."
    ]


def _memory(session: int) -> int:
    """Bytes resident of all processes of a session; what they share is counted for each."""
    total = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == session:
                total += int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
        except (OSError, IndexError):
            continue  # it has ended
    return total


if __name__ == "__main__":
    try:
        tyro.cli(bench, prog="bench.py", config=(tyro.conf.FlagCreatePairsOff,))
    except Refusal as refusal:
        print(f"bench: {refusal}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("bench: stopped", file=sys.stderr)
        sys.exit(130)
