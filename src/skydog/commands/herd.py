"""`skydog herd`: train two skills, combine them into a sheepdog, fly it, and show the result."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from skydog.commands.flags import (
    STOPPED,
    Arena,
    Cases,
    Goal,
    GoalRadius,
    Json,
    Out,
    Seed,
    TrainingSteps,
    goal_of,
)
from skydog.learning.options import Reward

if TYPE_CHECKING:
    from skydog.learning.curriculum import Curriculum
    from skydog.learning.workers import Job
    from skydog.world.mission import Fly
    from skydog.world.params import World
    from skydog.world.state import State

SHOWN_CASE = 15  # the paper shows the trajectories of its 15th case
SHOWN_STEPS = 250  # of an untaught dog, which may never end

LEARNING = (
    "Left: 30 missions after every 5,000 training steps, with 95 % intervals; a mission that fails "
    "counts with 1000 steps. Right: reward per action in the training episodes. The thin line is "
    "the mean of 10 episodes, the thick line the running mean of 100."
)

NOTES = [
    "All shepherds fly the same cases under the same speed limit, ±1 m/s on each axis.",
    "Strombom keeps its speed and overshoots its point, as in the 2014 model; Strombom-arrive "
    "stops there. The paper does not say which of the two its baseline is.",
    "A mission that fails counts with all 1000 steps. Steps count until every sheep is home and "
    "the flock gathered; steps (GCM), as the paper counts, until its centre is home.",
    "The paper does not print its start layouts; these are ours, so its own figures beside are "
    "for scale, not for a test of equality.",
    "The sheepdog's skills were kept every 5,000 training steps. The learning figure shows 30 "
    "missions that each of these sheepdogs flew, with the sheep anywhere in the arena. No other "
    "mission on this page starts there.",
    "Rewards tell less than missions. Each training episode has an arena of its own, of 3 to 40 m, "
    "and a start of its own; the reward depends more on these than on the skill. The dog's actions "
    "have noise in training, and none in missions. The mean reward of a good dog may be negative, "
    "since each metre of flight and of distance to the subgoal costs something.",
]


def herd(
    out: Out = Path("runs/herd"),
    seed: Seed = 0,
    steps: TrainingSteps = 150_000,
    arena: Arena = 4.0,
    goal: Goal = None,
    goal_radius: GoalRadius = None,
    reward: Reward = "progress",
    cases: Cases = 30,
    resume: bool = False,
    as_json: Json = False,
) -> int:
    """Train a sheepdog from random weights, and compare it with the rule dog.

    Trains the skills collect and drive. Flies the test cases with the sheepdog and with
    Strömbom's rule dog. Prints a table with the paper's figures beside ours. Writes a run folder
    with results.json, the sheepdog, figures, and report.html with an animated replay. Ctrl-C
    loses nothing.

    Example: skydog herd --out runs/mine --seed 3

    Args:
        out: The run folder.
        seed: Random seed of the networks, the lessons' starts and the exploration noise.
        steps: Training steps for each of the two skills.
        arena: Side of the arena in metres, for the lessons and the test.
        goal: The goal's position in metres, such as 4,4; if not given 0,0, as in the paper.
        goal_radius: The goal's radius 𝔻 in metres; the paper's 2 if not given.
        reward: Reward function of the lessons; `paper` is the paper's ±0.1.
        cases: Missions that each shepherd flies.
        resume: Continue an interrupted run; the results are those of a run without interruption.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog.commands import console
    from skydog.learning.curriculum import Curriculum
    from skydog.study import evaluate

    curriculum = Curriculum(
        arena=arena, goal=goal_of(goal), goal_radius=goal_radius, reward=reward, steps=steps
    )
    command = console.command_line()
    results = run(out, curriculum, seed, cases, resume, command, evaluate.fly)
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
    command: str,
    fly: "Fly",
) -> dict[str, Any] | None:
    """Do the main job into a run folder; return its rows of figures, or None if it was stopped.

    `fly` flies the missions. Raises `Refusal` for an `out` that cannot be written and for
    parameters that cannot be.
    """
    from skydog import files
    from skydog.commands import training
    from skydog.study.cases import cases
    from skydog.world import presets

    world = curriculum.world()
    if curriculum.as_paper:
        world = presets.furthest_first(world)
    starts = cases(world, count, "paper", sheep=curriculum.sheep)
    todo = training.jobs(curriculum, out, seed, resume)
    with files.claimed(out):
        training.check(out, todo)
        return _run(out, curriculum, world, starts, todo, command, fly)


def _run(
    out: Path,
    curriculum: "Curriculum",
    world: "World",
    starts: "State",
    todo: "list[Job]",
    command: str,
    fly: "Fly",
) -> dict[str, Any] | None:
    from skydog import files
    from skydog.commands import console, training
    from skydog.shepherds import store
    from skydog.shepherds.strombom import Strombom
    from skydog.study import evaluate, progress, report
    from skydog.view import figures, replay
    from skydog.world import trace as traces
    from skydog.world.mission import MAX_STEPS

    count, as_paper = len(starts.dogs), curriculum.as_paper
    console.say(f"Training collect and drive from random weights, {curriculum.steps:,} steps each:")
    seed = todo[0].seed
    if not training.train_all(todo):
        return training.stopped(command)
    sheepdog, histories = training.fuse(curriculum, out, seed)

    console.say(f"Flying {count} cases with each shepherd ...")
    shepherds = (sheepdog, Strombom(), Strombom(at_point="arrive"))
    flown = {
        evaluate.scenario(each, world, curriculum.dog): fly(world, each, starts, MAX_STEPS, None)
        for each in shepherds
    }
    console.say_over(next(iter(flown.values())))
    results = {name: evaluate.row(trace) for name, trace in flown.items()}
    ours = next(iter(results))
    card = training.card(curriculum, seed, command, {ours: results[ours]})
    store.save(out / store.FILE, sheepdog, card)
    report.write(out, results)
    files.write_text(out / "results.md", report.markdown(report.rows(results, as_paper)))

    dogs = training.on_the_way(curriculum, sheepdog, histories)
    learnt, rule = progress.fly_all(world, dogs, curriculum.sheep, fly)
    files.write_text(out / "progress.csv", progress.csv(learnt))
    console.say(progress.told(learnt, rule))

    console.say("Drawing the figures and the report ...")
    shown_case = min(SHOWN_CASE, count)
    shown = {name: evaluate.one_case(trace, shown_case - 1) for name, trace in flown.items()}
    untaught = fly(world, dogs[min(dogs)], starts, MAX_STEPS, None)
    taught = {
        f"after {min(dogs):,} training steps": evaluate.one_case(untaught, shown_case - 1),
        f"after {max(dogs):,} training steps": shown[ours],
    }
    taught = {name: traces.beginning(trace, SHOWN_STEPS) for name, trace in taught.items()}
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    curves = figures.learning(learnt, rule, {s: h.curve() for s, h in histories.items()})
    paths = figures.trajectories(shown)
    figures.save(curves, out / "learning_curves")
    figures.save(paths, out / "trajectories")
    page = report.report(
        rows=report.rows(results, as_paper),
        replays={
            "Replay": replay.player(shown),
            "An untaught and a taught dog": "<p>Both start the same mission. They are shown "
            f"until it is accomplished, or for {SHOWN_STEPS} steps.</p>{replay.beside(taught)}",
        },
        figures={
            "Learning": {LEARNING: figures.svg(curves)},
            "Paths": {f"Case {shown_case}, flown by each shepherd.": figures.svg(paths)},
        },
        command=command,
        notes=NOTES,
    )
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results
