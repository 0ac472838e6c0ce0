"""The paper's simulation study: train all of it, fly all of it, and hold it against the paper."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from skydog import console, files, teaching
from skydog.errors import Refusal
from skydog.learning.course import Course
from skydog.learning.lessons import HORIZON
from skydog.learning.workers import Job
from skydog.shepherds import store
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.study import (
    claims,
    evaluate,
    paper,
    report,
    reproduction,
    statistics,
    transfer,
    verdict,
)
from skydog.study.cases import cases, shipped
from skydog.study.claims import Measured
from skydog.study.traces import save
from skydog.view import figures, replay
from skydog.view.figures import Curve
from skydog.words import Starts
from skydog.world import params
from skydog.world.mission import Shepherd, Trace
from skydog.world.params import World

Results = dict[str, Any]

SIZES = (4.0, 6.0)
SHOWN_CASE = 15  # the paper shows the trajectories of its 15th case
SHOWN = ("Strombom-6x6", "DHRL-6x6", "H-DDPG-6x6", "H-DDPG-4x4to6x6")
# The kinds of which several seeds are taught, and the arenas where one of them is chosen.
CHOSEN_IN = {
    "H-DDPG-4x4": transfer.ARENAS,
    "H-DDPG-6x6": (6.0,),
    "DHRL-4x4": (4.0, 6.0),
    "DHRL-6x6": (6.0,),
}
CHOSEN_BY = 200  # cases of either sort
AT_PAPERS_SPEED = f", {paper.STROMBOM_SPEED} m/s"
CHOSEN_SEED = 2  # the study's own have 0 and 1
CURVES = "learning_curves.csv"


@dataclass(frozen=True)
class Plan:
    """What is trained: so many sheepdogs of each kind, for so many episodes a skill."""

    seeds: int = 8
    episodes: int = 3_000  # as in the paper

    def course(self, arena: float, **options: Any) -> Course:
        """What the sheepdogs of one kind are taught."""
        steps = self.episodes * HORIZON["progress"]
        return Course(arena=arena, steps=steps, **options)

    def courses(self) -> list[Course]:
        """What sheepdogs of several seeds are taught: the shipped kinds, and the paper's lessons.

        The episodes of the paper's reward may last 1000 steps; they end with the others' steps.
        """
        kinds = [self.course(size, learner=how) for size in SIZES for how in ("ddpg", "dqn")]
        papers = [
            self.course(size, reward="paper", one_scale=True, episodes=self.episodes)
            for size in SIZES
        ]
        return [*kinds, self.course(4.0, one_scale=True), *papers]

    def jobs(self, out: Path) -> list[Job]:
        """Every training of the study; of the natives of other arenas, one seed."""
        pairs = [(course, seed) for course in self.courses() for seed in range(self.seeds)]
        pairs += [(self.course(size), 0) for size in transfer.ARENAS if size not in SIZES]
        return [
            job
            for course, seed in pairs
            for job in teaching.jobs(
                course, out / "trainings" / course.dog / f"seed-{seed}", seed, resume=True
            )
        ]


@dataclass(frozen=True)
class Taught:
    """Sheepdogs by what they are called, a seed each, and how the lessons of each skill went."""

    dogs: dict[str, list[Sheepdog]]
    curves: dict[str, list[Curve]]
    chosen: dict[str, int]  # which of several seeds flies for its kind


@dataclass(frozen=True)
class Flight:
    """A shepherd in a world; `rule` names the rule dog's flight that it is compared with."""

    shepherd: Shepherd
    world: World
    rule: str


