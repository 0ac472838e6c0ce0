"""The main job: teach two skills, fuse them into a sheepdog, fly it, and show the result."""

import json
import platform
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from skydog import console, files
from skydog.errors import Refusal
from skydog.learning import ddpg, lessons, workers
from skydog.learning.train import History, checkpoint_in, init, load
from skydog.learning.workers import Job
from skydog.shepherds import store
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, paper, report, traces
from skydog.study.cases import cases
from skydog.view import figures, replay
from skydog.words import AtPoint, Reward, Skill, Starts
from skydog.world import params
from skydog.world.mission import Shepherd, State, Trace
from skydog.world.params import World

Results = dict[str, Any]
"""Rows of figures, as `evaluate.row` makes them, by the name of their scenario."""

SKILLS: tuple[Skill, ...] = ("collect", "drive")
SHOWN_CASE = 15  # the paper shows the trajectories of its 15th case


@dataclass(frozen=True)
class Course:
    """What a sheepdog is taught, and where."""

    preset: str = "paper"
    arena: float | None = None
    sheep: int = 3
    reward: Reward = "progress"
    steps: int = 100_000

    def world(self) -> World:
        """The world of the lessons. Raises `Refusal` for parameters that cannot be."""
        if self.steps < 1:
            raise Refusal(
                f"a skill is taught for at least 1 step, got {self.steps}; try --steps 100000"
            )
        return params.preset(self.preset, self.arena, self.sheep)

    def jobs(self, folder: Path, seed: int, resume: bool) -> list[Job]:
        """The two trainings of one sheepdog."""
        return [
            Job(
                preset=self.preset,
                arena=float(self.world().arena.size),
                sheep=self.sheep,
                skill=skill,
                reward=self.reward,
                seed=seed,
                steps=self.steps,
                folder=folder / skill,
                resume=resume,
            )
            for skill in SKILLS
        ]


def teach(
    course: Course,
    folders: dict[int, Path],
    resume: bool,
    write: Callable[[workers.News], None] | None = None,
) -> bool:
    """Train a sheepdog a seed, each in its folder; tell whether all of them were finished.

    `write` hears all news too.
    """
    jobs = [job for seed, folder in folders.items() for job in course.jobs(folder, seed, resume)]
    for job in jobs:
        files.folder(job.folder)
    with console.TrainingBars(jobs) as bars:

        def listen(news: workers.News) -> None:
            bars.listen(news)
            if write:
                write(news)

        return workers.run(jobs, listen)


def fuse(course: Course, folder: Path, seed: int) -> tuple[Sheepdog, dict[Skill, History]]:
    """The sheepdog that the two trainings in a folder amount to, and their histories."""
    world, skills, histories = course.world(), {}, {}
    for job in course.jobs(folder, seed, resume=True):
        lesson = lessons.Lesson(world, job.skill, job.reward, job.sheep)
        blank = init(lesson, ddpg.Config(), jax.random.key(0))
        training, histories[job.skill] = load(job.folder, blank, job.card)
        skills[job.skill] = training.agent.skill
    return Sheepdog(skills["collect"], skills["drive"], float(world.arena.size)), histories


def card(course: Course, seed: int, command: str, results: Results) -> dict[str, Any]:
    """Where a sheepdog comes from, and how good it is."""
    world = course.world()
    return {
        "learner": "H-DDPG: a DDPG a skill",
        "preset": course.preset,
        "sheep": course.sheep,
        "speed_limit": f"{world.dog.speed:g} m/s" + " on each axis" * world.dog.per_axis,
        "reward": course.reward,
        "seed": seed,
        "steps_a_skill": course.steps,
        "command": command,
        "config": asdict(ddpg.Config()),
        "world": params.flatten(world),
        "results": {
            f"{name} {figure}": value if isinstance(value, int | float) else value["mean"]
            for name, row in results.items()
            for figure, value in row.items()
        },
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("skydog", "jax", "equinox", "optax")},
        },
    }


def scenario(shepherd: Shepherd, world: World) -> str:
    """The paper's name for a shepherd in an arena: H-DDPG-4x4, or H-DDPG-4x4to6x6 if it learnt
    in another."""
    flown = f"{world.arena.size:g}x{world.arena.size:g}"
    if isinstance(shepherd, Strombom):
        return f"Strombom{'-arrive' if shepherd.at_point == 'arrive' else ''}-{flown}"
    if isinstance(shepherd, Sheepdog) and shepherd.arena != world.arena.size:
        return f"H-DDPG-{shepherd.arena:g}x{shepherd.arena:g}to{flown}"
    return f"H-DDPG-{flown}"


NOTES = [
    "All shepherds fly the same cases under the same speed limit, ±1 m/s on each axis.",
    "Strombom keeps its speed and overshoots its point, as in the 2014 model; Strombom-arrive "
    "stops there. The paper does not say which of the two its baseline is.",
    "A mission that fails counts with all 1000 steps. Steps count until every sheep is home and "
    "the flock gathered; steps (GCM), as the paper counts, until its centre is home.",
    "The paper does not print its start layouts; these are ours, so its own figures beside are "
    "for scale, not for a test of equality.",
]


