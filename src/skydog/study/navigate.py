"""With a map, with eyes or with neither: the field, the skill navigate and the straight way."""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from skydog import numerics
from skydog.shepherds import store
from skydog.shepherds.sheepdog import Sheepdog
from skydog.study import cases, statistics
from skydog.study.options import Results, Track
from skydog.world import mission, params, scenes
from skydog.world.home import StraightHome
from skydog.world.obstacles import Obstacles
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.scenes import SCENES, Scene
from skydog.world.state import State
from skydog.world.vectors import Scalar

SHEPHERD = "h-ddpg-4x4-navigate"  # its skills collect and drive are those of h-ddpg-4x4
WAYS = ("field", "navigate", "straight")
"""How the way home is found: on a map, by what is in sight, or as if there were no obstacles."""

SHEEP = 3
CASES = 40
SEED = 0
STEPS = 2_000
FULL_TURN = 2.0 * math.pi


class Sway(eqx.Module):
    """How obstacles move to and fro, each about the place where it stands at first."""

    reach: Float[Array, "obstacles 2"]  # metres
    period: Scalar  # seconds

    def at(self, world: World, now: Int[Array, ""]) -> World:
        """The world as it stands at an instant."""
        assert world.obstacles is not None
        share = jnp.sin(FULL_TURN * now * world.arena.dt / self.period)
        ends = world.obstacles.ends + share * self.reach[:, None]
        return replace(world, obstacles=replace(world.obstacles, ends=ends))


@numerics.ours()
def fly(
    world: World, sway: Sway | None, shepherd: Sheepdog, starts: State, steps: int
) -> tuple[Bool[np.ndarray, " cases"], Int[np.ndarray, " cases"]]:
    """Fly missions among obstacles that may move: who succeeded, and in how many steps.

    A mission that fails counts with all its steps.
    """
    traced = params.traced((world, sway, shepherd))
    failed = np.asarray(_fly(*traced, starts, steps))
    return failed < steps + 1, np.minimum(failed, steps)


@eqx.filter_jit
def _fly(
    world: World, sway: Sway | None, shepherd: Sheepdog, starts: State, steps: int
) -> Int[Array, " cases"]:
    """How many instants, of all `steps + 1`, went by before the mission was accomplished."""

    def on(carry: tuple[State, Array, Array], now: Int[Array, ""]):
        state, done, count = carry
        here = world if sway is None else sway.at(world, now)
        (state, done), _ = mission.instant(here, shepherd, steps, None)((state, done), now)
        return (state, done, count + ~done), None

    def one(state: State) -> Int[Array, ""]:
        begun = state, jnp.asarray(False), jnp.asarray(0)
        return jax.lax.scan(on, begun, jnp.arange(steps + 1))[0][2]

    return jax.vmap(one)(starts)


def ways(world: World, map_of: World) -> dict[str, tuple[World, bool]]:
    """The world with each of the `WAYS`, and whether the third skill flies there.

    The map is that of another world, which may be as old or as wrong as one likes.
    """
    blind = replace(world, home=StraightHome())
    return {
        "field": (replace(world, home=map_of.home), False),
        "navigate": (blind, True),
        "straight": (blind, False),
    }


def in_scene(scene: Scene, sheep: int) -> World:
    """The paper's world in a scene, and its map."""
    return scenes.with_home(scenes.placed(preset("paper", scene.sides[0], sheep), scene))


def _named(name: str, sheep: int) -> World:
    return preset("paper", sheep=sheep, scene=name)


def _unmapped(world: World) -> World:
    """The same arena with nothing in it, as a map."""
    assert world.obstacles is not None
    nothing = Obstacles(jnp.full((1, 2, 2), -1e3), jnp.zeros(1))
    return scenes.with_home(replace(world, obstacles=nothing))


def _shifted_gate(sheep: int) -> World:
    """The scene `gate` with its gate a quarter of the side further left."""
    side = float(preset("paper", sheep=sheep, scene="gate").arena.size)
    room = scenes.gate(side, scenes.passage(preset("paper", sheep=sheep)))
    (left, gate, thick), (other, right, _) = room.walls
    moved = -0.25 * side
    walls = (
        (left, (gate[0] + moved, gate[1]), thick),
        ((other[0] + moved, other[1]), right, thick),
    )
    return in_scene(replace(room, walls=walls), sheep)


