"""Scenes: arenas with obstacles and their way home, by name."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import jax.numpy as jnp
import numpy as np

from skydog.errors import Refusal, short
from skydog.world import field, routes
from skydog.world.home import AroundHome
from skydog.world.obstacles import Obstacles
from skydog.world.params import World

Point = tuple[float, float]
Wall = tuple[Point, Point, float]
"""Both ends of a wall, and its radius, half its thickness. Metres. A disc's ends are one place."""

ROOM = 6.0  # sides of a named scene in radii of the goal: 12 m for the paper's 2 m
DENSITY = 0.25  # share of the clutter's ground that its discs cover
DISCS = (0.02, 0.05)  # radii of the clutter's discs, in sides of the arena
CELLS = 8  # of the field across a passage
NODES = (101, 401)  # of the field along the longer side, least and most
# Metres that ways keep off obstacles, in avoidance radii: a fifth of a passage that is one wide.
CLEARANCE = 0.2
MARGIN = 0.2  # avoidance radii that dogs keep off corners that they go around
PASSABLE = 0.25  # share of the start, at least, that has a way home
AHEAD = 1.0  # avoidance radii that directions look ahead


@dataclass(frozen=True)
class Scene:
    """What stands in an arena, and where sheep start and go. Metres."""

    sides: tuple[float, float]
    walls: tuple[Wall, ...]
    start: tuple[float, float, float, float]  # least x and y, greatest x and y
    goal: Point = (0.0, 0.0)
    goal_radius: float | None = None  # None: that of the preset
    tall: bool = False  # whether dogs go around the obstacles too; else they fly above


def gate(side: float, passage: float) -> Scene:
    """A wall across the arena with one gate in its middle, as wide as a passage."""
    ends = 0.0, side / 2 - passage / 2, side / 2 + passage / 2, side
    thick = side / 100
    walls = (
        ((ends[0], side / 2), (ends[1] - thick, side / 2), thick),
        ((ends[2] + thick, side / 2), (ends[3], side / 2), thick),
    )
    return Scene((side, side), walls, _box(side, 0.05, 0.6, 0.95, 0.95))


def corridor(side: float, passage: float) -> Scene:
    """Two walls across the arena, and a corridor between them, two passages wide."""
    left, right = side / 2 - passage, side / 2 + passage
    thick = side / 100
    low, high = 0.3 * side, 0.6 * side
    lines = [
        [(0.0, high), (left - thick, high), (left - thick, low), (0.0, low)],
        [(side, high), (right + thick, high), (right + thick, low), (side, low)],
    ]
    walls = tuple(wall for line in lines for wall in _walls(line, thick))
    return Scene((side, side), walls, _box(side, 0.05, 0.7, 0.95, 0.95))


def u_trap(side: float, passage: float) -> Scene:
    """A wall like a U between the sheep and the goal, open on the side that is away from it."""
    del passage
    line = _shares(side, [(0.55, 0.8), (0.2, 0.5), (0.5, 0.2), (0.8, 0.55)])
    walls = _walls(line, side / 100)
    return Scene((side, side), walls, _box(side, 0.5, 0.5, 0.95, 0.95))


def maze(side: float, passage: float) -> Scene:
    """Ways of a quarter of the arena, with a turn at each end, and blind alleys."""
    del passage
    lines = [
        [(0.0, 0.75), (0.75, 0.75)],
        [(0.25, 0.5), (1.0, 0.5)],
        [(0.25, 0.5), (0.25, 0.6)],
        [(0.0, 0.25), (0.75, 0.25)],
        [(0.75, 0.25), (0.75, 0.4)],
        [(0.5, 0.75), (0.5, 0.65)],
        [(0.5, 0.25), (0.5, 0.1)],
    ]
    thick = side / 100
    walls = tuple(wall for line in lines for wall in _walls(_shares(side, line), thick))
    return Scene((side, side), walls, _box(side, 0.05, 0.8, 0.6, 0.95))


def clutter(side: float, passage: float) -> Scene:
    """Discs at random places that cover a quarter of the ground, at least a passage apart.

    Always the same ones; they keep off the goal and off the corner opposite, where sheep start.
    """
    draw = np.random.default_rng(0)
    goal, start = 0.25 * side, (0.7 * side, 0.7 * side)
    discs: list[tuple[float, float, float]] = []
    covered = 0.0
    for _ in range(100_000):
        radius = side * draw.uniform(*DISCS)
        x, y = draw.uniform(0.0, side, 2)
        apart = all(math.hypot(x - a, y - b) > radius + r + 0.5 * passage for a, b, r in discs)
        clear = math.hypot(x, y) > goal + radius and not (x > start[0] and y > start[1])
        if apart and clear:
            discs.append((x, y, radius))
            covered += math.pi * radius**2
        if covered >= DENSITY * (side**2 - math.pi / 4 * goal**2 - (side - start[0]) ** 2):
            break
    walls = tuple(((x, y), (x, y), radius) for x, y, radius in discs)
    return Scene((side, side), walls, _box(side, 0.7, 0.7, 0.95, 0.95))


