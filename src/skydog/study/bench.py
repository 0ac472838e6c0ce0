"""The benchmark: a fixed list of tasks for any shepherd, and its cases as one file.

A task is a world, starts in it and the most steps of a mission. Tasks of one version never change.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from skydog import arrays
from skydog.errors import Refusal, short
from skydog.shepherds import named
from skydog.study import cases as draws
from skydog.study import evaluate, herds, mixed, patterns, robustness
from skydog.study.options import Results
from skydog.world.mission import Fly, Shepherd
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State, start

VERSION = 1
KIND = "benchmark"
FILE = Path(__file__).parent / "data" / f"bench-{VERSION}.safetensors"
SHA256 = "114c81ab6f57d96fc9968a9f6c31eecdc6346f7926777fded0570b104fd15bd6"
"""Of the file of cases: whoever flies others does not fly this version."""

SEED = 1_000  # of the starts and of the noise; nothing was tuned on it
DRONE = "crazyflie"  # of the twin
FLYABLE = 1_013  # the first seed from `SEED` on whose starts the twin can fly


@dataclass(frozen=True)
class Task:
    """A world, how its starts were drawn, and the most steps of a mission."""

    says: str
    world: Callable[[], World]
    draw: Callable[[World], State]
    steps: int
    in_twin: bool = False


def _shipped(arena: float) -> Task:
    return Task(
        f"the paper's 30 cases in {arena:g} m",
        partial(preset, "paper", arena),
        partial(draws.shipped, name="paper"),
        1_000,
    )


def _goal(says: str, x: float, y: float, radius: float | None = None) -> Task:
    return Task(
        f"a goal {says}, 6 m",
        partial(preset, "paper", 6.0, goal=(x, y), goal_radius=radius),
        partial(draws.cases, count=30, starts="random", seed=SEED),
        1_000,
    )


def _flock(name: str, side: float | None, sheep: int, count: int, steps: int) -> Task:
    return Task(
        f"{sheep} sheep in {name}",
        partial(preset, name, side, sheep),
        partial(draws.cases, count=count, starts="random", seed=SEED, sheep=sheep),
        steps,
    )


def _pattern(name: str) -> Task:
    return Task(
        f"El-Fiqi's pattern {name}, 100 sheep",
        partial(preset, "elfiqi2020", sheep=100),
        partial(patterns.cases, pattern=name, count=10, seed=SEED),
        2_000,
    )


def _scene(name: str, sheep: int, steps: int) -> Task:
    return Task(
        f"the scene {name}, {sheep} sheep",
        partial(preset, sheep=sheep, scene=name),
        partial(draws.cases, count=30, starts="random", seed=SEED, sheep=sheep),
        steps,
    )


def _mix(says: str, **shares: float) -> Task:
    return Task(
        f"{mixed.SHEEP} sheep of {mixed.PRESET}, {says}",
        partial(preset, mixed.PRESET, sheep=mixed.SHEEP, mix=shares),
        partial(draws.cases, count=30, starts="random", seed=SEED, sheep=mixed.SHEEP),
        3_000,
    )


def _scattered(sheep: int, dogs: int) -> Task:
    return Task(
        f"{sheep} targets that diffuse, {dogs} dogs",
        partial(preset, "lama2024", sheep=sheep),
        partial(herds.starts, runs=10, seed=SEED, sheep=sheep, dogs=dogs),
        10_000,
    )


TASKS = {
    "paper-4m": _shipped(4.0),
    "paper-6m": _shipped(6.0),
    "goal-corner": _goal("in another corner", 6.0, 6.0),
    "goal-edge": _goal("at an edge", 6.0, 3.0),
    "goal-centre": _goal("in the centre", 3.0, 3.0, robustness.CENTRE_RADIUS),
    **{
        f"paper-{sheep}": _flock("paper", robustness.side_for(sheep), sheep, count, steps)
        for sheep, count, steps in ((10, 30, 1_500), (30, 20, 3_000), (100, 10, 5_000))
    },
    **{
        f"strombom-{sheep}": _flock("strombom2014", None, sheep, count, steps)
        for sheep, count, steps in ((3, 30, 1_500), (30, 20, 1_500), (100, 10, 1_500))
    },
    **{
        f"{name}-1000": _flock(world, side, 1_000, 4, 3_000)
        for name, world, side in (
            ("paper", "paper", robustness.side_for(1_000)),
            ("strombom", "strombom2014-sqrt", 300.0),
        )
    },
    **{name.lower(): _pattern(name) for name in patterns.PATTERNS},
    "gate": _scene("gate", 3, 1_500),
    "gate-10": _scene("gate", 10, 3_000),
    "maze": _scene("maze", 3, 3_000),
    "loners": _mix("a fifth do not group", loner=0.2),
    "mixed": _mix(
        "a tenth each of four other kinds",
        **dict.fromkeys(("stubborn", "short-sighted", "loner", "noisy"), 0.1),
    ),
    "two-dogs": Task(
        "30 sheep of strombom2014, 2 dogs",
        partial(preset, "strombom2014", sheep=30),
        partial(draws.cases, count=20, starts="random", seed=SEED, sheep=30, dogs=2),
        1_500,
    ),
    "diffusive-25": _scattered(25, 3),
    "diffusive-100": _scattered(100, 6),
    "twin": Task(
        f"a {DRONE} and three rovers with physics",
        partial(preset, "paper-physical"),
        partial(draws.cases, count=10, starts="random", seed=FLYABLE),
        600,
        in_twin=True,
    ),
}


def save(path: Path = FILE) -> None:
    """Draw the cases of every task anew, and write them as one file."""
    found = {}
    for name, task in TASKS.items():
        drawn = task.draw(task.world())
        found |= {f"{name}/sheep": np.asarray(drawn.sheep), f"{name}/dogs": np.asarray(drawn.dogs)}
    arrays.save_arrays(path, found, {"kind": KIND, "version": VERSION, "units": "metres"})


@cache
def _cases() -> dict[str, np.ndarray]:
    found = hashlib.sha256(FILE.read_bytes()).hexdigest()
    if found != SHA256:
        raise Refusal(f"{FILE} is damaged: its SHA-256 is {found[:12]}…; install skydog again")
    return arrays.load_arrays(FILE, KIND)[0]


def check() -> None:
    """Raise `Refusal` if the file of cases is not that of this version."""
    _cases()


def cases(name: str) -> State:
    """The starts of a task, stacked along a first axis. Raises `Refusal` for a damaged file."""
    sheep, dogs = (jnp.asarray(_cases()[f"{name}/{who}"]) for who in ("sheep", "dogs"))
    return jax.vmap(start)(sheep, dogs)


def digest(name: str) -> str:
    """The SHA-256 of a task's starts: rows that have the same one can be compared."""
    whole = b"".join(_cases()[f"{name}/{who}"].tobytes() for who in ("sheep", "dogs"))
    return hashlib.sha256(name.encode() + whole).hexdigest()