def _crossing(sheep: int) -> World:
    """Six discs in two rows across the way, 1 m in radius."""
    side = float(preset("paper", sheep=sheep, scene="gate").arena.size)
    spots = [(side * x, side * y) for y in (0.42, 0.6) for x in (0.2, 0.5, 0.8)]
    discs = tuple((spot, spot, side / 12) for spot in spots)
    return in_scene(Scene((side, side), discs, _box(side)), sheep)


def _box(side: float) -> tuple[float, float, float, float]:
    return 0.6 * side, 0.7 * side, 0.95 * side, 0.95 * side


def wrong_maps(sheep: int) -> dict[str, tuple[World, World]]:
    """Worlds by name, each with the world that its map is of."""
    rows = {"gate, 3 m from where the map has it": (_shifted_gate(sheep), _named("gate", sheep))}
    for name in ("gate", "u-trap", "clutter"):
        world = _named(name, sheep)
        rows[f"{name}, not on the map"] = world, _unmapped(world)
    return rows


def moving(sheep: int) -> dict[str, tuple[World, Sway]]:
    """Worlds by name, and how their obstacles move; the map is of where they stand at first."""
    gate, clutter, crossing = _named("gate", sheep), _named("clutter", sheep), _crossing(sheep)
    side = float(gate.arena.size)
    return {
        "gate that slides": (_endless(gate), _all_along(gate, (side / 4, 0.0), 60.0)),
        "discs that cross": (crossing, _in_turns(crossing, side / 6, 40.0)),
        "clutter that sways": (clutter, _in_turns(clutter, side / 24, 20.0)),
    }


def _endless(world: World) -> World:
    """The gate's walls lengthened beyond the arena, so that they may slide; with the old map."""
    assert world.obstacles is not None
    ends, side = world.obstacles.ends, world.arena.size
    ends = ends.at[0, 0, 0].add(-side).at[1, 1, 0].add(side)
    return replace(world, obstacles=replace(world.obstacles, ends=ends))


def _all_along(world: World, reach: tuple[float, float], period: float) -> Sway:
    assert world.obstacles is not None
    return Sway(jnp.broadcast_to(jnp.asarray(reach), (len(world.obstacles.radius), 2)), period)


def _in_turns(world: World, reach: float, period: float) -> Sway:
    """Neighbours move along x against each other."""
    assert world.obstacles is not None
    sign = 1.0 - 2.0 * (jnp.arange(len(world.obstacles.radius)) % 2)
    return Sway(reach * sign[:, None] * jnp.asarray([1.0, 0.0]), period)


def fly_all(track: Track, shepherd: str = SHEPHERD) -> Results:
    """Fly all ways in all worlds, from the same starts: success, and steps."""
    both = store.load(shepherd)
    known = {name: _named(name, SHEEP) for name in SCENES}
    missions: list[tuple[str, str, World, World, Sway | None]] = [
        *(("known", name, world, world, None) for name, world in known.items()),
        *(("wrong", name, *worlds, None) for name, worlds in wrong_maps(SHEEP).items()),
        *(("moving", name, world, world, sway) for name, (world, sway) in moving(SHEEP).items()),
    ]
    results: Results = {part: {} for part in ("known", "wrong", "moving")}
    for part, name, world, map_of, sway in track("With a map, eyes or neither", missions):
        starts = cases.cases(world, CASES, "random", SEED, SHEEP)
        flown = {
            way: fly(here, sway, both if sees else replace(both, navigate=None), starts, STEPS)
            for way, (here, sees) in ways(world, map_of).items()
        }
        results[part][name] = _rows(flown)
    return results


def _rows(flown: dict[str, tuple[np.ndarray, np.ndarray]]) -> Results:
    rows: Results = {}
    for way, (success, steps) in flown.items():
        share, interval = statistics.share(int(success.sum()), len(success))
        rows[way] = {
            "success": share,
            "success_ci95": interval,
            "steps": statistics.summary(steps.astype(float)),
            "against the field": statistics.mcnemar(success, flown["field"][0])._asdict(),
        }
    return rows
