"""`skydog reproduce`: train and fly the paper's study, and compare it with the paper."""

import json
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skydog import files
from skydog.commands.flags import STOPPED, Episodes, Json, MaybeOn, MaybeOut, Seeds
from skydog.errors import Refusal

if TYPE_CHECKING:
    from rich.table import Table

    from skydog.commands.zoo import Plan
    from skydog.study.scenarios import Trained
    from skydog.world.mission import Fly
    from skydog.world.trace import Trace

SEEDS, EPISODES = 8, 3_000  # of each kind of sheepdog; the paper has 3,000 episodes


def reproduce(
    out: MaybeOut = None,
    seeds: Seeds = SEEDS,
    episodes: Episodes = EPISODES,
    from_zoo: bool = False,
    physical: bool = False,
    patterns: bool = False,
    teams: bool = False,
    herdability: bool = False,
    mixed: bool = False,
    scenes: bool = False,
    navigate: bool = False,
    on: MaybeOn = None,
    as_json: Json = False,
) -> int:
    """Repeat the paper's simulation study, its physical study, or fly another study.

    Trains all sheepdogs of the study, flies the paper's eight scenarios and more, and writes
    report.html and results.json with all tables, figures and claims, and a verdict on each claim.
    After Ctrl-C, call it again to continue.

    Example: skydog reproduce --from-zoo

    Args:
        out: The run folder; if not given runs/reproduce, or runs/ and the name of the study.
        seeds: Number of sheepdogs of each kind, one per seed.
        episodes: Training episodes of each skill; the paper has 3000.
        from_zoo: Train nothing; fly the sheepdogs that ship.
        physical: Repeat the paper's physical study, in the physics twin.
        patterns: Fly the six patterns of El-Fiqi et al. 2020 instead; trains nothing.
        teams: Fly several dogs beside one instead; trains nothing.
        herdability: Measure how few dogs capture how many sheep that do not hold together.
        mixed: Fly flocks in which some sheep are of another kind instead; trains nothing.
        scenes: Herd around obstacles instead, in the five scenes; trains nothing.
        navigate: Fly with a map, with the skill navigate, with neither; trains nothing.
        on: Train on a Ray cluster: `ray` for the one that runs here, or its address. See
            docs/many.md. Missions are flown here.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog.commands import console
    from skydog.commands.zoo import Plan
    from skydog.study import evaluate

    command = console.command_line()
    others = {
        "physical": physical,
        "patterns": patterns,
        "teams": teams,
        "herdability": herdability,
        "mixed": mixed,
        "scenes": scenes,
        "navigate": navigate,
    }
    chosen = [name for name, wanted in others.items() if wanted]
    if len(chosen) > 1:
        raise Refusal(f"--{chosen[0]} and --{chosen[1]} are two studies; leave one of them out")
    trains = not chosen or physical
    of_trainings = on is not None or (seeds, episodes) != (SEEDS, EPISODES)
    if not trains and (from_zoo or of_trainings):
        raise Refusal(
            f"--{chosen[0]} trains nothing; leave --from-zoo, --seeds, --episodes and --on out"
        )
    out = out or Path("runs") / (chosen[0] if chosen else "reproduce")
    if from_zoo and files.exists(out / "trainings"):
        raise Refusal(f"{out} holds a study that was trained; with --from-zoo choose another --out")
    if physical:
        from skydog.commands import physical as physics
        from skydog.study.physical import summary as table

        with files.claimed(out):
            results = physics.run(out, seeds, episodes, from_zoo, command, on)
    elif chosen:
        study = import_module(f"skydog.commands.{chosen[0]}")
        table = import_module(f"skydog.study.{chosen[0]}_page").summary
        with files.claimed(out):
            results = study.run(out, command)
    else:
        table = _table
        with files.claimed(out):
            results = run(out, Plan(seeds, episodes), from_zoo, command, evaluate.fly, on)
    if results is None:
        return STOPPED
    if as_json:
        print(json.dumps(results, indent=2))
    else:
        console.print_table(table(results))
    return 0


def _table(results: dict[str, Any]) -> "Table":
    from skydog.study import report, reproduction

    return report.table(reproduction.rows(results))


def run(
    out: Path,
    plan: "Plan",
    from_zoo: bool,
    command: str,
    fly: "Fly",
    on: str | None = None,
) -> dict[str, Any] | None:
    """Do the study into a run folder, and return its results; None if it was stopped.

    What was trained in the folder before is not trained again; `on` says where to train, as for
    `workers.run`; `fly` flies the missions. Raises `Refusal` for an `out` that cannot be written
    or that holds trainings of another kind.
    """
    from skydog.commands import console, training, zoo
    from skydog.study import scenarios

    out = files.folder(out)
    if from_zoo:
        trained = zoo.read()
    else:
        todo = plan.jobs(out)
        training.check(out, todo)
        console.say(f"Training {len(todo)} skills, a core each; Ctrl-C keeps what was learnt:")
        if not training.train_all(todo, on=on):
            return training.stopped(command, resumes=True)
        console.say("Choosing the sheepdogs that fly ...")
        trained = zoo.fuse(plan, out, fly)
    results, shown = scenarios.fly_all(trained, fly, console.track)
    if not from_zoo:
        zoo.write(out / "zoo", plan, trained, results["rows"] | results["others"])
    write(out, results, trained, shown, command)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


def write(
    out: Path, results: dict[str, Any], trained: "Trained", shown: "dict[str, Trace]", command: str
) -> None:
    """Write results.json, report.html, the document of the claims, figures and traces."""
    from skydog import files
    from skydog.study import report, reproduction, scenarios
    from skydog.view import figures, replay
    from skydog.world import trace as traces

    report.write(out, results)
    files.write_text(out / "reproduces.md", reproduction.document(results, command))
    drawn = {
        "learning_curves": figures.learning_curves(scenarios.curves(trained, papers=False)),
        "learning_curves_paper": figures.learning_curves(scenarios.curves(trained, papers=True)),
        "trajectories": figures.trajectories(shown),
        "transfer": figures.transfer(results["transfer"]),
    }
    for name, figure in drawn.items():
        figures.save(figure, out / name)
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    page = reproduction.page(
        results,
        {name: figures.svg(figure) for name, figure in drawn.items()},
        replay.player(shown),
        command,
    )
    files.write_text(out / "report.html", page)