def herd(
    out: Path, course: Course, seed: int, count: int, resume: bool, command: str
) -> Results | None:
    """Do the main job into a run folder, and return its results; None if it was stopped.

    Raises `Refusal` for an `out` that cannot be written and for parameters that cannot be.
    """
    world = course.world()
    starts = cases(world, count, "paper", sheep=course.sheep)
    # A finished run is replaced, as by any other make; one that was interrupted is work to lose.
    if not resume and not (out / "results.json").exists():
        _refuse_to_overwrite([out])
    out = files.folder(out)
    console.say(f"Teaching collect and drive from nothing, {course.steps:,} steps each:")
    if not teach(course, {seed: out}, resume):
        return stopped(command)
    sheepdog, histories = fuse(course, out, seed)

    console.say(f"Flying {count} cases with each shepherd ...")
    shepherds = (sheepdog, Strombom(), Strombom(at_point="arrive"))
    flown = {
        scenario(shepherd, world): evaluate.fly(world, shepherd, starts) for shepherd in shepherds
    }
    results = {name: evaluate.row(trace) for name, trace in flown.items()}
    ours = next(iter(results))
    store.save(out / store.FILE, sheepdog, card(course, seed, command, {ours: results[ours]}))
    write_results(out, results)
    files.write_text(out / "results.md", report.markdown(rows(results)))

    console.say("Drawing the figures and the report ...")
    shown = {name: one_case(trace, min(SHOWN_CASE, count) - 1) for name, trace in flown.items()}
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    curves = figures.learning_curves({skill: [curve(h)] for skill, h in histories.items()})
    paths = figures.trajectories(shown)
    figures.save(curves, out / "learning_curves")
    figures.save(paths, out / "trajectories")
    page = report.report(
        rows=rows(results),
        figures={
            "Learning curves: reward per action in every 10 episodes": figures.svg(curves),
            f"Case {min(SHOWN_CASE, count)}, flown by each shepherd": figures.svg(paths),
        },
        player=replay.player(shown),
        command=command,
        notes=NOTES,
    )
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


def train(
    out: Path,
    course: Course,
    seed: int,
    count: int,
    resume: bool,
    tensorboard: bool,
    command: str,
) -> Results | None:
    """Teach `count` sheepdogs and test each on the 30 cases; None if it was stopped.

    Raises `Refusal` for an `out` that cannot be written or that holds trainings already,
    unless they are to be resumed.
    """
    if count < 1:
        raise Refusal(f"there is at least 1 sheepdog to teach, got {count}; try --seeds 8")
    world = course.world()
    seeds = range(seed, seed + count)
    folders = {seed: out / f"seed-{seed}" if count > 1 else out for seed in seeds}
    if not resume:
        _refuse_to_overwrite(folders.values())
    write = console.tensorboard(out / "tensorboard") if tensorboard else None
    out = files.folder(out)
    console.say(f"Teaching {count} x 2 skills, {course.steps:,} steps each:")
    if not teach(course, folders, resume, write):
        return stopped(command)
    results = {}
    for seed, folder in folders.items():
        sheepdog, _ = fuse(course, folder, seed)
        starts = "paper" if course.sheep == 3 else "random"
        row = evaluate.row(fly(world, sheepdog, cases(world, 30, starts, sheep=course.sheep), 0))
        name = scenario(sheepdog, world)
        store.save(folder / store.FILE, sheepdog, card(course, seed, command, {name: row}))
        results[f"{name}, seed {seed}" if count > 1 else name] = row
    write_results(out, results)
    console.say(f"Everything is in {out}.")
    return results


def test(
    shepherd: str,
    world: World,
    count: int,
    starts: Starts,
    seed: int,
    sheep: int,
    dogs: int,
    at_point: AtPoint,
    out: Path | None,
) -> Results:
    """Fly `strombom`, or a sheepdog by its file or run folder, through cases of a world.

    With `out`, the results and every mission's trace are written there.
    """
    rule_dog = shepherd == "strombom"
    steers = Strombom(at_point=at_point) if rule_dog else store.load(shepherd)
    name = scenario(steers, world)
    if out is not None:
        files.folder(out)
    flown = fly(world, steers, cases(world, count, starts, seed, sheep, dogs), seed)
    results = {name: evaluate.row(flown)}
    if out is not None:
        write_results(out, results)
        for case in range(count):
            path = out / "traces" / f"{name}-{case + 1}.safetensors"
            traces.save(path, one_case(flown, case), name)
    return results


def fly(world: World, shepherd: Shepherd, starts: State, seed: int) -> Trace:
    """Missions from `starts`, with the noise that the world asks for, if any."""
    key = jax.random.key(seed) if params.noisy(world) else None
    return evaluate.fly(world, shepherd, starts, key=key)


def rows(results: Results, as_paper: bool = True) -> list[report.Row]:
    """Results for a table: beside the paper's own figures, if the cases are as the paper's."""
    printed = paper.PRINTED if as_paper else {}
    return [report.Row(name, row, printed.get(name)) for name, row in results.items()]


def write_results(out: Path, results: Results) -> None:
    """Write `results.json`."""
    files.write_text(out / "results.json", json.dumps(files.plain(results), indent=2) + "\n")


def one_case(flown: Trace, case: int) -> Trace:
    """One mission out of those flown together."""
    return jax.tree.map(lambda leaf: leaf[case], flown)


def curve(history: History) -> tuple[np.ndarray, np.ndarray]:
    """Episodes, and the reward per action in the 10 up to each."""
    every_ten = history.rows()
    return np.array([row[0] for row in every_ten]), np.array([row[1] for row in every_ten])


def stopped(command: str) -> None:
    """Say that nothing is lost."""
    resuming = command if "--resume" in command else f"{command} --resume"
    console.say(f"Stopped. What was learnt is kept; continue with: {resuming}")


def _refuse_to_overwrite(folders: Iterable[Path]) -> None:
    for folder in folders:
        if any(checkpoint_in(folder / skill).exists() for skill in SKILLS):
            raise Refusal(f"{folder} holds a training; add --resume, or choose another --out")
