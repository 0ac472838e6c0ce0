"""`skydog train`: train one sheepdog, or several at once, and test each."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skydog.commands.flags import (
    STOPPED,
    Goal,
    GoalRadius,
    Json,
    MaybeArena,
    MaybeOn,
    MaybeScene,
    MaybeSheep,
    Out,
    OwnWorld,
    Preset,
    Seed,
    Seeds,
    TrainingSteps,
    goal_of,
    one_world,
    own_sheep,
)
from skydog.errors import Refusal
from skydog.learning.options import Bodies, Learner, Reward
from skydog.shepherds.options import Frame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skydog.learning.curriculum import Curriculum
    from skydog.learning.workers import Job, Message
    from skydog.shepherds.sheepdog import Sheepdog
    from skydog.world.mission import Fly
    from skydog.world.trace import Trace

CASES = 30  # missions that test a sheepdog


def train(
    out: Out = Path("runs/train"),
    seed: Seed = 0,
    seeds: Seeds = 1,
    steps: TrainingSteps = 150_000,
    preset: Preset = "paper",
    world: OwnWorld = None,
    scene: MaybeScene = None,
    arena: MaybeArena = None,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    sheep: MaybeSheep = None,
    learner: Learner = "ddpg",
    reward: Reward = "progress",
    frame: Frame = "folded",
    bodies: Bodies = "ideal",
    navigate: bool = False,
    resume: bool = False,
    tensorboard: bool = False,
    on: MaybeOn = None,
    as_json: Json = False,
) -> int:
    """Train one sheepdog, or several at once, and test each.

    A sheepdog needs two trainings, of the skills collect and drive, or three. Each training runs
    on its own core. The folder of a sheepdog has its learning curves as CSV, its checkpoints, and
    at the end the sheepdog. Ctrl-C loses nothing: --resume continues with the same results.

    Example: skydog train --seeds 8 --out runs/eight

    Args:
        out: The run folder; each of several sheepdogs has its own folder in it, such as seed-3.
        seed: Random seed of the first sheepdog.
        seeds: How many sheepdogs, one per seed.
        steps: Training steps for each of the skills.
        preset: The world of the lessons; see skydog presets.
        world: Your own world instead: the name of a world, or of a function of arena and sheep,
            in a Python file, which is run. See docs/own.md.
        scene: Refused: the lessons are in the open, and their sheepdog herds in any scene.
        arena: Side of the arena in metres; the world's own if not given.
        goal: The goal's position in metres, such as 4,4; the world's own if not given. A
            sheepdog with the folded frame herds to any goal.
        goal_radius: The goal's radius 𝔻 in metres; the world's own if not given.
        sheep: Sheep in the flock; as many as the world has if not given, 3 in a preset.
        learner: `ddpg` trains the paper's H-DDPG, `dqn` the earlier DHRL with its four actions.
        reward: Reward function of the lessons; `paper` is the paper's ±0.1.
        frame: `folded`: the dog sees the arena mirrored so that one skill works in all
            directions. `paper`: it sees the world's axes, and the lessons have one goal.
        bodies: How dogs and sheep move in the lessons: `ideal`: as commanded; `physical`: with
            delay, drift and inertia, as in the twin.
        navigate: Teach a third skill too, to find the way among obstacles without a map.
        resume: Continue an interrupted run; the results are those of a run without interruption.
        tensorboard: Write the curves for TensorBoard too, in the run folder.
        on: Train and fly on a Ray cluster: `ray` for the one that runs here, or its address. See
            docs/many.md.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog.commands import console
    from skydog.learning.curriculum import Curriculum
    from skydog.study import evaluate

    if scene is not None:
        raise Refusal(
            "lessons have no obstacles, and a sheepdog that is trained in the open herds in any "
            f"scene; leave out --scene, and fly it with skydog test RUN --scene {scene}"
        )
    one_world(preset, world)
    sheep = own_sheep(world, sheep)
    curriculum = Curriculum(
        preset,
        arena,
        sheep,
        reward,
        steps,
        learner,
        own_world=world,
        goal=goal_of(goal),
        goal_radius=goal_radius,
        frame=frame,
        bodies=bodies,
        navigates=navigate,
    )
    command = console.command_line()
    results = run(out, curriculum, seed, seeds, resume, tensorboard, command, evaluate.fly, on)
    if results is None:
        return STOPPED
    console.show(results, as_json, curriculum.as_paper)
    return 0