def chosen(names: list[str] | None) -> list[str]:
    """Tasks by name, all if None. Raises `Refusal` for one that there is not."""
    for name in names or ():
        if name not in TASKS:
            raise Refusal(f"no task is called {short(name)}; choose from {', '.join(TASKS)}")
    return list(TASKS) if names is None else names


def fly(called: str, shepherd: Shepherd, name: str, twin: Fly) -> Results:
    """Fly a task: the figures of its row, and what came of each case. `twin` flies in the twin.

    A shepherd that refuses the task or fails in it, such as a policy for another flock, has the
    reason instead. `called` is what it is named.
    """
    task, starts = TASKS[name], cases(name)
    world = task.world()
    key = jax.random.key(SEED) if task.in_twin else evaluate.noise_key(world, SEED)
    fly = twin if task.in_twin else partial(evaluate.fly, every=None)
    try:
        named.trial(called, shepherd, world, starts)
        flown = fly(world, shepherd, starts, task.steps, key)
    except Refusal as refusal:
        return {"refused": str(refusal), "cases of": digest(name)}
    measured = evaluate.measure(flown)
    row = evaluate.figures(measured)
    return {
        **{figure: row[figure] for figure in ("success", "success_ci95", "cases", "steps")},
        "each": {
            "success": [bool(each) for each in measured["success"]],
            "steps": [float(each) for each in measured["steps"]],
        },
        "cases of": digest(name),
    }
