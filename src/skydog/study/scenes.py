"""The study of scenes: who herds around obstacles, by the field and straight on."""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np

from skydog.study import cases as draws
from skydog.study import evaluate, statistics
from skydog.study.options import Results, Track
from skydog.world import scenes
from skydog.world.home import StraightHome
from skydog.world.mission import Fly, Shepherd
from skydog.world.options import SCENE_NAMES
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.state import State
from skydog.world.trace import Trace

NAMES = ("h-ddpg-4x4", "strombom", "arc")
"""Who flies."""

FLOCKS = {3: 200, 10: 100, 30: 40}
"""How many starts each flock has, by its sheep."""

STEPS = {3: 3_000, 10: 6_000, 30: 12_000}
"""The most steps of a mission, by the sheep of its flock: the arena grows with the flock."""

GATE, GATE_CASES = "gate", 200  # of the first of `NAMES`, for every flock
STRAIGHT_CASES = 20  # a dog that flies straight mostly fails, and then takes all its steps
COMPARED = "clutter"  # where a straight dog arrives too: both fly all starts
GROUNDED, GROUNDED_SHEEP, GROUNDED_CASES = ("gate", "u-trap"), 3, 50
SHOWN_SHEEP = 10  # of the missions in the figure
SEED = 0  # the rules of `AroundHome` were tried on seeds from 500 on


def fly_all(
    shepherds: dict[str, Shepherd], fly: Fly, track: Track
) -> tuple[Results, dict[str, Trace]]:
    """Fly shepherds, by name, in all scenes, with the way home around obstacles and without.

    The figures, and the first mission of the first shepherd in each scene.
    """
    results: Results = {"scenes": {}, "grounded": {}}
    for scene in track("In the five scenes", SCENE_NAMES):
        results["scenes"][scene] = {
            str(sheep): {
                name: _pair(fly, scene, sheep, name, dog) for name, dog in shepherds.items()
            }
            for sheep in FLOCKS
        }
    for scene in track("Dogs on the ground", GROUNDED):
        world = on_the_ground(preset(sheep=GROUNDED_SHEEP, scene=scene))
        starts = _starts(world, GROUNDED_SHEEP, GROUNDED_CASES)
        results["grounded"][scene] = {
            name: _figures(_measured(fly, world, dog, starts, GROUNDED_SHEEP))
            for name, dog in shepherds.items()
        }
    return results, first_missions(next(iter(shepherds.values())))


def on_the_ground(world: World) -> World:
    """The same world with dogs that cannot fly above its obstacles."""
    assert world.obstacles is not None
    return scenes.with_routes(replace(world, obstacles=replace(world.obstacles, tall=True)))


def first_missions(shepherd: Shepherd) -> dict[str, Trace]:
    """A mission in each scene, the sheep recorded at every step."""
    shown = {}
    for scene in SCENE_NAMES:
        world = preset(sheep=SHOWN_SHEEP, scene=scene)
        starts = _starts(world, SHOWN_SHEEP, 1)
        flown = evaluate.fly(world, shepherd, starts, STEPS[SHOWN_SHEEP])
        shown[scene] = evaluate.one_case(flown, 0)
    return shown


def _pair(fly: Fly, scene: str, sheep: int, name: str, dog: Shepherd) -> Results:
    """The figures of one shepherd in one scene: around obstacles, and straight from its starts."""
    world = preset(sheep=sheep, scene=scene)
    count = GATE_CASES if scene == GATE and name == NAMES[0] else FLOCKS[sheep]
    few = count if scene == COMPARED else min(STRAIGHT_CASES, count)
    starts = _starts(world, sheep, count)
    measure = partial(_measured, fly, dog=dog, sheep=sheep)
    around = measure(world, starts=starts)
    straight = measure(
        replace(world, home=StraightHome()), starts=jax.tree.map(lambda leaf: leaf[:few], starts)
    )
    row: Results = {"around": _figures(around), "straight": _figures(straight)}
    if scene == COMPARED:
        row["times straight"] = float(np.mean(around["steps"]) / np.mean(straight["steps"]))
        row["less than straight"] = statistics.paired(around["steps"], straight["steps"])
    return row


def _starts(world: World, sheep: int, count: int) -> State:
    return draws.cases(world, count, "random", SEED, sheep)


def _measured(
    fly: Fly, world: World, dog: Shepherd, starts: State, sheep: int
) -> dict[str, np.ndarray]:
    key = evaluate.noise_key(world, SEED)
    return evaluate.measure(fly(world, dog, starts, STEPS[sheep], key))


def _figures(measured: dict[str, np.ndarray]) -> dict[str, Any]:
    row = evaluate.figures(measured)
    return {name: row[name] for name in ("success", "success_ci95", "cases", "steps", "distance")}