def reproduce(out: Path, plan: Plan, from_zoo: bool, command: str) -> Results | None:
    """Do the study into a run folder, and return its results; None if it was stopped.

    What was trained in the folder before is not trained again. Raises `Refusal` for a plan of
    nothing, and for an `out` that cannot be written or that holds trainings of another kind.
    """
    for name, value in (("seeds", plan.seeds), ("episodes", plan.episodes)):
        if value < 1:
            raise Refusal(f"there are at least 1 {name}, got {value}; try --{name} 8")
    out = files.folder(out)
    if from_zoo:
        taught = from_the_zoo()
    else:
        todo = plan.jobs(out)
        console.say(f"Training {len(todo)} skills, a core each; Ctrl-C keeps what was learnt:")
        if not teaching.teach(todo):
            return teaching.stopped(command, resumes=True)
        console.say("Choosing the sheepdogs that fly ...")
        taught = fuse(plan, out)
    results, shown = fly_all(taught)
    if not from_zoo:
        write_zoo(out / "zoo", plan, taught, results["rows"])
    write(out, results, taught, shown, command)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


# Who flies


def fuse(plan: Plan, out: Path) -> Taught:
    """The sheepdogs of all trainings, and the learning curves."""
    dogs: dict[str, list[Sheepdog]] = {}
    curves: dict[str, list[Curve]] = {}
    for job in plan.jobs(out):
        if job.skill == "drive":  # both skills of a sheepdog are fused at once
            continue
        dog, histories = teaching.fuse(job.course, job.folder.parent, job.seed)
        dogs.setdefault(job.course.dog, []).append(dog)
        for skill, history in histories.items():
            curves.setdefault(f"{job.course.dog} {skill}", []).append(history.curve())
    chosen = {kind: best(dogs[kind], arenas) for kind, arenas in CHOSEN_IN.items()}
    return Taught(dogs, curves, chosen)


def best(dogs: list[Sheepdog], arenas: tuple[float, ...]) -> int:
    """Which of several seeds flies for its kind, and ships.

    The one that needs the fewest steps, a mission that fails counting with all of its 1000, for
    `CHOSEN_BY` cases drawn as the study's are and for as many drawn as its harder ones, in each
    of the arenas. They are other draws: the study's own cases have no say.
    """

    def steps(dog: Sheepdog) -> float:
        return sum(
            float(evaluate.measure(evaluate.fly(world, dog, starts))["steps"].sum())
            for world, starts in places
        )

    sorts: tuple[Starts, ...] = ("paper", "random")
    worlds = [params.preset("paper", arena) for arena in arenas]
    places = [
        (world, cases(world, CHOSEN_BY, sort, CHOSEN_SEED)) for world in worlds for sort in sorts
    ]
    return int(np.argmin([steps(dog) for dog in dogs]))


def from_the_zoo() -> Taught:
    """The sheepdogs that ship, and the learning curves of the study that made them."""
    dogs, chosen = {}, {}
    for name in store.ships():
        dog, card = store.read(name)
        dogs[card["name"]] = [dog]
        chosen[card["name"]] = 0
    return Taught(dogs, _read_curves(store.ZOO / CURVES), chosen)


def write_zoo(folder: Path, plan: Plan, taught: Taught, rows: Results) -> None:
    """Write the chosen sheepdogs and all learning curves, as they ship."""
    made = f"skydog reproduce --seeds {plan.seeds} --episodes {plan.episodes}"
    for course in plan.courses():
        if course.dog in taught.chosen:
            seed = taught.chosen[course.dog]
            card = teaching.card(course, seed, made, {course.dog: rows[course.dog]["ours"]})
            path = folder / f"{course.dog.lower()}.safetensors"
            store.save(path, taught.dogs[course.dog][seed], card)
    shown = {
        name: taught.curves[name] for papers in (False, True) for name in _shown(papers).values()
    }
    files.write_text(folder / CURVES, _curves_as_csv(shown))


# Where they fly


