"""The main job: teach two skills, fuse them into a sheepdog, fly it, and show the result."""

from pathlib import Path
from typing import Any

from skydog import console, files, teaching
from skydog.errors import Refusal
from skydog.learning.course import Course
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, report, traces
from skydog.study.cases import cases
from skydog.view import figures, replay

Results = dict[str, Any]
"""Rows of figures, as `evaluate.row` makes them, by the name of their scenario."""

SHOWN_CASE = 15  # the paper shows the trajectories of its 15th case


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
        teaching.refuse_to_overwrite([out])
    out = files.folder(out)
    console.say(f"Teaching collect and drive from nothing, {course.steps:,} steps each:")
    if not teaching.teach(teaching.jobs(course, out, seed, resume)):
        return teaching.stopped(command)
    sheepdog, histories = teaching.fuse(course, out, seed)

    console.say(f"Flying {count} cases with each shepherd ...")
    shepherds = (sheepdog, Strombom(), Strombom(at_point="arrive"))
    flown = {
        evaluate.scenario(shepherd, world): evaluate.fly(world, shepherd, starts)
        for shepherd in shepherds
    }
    results = {name: evaluate.row(trace) for name, trace in flown.items()}
    ours = next(iter(results))
    store.save(
        out / store.FILE, sheepdog, teaching.card(course, seed, command, {ours: results[ours]})
    )
    report.write(out, results)
    files.write_text(out / "results.md", report.markdown(report.rows(results)))

    console.say("Drawing the figures and the report ...")
    shown_case = min(SHOWN_CASE, count)
    shown = {name: evaluate.one_case(trace, shown_case - 1) for name, trace in flown.items()}
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    curves = figures.learning_curves({skill: [h.curve()] for skill, h in histories.items()})
    paths = figures.trajectories(shown)
    figures.save(curves, out / "learning_curves")
    figures.save(paths, out / "trajectories")
    page = report.report(
        rows=report.rows(results),
        figures={
            "Learning curves: reward per action in every 10 episodes": figures.svg(curves),
            f"Case {shown_case}, flown by each shepherd": figures.svg(paths),
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
        teaching.refuse_to_overwrite(folders.values())
    write = console.tensorboard(out / "tensorboard") if tensorboard else None
    out = files.folder(out)
    console.say(f"Teaching {count} x 2 skills, {course.steps:,} steps each:")
    todo = [
        job
        for seed, folder in folders.items()
        for job in teaching.jobs(course, folder, seed, resume)
    ]
    if not teaching.teach(todo, write):
        return teaching.stopped(command)
    results = {}
    for seed, folder in folders.items():
        sheepdog, _ = teaching.fuse(course, folder, seed)
        starts = "paper" if course.sheep == 3 else "random"
        flown = evaluate.fly_noisily(
            world, sheepdog, cases(world, 30, starts, sheep=course.sheep), 0
        )
        row = evaluate.row(flown)
        name = evaluate.scenario(sheepdog, world)
        store.save(folder / store.FILE, sheepdog, teaching.card(course, seed, command, {name: row}))
        results[f"{name}, seed {seed}" if count > 1 else name] = row
    report.write(out, results)
    console.say(f"Everything is in {out}.")
    return results
