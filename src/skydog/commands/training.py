"""Train sheepdogs: two trainings each or three, side by side, fused into a file with its card."""

import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args

import numpy as np

from skydog import files
from skydog.arrays import load_some
from skydog.commands import console
from skydog.errors import Refusal
from skydog.learning import workers
from skydog.learning.curriculum import Curriculum
from skydog.learning.history import History
from skydog.learning.options import Skill
from skydog.learning.train import KIND, blank, checkpoint_in, load
from skydog.learning.workers import Job
from skydog.shepherds import scope
from skydog.shepherds.sheepdog import Sheepdog
from skydog.world.limits import PerAxis
from skydog.world.serialise import flatten


def jobs(curriculum: Curriculum, folder: Path, seed: int, resume: bool) -> list[Job]:
    """The trainings of one sheepdog: two, or three if it navigates."""
    return [Job(curriculum, skill, seed, folder / skill, resume) for skill in curriculum.skills]


def train_all(
    todo: Sequence[Job],
    write: Callable[[workers.Message], None] | None = None,
    on: str | None = None,
) -> bool:
    """Train every job in its folder; tell whether all were finished.

    `write` gets every message; `on` says where to train, as for `workers.run`.
    """
    for job in todo:
        files.folder(job.folder)
    with console.TrainingBars(todo) as bars:

        def update(message: workers.Message) -> None:
            bars.update(message)
            if write:
                write(message)

        return workers.run(todo, update, on)


def check(out: Path, todo: Iterable[Job]) -> None:
    """Raise `Refusal`, in the words of the command line, for a job whose folder is of another.

    A folder that holds a training already, finished or not, is only resumed, and only by one
    of the same options that goes at least as far. `out` is the folder of the whole run.
    """
    todo = list(todo)
    asked = {checkpoint_in(job.folder) for job in todo}
    for path in _checkpoints(out):
        if path not in asked:
            raise Refusal(
                f"{out} holds another training, {path.parent.relative_to(out)}; "
                "choose another --out"
            )
    for job in todo:
        where, path = job.folder.parent, checkpoint_in(job.folder)
        if not files.exists(path):
            continue
        if not job.resume:
            raise Refusal(f"{where} holds a training; add --resume, or choose another --out")
        arrays, theirs = load_some(path, KIND, "step")
        if isinstance(theirs.get("seed"), int):
            theirs["seed"] = workers.typed(theirs["seed"])
        for name, ours in {**job.card, "seed": job.seed}.items():
            if theirs.get(name) != ours:
                option = f"--{name.replace('_', '-')}"
                raise Refusal(
                    f"{where} was trained with {option} {_typed(theirs.get(name))}, not "
                    f"{_typed(ours)}; resume with the same options, or choose another --out"
                )
        done = int(arrays["step"])
        if done > job.curriculum.steps:
            raise Refusal(
                f"{where} was trained for {done:,} steps already, more than the "
                f"{job.curriculum.steps:,} asked for; ask for as many, or choose another --out"
            )


def _checkpoints(out: Path) -> list[Path]:
    """The checkpoints of a run of `skydog herd` or `train`, of one sheepdog or several."""
    if not files.is_folder(out):
        return []
    places = [checkpoint_in(Path(skill)) for skill in get_args(Skill)]
    return [
        path
        for each in places
        for way in ("", "seed-*/")
        for path in files.listed(out, f"{way}{each}")
    ]


def _typed(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def fuse(curriculum: Curriculum, folder: Path, seed: int) -> tuple[Sheepdog, dict[Skill, History]]:
    """The sheepdog that the trainings in a folder amount to, and their histories."""
    skills, histories = {}, {}
    for job in jobs(curriculum, folder, seed, resume=True):
        like = blank(curriculum.lesson(job.skill), curriculum.config(job.skill))
        training, histories[job.skill] = load(job.folder, like, job.card)
        skills[job.skill] = training.agent.skill
    size = float(curriculum.world().arena.size)
    collect, drive, navigate = skills["collect"], skills["drive"], skills.get("navigate")
    return Sheepdog(collect, drive, size, curriculum.frame, navigate), histories


def on_the_way(
    curriculum: Curriculum, sheepdog: Sheepdog, histories: dict[Skill, History]
) -> dict[int, Sheepdog]:
    """The sheepdog by the steps that it had been taught each skill: untaught at 0, up to itself."""
    collect, drive = histories["collect"], histories["drive"]
    dogs = {
        step: replace(sheepdog, collect=collect.skill(step), drive=drive.skill(step))
        for step in np.intersect1d(collect.step, drive.step).tolist()
    }
    return dogs | {curriculum.steps: sheepdog}


def card(
    curriculum: Curriculum, seed: int, command: str, results: dict[str, Any]
) -> dict[str, Any]:
    """Where a sheepdog comes from, and how good it is."""
    world = curriculum.world()
    return {
        "name": curriculum.dog,
        "learner": f"{curriculum.learner}: one a skill",
        "preset": curriculum.preset if curriculum.own_world is None else None,
        "own_world": curriculum.own_world,
        "sheep": curriculum.sheep,
        "speed_limit": f"{world.dog.speed:g} m/s"
        + " on each axis" * isinstance(world.dog.limits, PerAxis),
        "reward": curriculum.reward,
        "seed": seed,
        "steps_a_skill": curriculum.steps,
        "one_scale": curriculum.one_scale,
        "taught_for": scope.scope(
            world, curriculum.scales, curriculum.frame == "folded", curriculum.sheep
        ),
        "command": command,
        "config": asdict(curriculum.config()),
        "world": flatten(world),
        "results": {
            f"{name} {figure}": value["mean"] if isinstance(value, dict) else value
            for name, row in results.items()
            for figure, value in row.items()
            if value is not None
        },
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("skydog", "jax", "equinox", "optax")},
        },
    }


def stopped(command: str, resumes: bool = False) -> None:
    """Say that nothing is lost; `resumes` if the command continues by itself."""
    again = command if resumes or "--resume" in command else f"{command} --resume"
    console.say(f"Stopped. What was learnt is kept; continue with: {again}")
