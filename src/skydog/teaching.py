"""Teach sheepdogs: two trainings each, side by side, fused into a file with its card."""

import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from skydog import console, files
from skydog.errors import Refusal
from skydog.learning import workers
from skydog.learning.course import Course
from skydog.learning.train import History, checkpoint_in, init, load
from skydog.learning.workers import Job
from skydog.shepherds.sheepdog import Sheepdog
from skydog.words import Skill
from skydog.world import params

SKILLS: tuple[Skill, ...] = ("collect", "drive")


def jobs(course: Course, folder: Path, seed: int, resume: bool) -> list[Job]:
    """The two trainings of one sheepdog."""
    return [Job(course, skill, seed, folder / skill, resume) for skill in SKILLS]


def teach(todo: Sequence[Job], write: Callable[[workers.News], None] | None = None) -> bool:
    """Train every job in its folder; tell whether all were finished. `write` hears all news."""
    for job in todo:
        files.folder(job.folder)
    with console.TrainingBars(todo) as bars:

        def listen(news: workers.News) -> None:
            bars.listen(news)
            if write:
                write(news)

        return workers.run(todo, listen)


def fuse(course: Course, folder: Path, seed: int) -> tuple[Sheepdog, dict[Skill, History]]:
    """The sheepdog that the two trainings in a folder amount to, and their histories."""
    skills, histories = {}, {}
    for job in jobs(course, folder, seed, resume=True):
        blank = init(course.lesson(job.skill), course.config(), jax.random.key(0))
        training, histories[job.skill] = load(job.folder, blank, job.card)
        skills[job.skill] = training.agent.skill
    return Sheepdog(skills["collect"], skills["drive"], float(course.world().arena.size)), histories


def card(course: Course, seed: int, command: str, results: dict[str, Any]) -> dict[str, Any]:
    """Where a sheepdog comes from, and how good it is."""
    world = course.world()
    return {
        "name": course.dog,
        "learner": f"{course.learner}: one a skill",
        "preset": course.preset,
        "sheep": course.sheep,
        "speed_limit": f"{world.dog.speed:g} m/s" + " on each axis" * world.dog.per_axis,
        "reward": course.reward,
        "seed": seed,
        "steps_a_skill": course.steps,
        "one_scale": course.one_scale,
        "command": command,
        "config": asdict(course.config()),
        "world": params.flatten(world),
        "results": {
            f"{name} {figure}": value["mean"] if isinstance(value, dict) else value
            for name, row in results.items()
            for figure, value in row.items()
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


def refuse_to_overwrite(folders: Iterable[Path]) -> None:
    """Raise `Refusal` for a folder that holds a training already."""
    for folder in folders:
        if any(checkpoint_in(folder / skill).exists() for skill in SKILLS):
            raise Refusal(f"{folder} holds a training; add --resume, or choose another --out")