def flights(dogs: dict[str, Sheepdog]) -> dict[str, Flight]:
    """The paper's eight scenarios, and then ours beside them, by name."""
    flown = {}
    for name, scenario in paper.SCENARIOS.items():
        learnt = f"{scenario.shepherd}-{scenario.learnt}x{scenario.learnt}"
        flown[name] = Flight(
            Strombom() if scenario.learnt is None else dogs[learnt],
            params.preset("paper", float(scenario.flown)),
            f"Strombom-{scenario.flown}x{scenario.flown}",
        )
    for rule in ("Strombom-4x4", "Strombom-6x6"):
        world = flown[rule].world
        slow = Strombom(speed=paper.STROMBOM_SPEED)
        flown[rule.replace("-", "-arrive-")] = Flight(Strombom("arrive"), world, rule)
        flown[rule + AT_PAPERS_SPEED] = Flight(slow, world, rule)
    for name in ("Strombom-4x4", "H-DDPG-4x4", "Strombom-6x6", "H-DDPG-6x6", "H-DDPG-4x4to6x6"):
        shepherd, world, rule = flown[name].shepherd, flown[name].world, flown[name].rule
        world = replace(world, dog=replace(world.dog, per_axis=False))
        flown[f"{name}, 1 m/s"] = Flight(shepherd, world, f"{rule}, 1 m/s")
    return flown


def fly(flight: Flight) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Trace]:
    """The metrics of the 30 cases and of the 1,000 harder ones, and the trace of the 15th."""
    sets = shipped(flight.world, "paper"), shipped(flight.world, "hard")
    # Together, so that one compiled call serves both.
    both = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *sets)
    flown = evaluate.fly(flight.world, flight.shepherd, both)
    measured = evaluate.measure(flown)
    first = {name: values[: paper.CASES] for name, values in measured.items()}
    harder = {name: values[paper.CASES :] for name, values in measured.items()}
    return first, harder, evaluate.one_case(flown, SHOWN_CASE - 1)


def fly_all(taught: Taught) -> tuple[Results, dict[str, Trace]]:
    """All results of the study, and the missions that its figure shows."""
    dogs = {name: seeds[taught.chosen.get(name, 0)] for name, seeds in taught.dogs.items()}
    flown = flights(dogs)
    measured, harder, shown = {}, {}, {}
    for name, flight in console.counted("Flying the scenarios", flown.items()):
        measured[name], harder[name], shown[name] = fly(flight)
    moved = transferred(taught, dogs)
    rows = {
        name: row(name, flight, measured, harder)
        for name, flight in console.counted("Counting", flown.items())
    }
    eight = {name: rows.pop(name) for name in paper.SCENARIOS}
    findings = [
        *claims.accomplished(
            {name: row["ours"] for name, row in eight.items()},
            {name: row["hard"] for name, row in eight.items()},
        ),
        *claims.compared(measured),
        *claims.carried_over(moved),
        *claims.learnt(_curves(taught, papers=True)),
    ]
    results = {
        "rule": verdict.RULE,
        "rows": eight,
        "others": rows,
        "transfer": moved,
        "seeds": seeds_of(taught),
        "claims": [vars(finding) for finding in findings],
    }
    return results, {name: shown[name] for name in SHOWN}


def row(name: str, flight: Flight, measured: Measured, harder: Measured) -> Results:
    """All figures of a scenario: ours, on both sets of cases, and beside them the paper's."""
    ours = evaluate.figures(measured[name])
    told = {"n": ours["cases"], "ours": ours, "hard": evaluate.figures(harder[name])}
    if flight.rule != name:
        told["more_than_strombom"] = {
            metric: statistics.paired(measured[name][metric], measured[flight.rule][metric])
            for metric in ("steps", "steps_gcm", "distance")
        }
    # A rule dog at the speed of the paper's own is held against it too.
    printed = paper.PRINTED.get(name.removesuffix(AT_PAPERS_SPEED))
    if printed is not None:
        held = verdict.verdicts(ours, printed)
        told |= {"paper": printed, "verdict": verdict.verdict(held), "verdicts": held}
    return told