SCENES: dict[str, Callable[[float, float], Scene]] = {
    "gate": gate,
    "corridor": corridor,
    "u-trap": u_trap,
    "maze": maze,
    "clutter": clutter,
}
"""Scenes by name: of the side of the arena, and how wide a passage for one sheep is, in metres."""


def named(name: str, side: float, passage: float) -> Scene:
    """A scene by its name. Raises `Refusal` for an unknown one."""
    if name not in SCENES:
        raise Refusal(f"no scene is called {short(name)}; choose from {', '.join(SCENES)}")
    return SCENES[name](side, passage)


def passage(world: World) -> float:
    """How wide a passage for one sheep is, in metres: R_ππ, or what stands for it in a law."""
    own = getattr(world.flock, "avoidance", None)
    return float(np.max(np.asarray(world.dog.collecting if own is None else own)))


def placed(world: World, scene: Scene) -> World:
    """The world in a scene's arena, among its obstacles; `with_home` gives it the way home."""
    radius = world.arena.goal_radius if scene.goal_radius is None else scene.goal_radius
    wide, high = scene.sides
    arena = replace(
        world.arena,
        size=wide,
        height=None if wide == high else high,
        goal_x=scene.goal[0],
        goal_y=scene.goal[1],
        goal_radius=radius,
    )
    walls = scene.walls
    obstacles = Obstacles(
        ends=jnp.asarray([[first, last] for first, last, _ in walls], jnp.float32).reshape(
            -1, 2, 2
        ),
        radius=jnp.asarray([radius for *_, radius in walls], jnp.float32),
        tall=scene.tall,
    )
    start = jnp.asarray(scene.start, jnp.float32)
    return with_routes(replace(world, arena=arena, obstacles=obstacles, start=start))


def with_routes(world: World) -> World:
    """The world with the ways of dogs around its obstacles, if these are tall."""
    walls, beyond = world.obstacles, float(world.dog.airspace)
    if walls is None or not walls.tall:
        return replace(world, routes=None)
    wide, high = world.arena.plain_sides
    most = wide + beyond, high + beyond
    return replace(world, routes=routes.solve(walls, MARGIN * passage(world), -beyond, most))


def with_home(world: World) -> World:
    """The world with the way home around its obstacles, to where its goal is now.

    A world without obstacles stays as it is. Raises `Refusal` for a goal within an obstacle, and
    for a start from which there is no way.
    """
    if world.obstacles is None:
        return world
    room, sides = passage(world), world.arena.plain_sides
    clearance = CLEARANCE * room
    nodes = min(max(math.ceil(CELLS * max(sides) / room) + 1, NODES[0]), NODES[1])
    goal = float(world.arena.goal_x), float(world.arena.goal_y)
    radius = float(world.arena.goal_radius)
    solved = field.solve(world.obstacles, goal, radius, sides, nodes, clearance, AHEAD * room)
    if world.start is not None and not _leads_home(solved, np.asarray(world.start, float)):
        raise Refusal(
            "there is no way home from where the sheep start; leave passages of "
            f"{2 * max(clearance, float(solved.cell)):.2g} m and more"
        )
    return replace(world, home=AroundHome(solved))


def renewed(world: World) -> World:
    """The world after its goal has moved: its way home, if it leads around obstacles, anew."""
    return with_home(world) if isinstance(world.home, AroundHome) else world


def check_open(world: World, what: str) -> World:
    """The world, for what has no place for obstacles: a square without any.

    `what` is the subject of the refusal. Raises `Refusal` for obstacles, for an arena that is no
    square, and for the way home around obstacles.
    """
    for odd, named in (
        (world.obstacles is not None, "obstacles"),
        (world.arena.height is not None, "arenas that are not square"),
        (isinstance(world.home, AroundHome), "a way home around obstacles"),
    ):
        if odd:
            raise Refusal(f"{what} has no {named}; take a world without a scene")
    return world


def _leads_home(solved: field.Field, start: np.ndarray) -> bool:
    """Whether there is a way from enough of the start for sheep to be drawn there."""
    spots = np.stack(np.meshgrid(*np.linspace(start[:2], start[2:], 20).T), axis=-1).reshape(-1, 2)
    return bool(np.mean(solved.reaches(jnp.asarray(spots, jnp.float32))) >= PASSABLE)


def _box(side: float, *shares: float) -> tuple[float, float, float, float]:
    left, low, right, high = (side * share for share in shares)
    return left, low, right, high


def _shares(side: float, line: list[Point]) -> list[Point]:
    return [(side * x, side * y) for x, y in line]


def _walls(line: list[Point], radius: float) -> tuple[Wall, ...]:
    return tuple((first, last, radius) for first, last in pairwise(line))
