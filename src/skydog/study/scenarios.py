"""The paper's simulation study: its eight scenarios and ours beside them, flown and measured."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from skydog.learning.history import Curve
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.study import (
    best,
    claims,
    evaluate,
    paper,
    reproduction,
    robustness,
    statistics,
    transfer,
    verdict,
)
from skydog.study.cases import shipped
from skydog.study.claims import Measured
from skydog.study.options import PAPER_FRAME, Results, Track
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.mission import MAX_STEPS, Fly, Shepherd
from skydog.world.params import World
from skydog.world.presets import furthest_first, preset
from skydog.world.trace import Trace

SIZES = (4.0, 6.0)
SHOWN_CASE = 15  # the paper shows the trajectories of its 15th case
SHOWN = ("Strombom-6x6", "DHRL-6x6", "H-DDPG-6x6", "H-DDPG-4x4to6x6")
AT_PAPERS_SPEED = f", {paper.STROMBOM_SPEED} m/s"


@dataclass(frozen=True)
class Trained:
    """Sheepdogs by what they are called, one per seed, and how the lessons of each skill went."""

    dogs: dict[str, list[Sheepdog]]
    curves: dict[str, list[Curve]]
    chosen: dict[str, int]  # which of several seeds flies for its kind


@dataclass(frozen=True)
class Flight:
    """A shepherd in a world; `rule` names the rule dog's flight that it is compared with."""

    shepherd: Shepherd
    world: World
    rule: str


def flights(dogs: dict[str, Sheepdog]) -> dict[str, Flight]:
    """The paper's eight scenarios, and then ours beside them, by name."""
    flown = {}
    for name, scenario in paper.SCENARIOS.items():
        learnt = f"{scenario.shepherd}-{scenario.learnt}x{scenario.learnt}"
        flown[name] = Flight(
            Strombom() if scenario.learnt is None else dogs[learnt],
            furthest_first(preset("paper", float(scenario.flown))),
            f"Strombom-{scenario.flown}x{scenario.flown}",
        )
    for rule in ("Strombom-4x4", "Strombom-6x6"):
        world = flown[rule].world
        slow = Strombom(speed=paper.STROMBOM_SPEED)
        flown[rule.replace("-", "-arrive-")] = Flight(Strombom("arrive"), world, rule)
        flown[rule + AT_PAPERS_SPEED] = Flight(slow, world, rule)
    for name in ("Strombom-4x4", "H-DDPG-4x4", "Strombom-6x6", "H-DDPG-6x6", "H-DDPG-4x4to6x6"):
        shepherd, world, rule = flown[name].shepherd, flown[name].world, flown[name].rule
        world = replace(world, dog=replace(world.dog, limits=AnyDirection()))
        flown[f"{name}, 1 m/s"] = Flight(shepherd, world, f"{rule}, 1 m/s")
    for name, scenario in paper.SCENARIOS.items():
        if scenario.learnt is not None:
            learnt = f"{scenario.shepherd}-{scenario.learnt}x{scenario.learnt}{PAPER_FRAME}"
            flown[row_of(name + PAPER_FRAME)] = replace(flown[name], shepherd=dogs[learnt])
    return flown


def row_of(dog: str) -> str:
    """The row of a sheepdog in its own arena."""
    return dog.replace(PAPER_FRAME, ", paper's frame")


def fly_one(flight: Flight, fly: Fly) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Trace]:
    """The metrics of the 30 cases and of the 1,000 random starts, and the trace of the 15th."""
    sets = shipped(flight.world, "paper"), shipped(flight.world, "random")
    # Together, so that one compiled call serves both.
    both = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *sets)
    flown = fly(flight.world, flight.shepherd, both, MAX_STEPS, None)
    measured = evaluate.measure(flown)
    first = {name: values[: paper.CASES] for name, values in measured.items()}
    random = {name: values[paper.CASES :] for name, values in measured.items()}
    return first, random, evaluate.one_case(flown, SHOWN_CASE - 1)


