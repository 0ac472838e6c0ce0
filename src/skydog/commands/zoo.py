"""The sheepdogs of the study: what is trained, which seed flies, and which ship as the zoo."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from skydog import files
from skydog.commands import training
from skydog.learning.curriculum import Curriculum
from skydog.learning.history import Curve
from skydog.learning.lessons import HORIZON
from skydog.learning.workers import Job
from skydog.shepherds import store
from skydog.shepherds.options import Frame
from skydog.shepherds.sheepdog import Sheepdog
from skydog.study import evaluate, transfer
from skydog.study.cases import cases
from skydog.study.options import PAPER_FRAME, Results, Starts
from skydog.study.scenarios import SIZES, Trained, row_of, shown_skills
from skydog.world.mission import MAX_STEPS, Fly
from skydog.world.presets import furthest_first, preset

# The kinds of which several seeds are trained, and the arenas where one of them is chosen.
CHOSEN_IN = {
    name + suffix: arenas
    for suffix in ("", PAPER_FRAME)
    for name, arenas in (
        ("H-DDPG-4x4", transfer.ARENAS),
        ("H-DDPG-6x6", (6.0,)),
        ("DHRL-4x4", (4.0, 6.0)),
        ("DHRL-6x6", (6.0,)),
    )
}
CHOSEN_BY = 200  # cases of either sort
CHOSEN_SEED = 2  # the study's own have 0 and 1
CURVES = "learning_curves.csv"


@dataclass(frozen=True)
class Plan:
    """What is trained: so many sheepdogs of each kind, for so many episodes per skill."""

    seeds: int = 8
    episodes: int = 3_000  # as in the paper

    def curriculum(self, arena: float, **options: Any) -> Curriculum:
        """What the sheepdogs of one kind are taught."""
        steps = self.episodes * HORIZON["progress"]
        return Curriculum(arena=arena, steps=steps, **options)

    def curricula(self) -> list[Curriculum]:
        """What sheepdogs of several seeds are taught.

        The shipped kinds, in both frames; one with lessons at one scale; and the paper's lessons.

        The episodes of the paper's reward may last 1000 steps; they end with the others' steps.
        """
        kinds = [
            self.curriculum(size, learner=how, frame=frame)
            for frame in get_args(Frame)
            for size in SIZES
            for how in ("ddpg", "dqn")
        ]
        narrow = partial(self.curriculum, one_scale=True, frame="paper")
        papers = [narrow(size, reward="paper", episodes=self.episodes) for size in SIZES]
        return [*kinds, narrow(4.0), *papers]

    def jobs(self, out: Path) -> list[Job]:
        """Every training of the study; of the natives of other arenas, one seed."""
        pairs = [(kind, seed) for kind in self.curricula() for seed in range(self.seeds)]
        pairs += [(self.curriculum(size), 0) for size in transfer.ARENAS if size not in SIZES]
        return [
            job
            for kind, seed in pairs
            for job in training.jobs(
                kind, out / "trainings" / kind.dog / f"seed-{seed}", seed, resume=True
            )
        ]


def fuse(plan: Plan, out: Path, fly: Fly) -> Trained:
    """The sheepdogs of all trainings, and the learning curves."""
    dogs: dict[str, list[Sheepdog]] = {}
    curves: dict[str, list[Curve]] = {}
    for job in plan.jobs(out):
        if job.skill == "drive":  # both skills of a sheepdog are fused at once
            continue
        dog, histories = training.fuse(job.curriculum, job.folder.parent, job.seed)
        dogs.setdefault(job.curriculum.dog, []).append(dog)
        for skill, history in histories.items():
            curves.setdefault(f"{job.curriculum.dog} {skill}", []).append(history.curve())
    chosen = {kind: best(dogs[kind], arenas, fly) for kind, arenas in CHOSEN_IN.items()}
    return Trained(dogs, curves, chosen)


def best(dogs: list[Sheepdog], arenas: tuple[float, ...], fly: Fly) -> int:
    """Which of several seeds flies for its kind, and ships.

    The one that needs the fewest steps, a mission that fails counting with all of its 1000, for
    `CHOSEN_BY` cases drawn as the study's 30 are and for as many random starts, in each of the
    arenas. They are other draws: the study's own cases have no say.
    """

    def steps(dog: Sheepdog) -> float:
        return sum(
            float(evaluate.measure(fly(world, dog, starts, MAX_STEPS, None))["steps"].sum())
            for world, starts in places
        )

    sorts: tuple[Starts, ...] = ("paper", "random")
    worlds = [furthest_first(preset("paper", arena)) for arena in arenas]
    places = [
        (world, cases(world, CHOSEN_BY, sort, CHOSEN_SEED)) for world in worlds for sort in sorts
    ]
    return int(np.argmin([steps(dog) for dog in dogs]))


def read() -> Trained:
    """The sheepdogs that ship, and the learning curves of the study that made them."""
    dogs, chosen = {}, {}
    for name in store.ships():
        dog, card = store.read(name)
        if card["name"] not in CHOSEN_IN:  # of the physical study
            continue
        dogs[card["name"]] = [dog]
        chosen[card["name"]] = 0
    return Trained(dogs, _read_curves(store.ZOO / CURVES), chosen)


def write(folder: Path, plan: Plan, trained: Trained, rows: Results) -> None:
    """Write the chosen sheepdogs and all learning curves, as they ship."""
    made = f"skydog reproduce --seeds {plan.seeds} --episodes {plan.episodes}"
    for kind in plan.curricula():
        if kind.dog in trained.chosen:
            seed = trained.chosen[kind.dog]
            card = training.card(kind, seed, made, {kind.dog: rows[row_of(kind.dog)]["ours"]})
            path = folder / f"{kind.dog.lower()}.safetensors"
            store.save(path, trained.dogs[kind.dog][seed], card)
    shown = {
        name: trained.curves[name]
        for papers in (False, True)
        for name in shown_skills(papers).values()
    }
    files.write_text(folder / CURVES, _curves_as_csv(shown))


def _curves_as_csv(curves: dict[str, list[Curve]]) -> str:
    """A row every 10 episodes, a column per seed of a skill."""
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