def transferred(taught: Taught, dogs: dict[str, Sheepdog]) -> Results:
    """The transfer study: rows of figures by arena, by how a sheepdog got there."""
    natives = {size: f"H-DDPG-{size:g}x{size:g}" for size in transfer.ARENAS}
    dog = dogs["H-DDPG-4x4"]
    lines = {
        reproduction.SCALED: lambda: transfer.sweep([dog], transfer.scaled, transfer.ARENAS),
        reproduction.UNSCALED: lambda: transfer.sweep([dog], transfer.unscaled, transfer.ARENAS),
        reproduction.NATIVE: lambda: {
            arena: row
            for size, name in natives.items()
            if name in dogs
            for arena, row in transfer.sweep([dogs[name]], transfer.scaled, [size]).items()
        },
    }
    for line, name in reproduction.ALL_SEEDS.items():
        if len(seeds := taught.dogs.get(name, [])) > 1:
            lines[line] = lambda seeds=seeds: transfer.sweep(
                seeds, transfer.scaled, transfer.ARENAS
            )
    return {line: fly() for line, fly in console.counted("Flying in other arenas", lines.items())}


def seeds_of(taught: Taught) -> Results:
    """Every seed of each kind, at home on the 30 cases."""
    several = {
        name: dogs for name, dogs in taught.dogs.items() if len(dogs) > 1 or name in taught.chosen
    }
    found = {}
    for name, dogs in console.counted("Flying every seed", several.items()):
        world = params.preset("paper", float(dogs[0].arena))
        starts = shipped(world, "paper")
        rows = [evaluate.row(evaluate.fly(world, dog, starts)) for dog in dogs]
        found[name] = {"chosen": taught.chosen.get(name), "rows": rows}
    return found


# What is written


def write(
    out: Path, results: Results, taught: Taught, shown: dict[str, Trace], command: str
) -> None:
    """Write results.json, report.html, the document of the claims, figures and traces."""
    report.write(out, results)
    files.write_text(out / "reproduces.md", reproduction.document(results, command))
    drawn = {
        "learning_curves": figures.learning_curves(_curves(taught, papers=False)),
        "learning_curves_paper": figures.learning_curves(_curves(taught, papers=True)),
        "trajectories": figures.trajectories(shown),
        "transfer": figures.transfer(results["transfer"]),
    }
    for name, figure in drawn.items():
        figures.save(figure, out / name)
    for name, trace in shown.items():
        save(out / "traces" / f"{name}.safetensors", trace, name)
    page = reproduction.page(
        results,
        {name: figures.svg(figure) for name, figure in drawn.items()},
        replay.player(shown),
        command,
    )
    files.write_text(out / "report.html", page)


def _shown(papers: bool) -> dict[str, str]:
    """The four models that the paper shows, in our lessons or in its own: panel and curve."""
    kind = "-paper-reward-one-scale" if papers else ""
    return {
        f"{skill} {size:g}x{size:g}": f"H-DDPG-{size:g}x{size:g}{kind} {skill}"
        for size in SIZES
        for skill in ("drive", "collect")
    }


def _curves(taught: Taught, papers: bool) -> dict[str, list[Curve]]:
    return {panel: taught.curves[name] for panel, name in _shown(papers).items()}


def _curves_as_csv(curves: dict[str, list[Curve]]) -> str:
    """A row every 10 episodes, a column a seed of a skill."""
    columns = {
        f"{name} seed {seed}": reward
        for name, seeds in curves.items()
        for seed, (_, reward) in enumerate(seeds)
    }
    episodes = max((curve[0] for seeds in curves.values() for curve in seeds), key=len)
    lines = [",".join(["episode", *columns])]
    for row, episode in enumerate(episodes):
        cells = [f"{reward[row]:.3g}" if row < len(reward) else "" for reward in columns.values()]
        lines.append(",".join([f"{episode:.0f}", *cells]))
    return "\n".join([*lines, ""])


def _read_curves(path: Path) -> dict[str, list[Curve]]:
    """The inverse of `_curves_as_csv`, from its file."""
    head, *lines = path.read_text("utf-8").splitlines()
    values = np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])
    curves: dict[str, list[Curve]] = {}
    for column, name in enumerate(head.split(",")[1:], 1):
        known = np.isfinite(values[:, column])
        skill, _ = name.rsplit(" seed ", 1)
        curves.setdefault(skill, []).append((values[known, 0], values[known, column]))
    return curves