def fly_all(trained: Trained, fly: Fly, track: Track) -> tuple[Results, dict[str, Trace]]:
    """All results of the study, and the missions that its figure shows."""
    dogs = {name: seeds[trained.chosen.get(name, 0)] for name, seeds in trained.dogs.items()}
    flown = flights(dogs)
    measured, random, shown = {}, {}, {}
    for name, flight in track("Flying the scenarios", flown.items()):
        measured[name], random[name], shown[name] = fly_one(flight, fly)
    moved = transferred(trained, dogs, fly, track)
    robust = robustness.fly_all(dogs, fly, track)
    rows = {
        name: row(name, flight, measured, random)
        for name, flight in track("Counting", flown.items())
    }
    eight = {name: rows.pop(name) for name in paper.SCENARIOS}
    findings = [
        *claims.accomplished(
            {name: row["ours"] for name, row in eight.items()},
            {name: row["random"] for name, row in eight.items()},
        ),
        *claims.compared(measured),
        *claims.carried_over(moved),
        *claims.learnt(curves(trained, papers=True)),
        *claims.any_goal(robust["goals"]),
    ]
    results = {
        "rules": verdict.RULES,
        "rows": eight,
        "others": rows,
        "transfer": moved,
        "seeds": seeds_of(trained, fly, track),
        "robustness": robust,
        "claims": [vars(finding) for finding in findings],
    }
    return results, {name: shown[name] for name in SHOWN}


def row(name: str, flight: Flight, measured: Measured, random: Measured) -> Results:
    """All figures of a scenario: ours, on both sets of cases, and beside them the paper's."""
    ours = evaluate.figures(measured[name])
    figures = {"n": ours["cases"], "ours": ours, "random": evaluate.figures(random[name])}
    if flight.rule != name:
        figures["more_than_strombom"] = {
            metric: statistics.paired(measured[name][metric], measured[flight.rule][metric])
            for metric in ("steps", "steps_gcm", "distance")
        }
    figures["times_best"] = times_best(flight.world, measured[name], random[name])
    # A rule dog at the speed of the paper's own is held against it too.
    printed = paper.PRINTED.get(name.removesuffix(AT_PAPERS_SPEED))
    if printed is not None:
        held = verdict.verdicts(ours, printed)
        figures |= {"paper": printed, "verdict": verdict.verdict(held), "verdicts": held}
    return figures


def times_best(world: World, *measured: dict[str, np.ndarray]) -> Results:
    """Steps as times the best known, on the cases and on the random starts that have plans.

    Plans are of the paper's limit per axis: nothing is told of a world with another.
    """
    if not isinstance(world.dog.limits, PerAxis):
        return {}
    found = {}
    for starts, ours in zip(("paper", "random"), measured, strict=True):
        known = best.steps(starts, float(world.arena.size))
        if known is not None:
            found[starts] = best.times_best(ours["steps"][: len(known)], known)
    return found


def transferred(trained: Trained, dogs: dict[str, Sheepdog], fly: Fly, track: Track) -> Results:
    """The transfer study: rows of figures by arena, by how a sheepdog got there."""
    natives = {size: f"H-DDPG-{size:g}x{size:g}" for size in transfer.ARENAS}
    dog = dogs["H-DDPG-4x4"]
    sweep = partial(transfer.sweep, fly)
    lines = {
        reproduction.SCALED: lambda: sweep([dog], transfer.scaled, transfer.ARENAS),
        reproduction.UNSCALED: lambda: sweep([dog], transfer.unscaled, transfer.ARENAS),
        reproduction.NATIVE: lambda: {
            arena: row
            for size, name in natives.items()
            if name in dogs
            for arena, row in sweep([dogs[name]], transfer.scaled, [size]).items()
        },
    }
    for line, name in reproduction.ALL_SEEDS.items():
        if len(seeds := trained.dogs.get(name, [])) > 1:
            lines[line] = lambda seeds=seeds: sweep(seeds, transfer.scaled, transfer.ARENAS)
    return {line: flies() for line, flies in track("Flying in other arenas", lines.items())}


def seeds_of(trained: Trained, fly: Fly, track: Track) -> Results:
    """Every seed of each kind, at home on the 30 cases."""
    several = {
        name: dogs for name, dogs in trained.dogs.items() if len(dogs) > 1 or name in trained.chosen
    }
    found = {}
    for name, dogs in track("Flying every seed", several.items()):
        world = furthest_first(preset("paper", float(dogs[0].arena)))
        starts = shipped(world, "paper")
        rows = [evaluate.row(fly(world, dog, starts, MAX_STEPS, None)) for dog in dogs]
        found[name] = {"chosen": trained.chosen.get(name), "rows": rows}
    return found


def shown_skills(papers: bool) -> dict[str, str]:
    """The four models that the paper shows, in our lessons or in its own: panel and curve."""
    kind = "-paper-reward-one-scale-paper-frame" if papers else ""
    return {
        f"{skill} {size:g}x{size:g}": f"H-DDPG-{size:g}x{size:g}{kind} {skill}"
        for size in SIZES
        for skill in ("drive", "collect")
    }


def curves(trained: Trained, papers: bool) -> dict[str, list[Curve]]:
    """The learning curves of those models, by panel."""
    return {panel: trained.curves[name] for panel, name in shown_skills(papers).items()}