def run(
    out: Path,
    curriculum: "Curriculum",
    seed: int,
    count: int,
    resume: bool,
    tensorboard: bool,
    command: str,
    fly: "Fly",
    on: str | None = None,
) -> dict[str, Any] | None:
    """Teach `count` sheepdogs, test each, and return the rows of figures; None if it was stopped.

    `fly` flies the missions of the test; `on` says where to train and fly, as for `workers.run`.
    Raises `Refusal` for an `out` that cannot be written or that holds trainings already, unless
    they are to be resumed.
    """
    from skydog import files, quantities
    from skydog.commands import console, training
    from skydog.learning import ray_cluster

    quantities.SEEDS.checked(count)
    curriculum.world()  # what cannot be is refused before anything is written
    seeds = range(seed, seed + count)
    folders = {seed: out / f"seed-{seed}" if count > 1 else out for seed in seeds}
    todo = [
        job
        for seed, folder in folders.items()
        for job in training.jobs(curriculum, folder, seed, resume)
    ]
    write = console.tensorboard(out / "tensorboard") if tensorboard else None
    with files.claimed(out):
        training.check(out, todo)
        with ray_cluster.held(on):
            return _train(out, curriculum, folders, todo, write, command, fly, on)


def _train(
    out: Path,
    curriculum: "Curriculum",
    folders: dict[int, Path],
    todo: "list[Job]",
    write: "Callable[[Message], None] | None",
    command: str,
    fly: "Fly",
    on: str | None,
) -> dict[str, Any] | None:
    from skydog.commands import console, training
    from skydog.shepherds import store
    from skydog.study import evaluate, report

    count = len(folders)
    console.say(
        f"Training {count} x {len(curriculum.skills)} skills, {curriculum.steps:,} steps each:"
    )
    if not training.train_all(todo, write, on):
        return training.stopped(command)
    sheepdogs = [training.fuse(curriculum, folder, seed)[0] for seed, folder in folders.items()]
    results = {}
    for (seed, folder), sheepdog, flown in zip(
        folders.items(), sheepdogs, _tested(curriculum, sheepdogs, fly, on), strict=True
    ):
        console.say_over(flown)
        name, row = curriculum.dog, evaluate.row(flown)
        card = training.card(curriculum, seed, command, {name: row})
        store.save(folder / store.FILE, sheepdog, card)
        results[f"{name}, seed {seed}" if count > 1 else name] = row
    report.write(out, results)
    console.say(f"Everything is in {out}.")
    return results


def _tested(
    curriculum: "Curriculum", sheepdogs: "list[Sheepdog]", fly: "Fly", on: str | None
) -> "Iterator[Trace]":
    """The missions that test each sheepdog, stacked along a first axis."""
    if on is None:
        return (_flown(curriculum, fly, sheepdog) for sheepdog in sheepdogs)
    from skydog.learning import ray_cluster

    return ray_cluster.each(partial(_flown, curriculum.anywhere(), fly), sheepdogs, on)


def _flown(curriculum: "Curriculum", fly: "Fly", sheepdog: "Sheepdog") -> "Trace":
    from skydog.study import evaluate
    from skydog.study.cases import PAPER_LAYOUT, cases
    from skydog.world import presets
    from skydog.world.mission import MAX_STEPS

    world = curriculum.world()
    if curriculum.as_paper:
        world = presets.furthest_first(world)
    drawn = "paper" if curriculum.sheep == len(PAPER_LAYOUT) else "random"
    starts = cases(world, CASES, drawn, sheep=curriculum.sheep)
    return fly(world, sheepdog, starts, MAX_STEPS, evaluate.noise_key(world, 0))
