"""The third lesson, navigate: push a point home among obstacles that are seen, but not known."""

import math
from functools import cache
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.errors import Refusal
from skydog.learning import ddpg
from skydog.learning.lessons import Outcome
from skydog.shepherds import navigate
from skydog.world import field, obstacles
from skydog.world.obstacles import Obstacles
from skydog.world.vectors import norm

# Lengths are in sights: what is seen does not depend on the size of anything.
SCENES = 128  # that episodes draw from
SIDES = (2.0, 4.0)  # of their arenas: from half to once as long as in the named scenes, and more
GOAL_RADIUS = 0.5  # the paper's 2 m, for a sight of 4 m
WALLS = 16  # capsules of a scene, at most
THICK = (0.01, 0.05)  # radii of walls
DISCS = (0.05, 0.3)  # radii of discs
STARTS = 64  # places of a scene from which episodes start
NODES = 81  # of a scene's field
CLEARANCE = 0.05  # that the field's ways keep off obstacles: 0.2 R_ππ, as in the named scenes
DRIFTERS = 3  # discs that move, in half of the episodes
SWAY = 0.5  # how far they move to each side
PACE = 0.1  # radians of their oscillation a step: half as fast as a sheep, at most
STRIDE = 0.1  # that the point moves in a step: eight of a mission, for the paper's sheep
# Radians that the dog flies around the point in a step, a metre and more behind it.
TURN = 0.5
HORIZON = 150  # steps of an episode
STEP_COST = 0.01  # sights
CONFIG = ddpg.Config(actor=(64, 64), critic=(128, 128), discount=0.9)
"""The learner's numbers. It sees more than a dog does; the geodesic reward needs no foresight."""


class Scenes(eqx.Module):
    """Scenes of random walls and discs, stacked: obstacles, goal, starts, and the way home."""

    walls: Obstacles
    side: Float[Array, " scenes"]
    goal: Float[Array, "scenes 2"]
    starts: Float[Array, "scenes starts 2"]
    distance: Float[Array, "scenes nodes nodes"]
    cell: Float[Array, " scenes"]


class Episode(eqx.Module):
    """One way home. Sights and radians."""

    place: Float[Array, "2"]
    heading: Float[Array, ""]  # the angle along which the dog pushes the point
    scene: Int[Array, ""]
    drifts: Bool[Array, ""]  # whether there are discs that move
    middles: Float[Array, "drifters 2"]  # about which they do
    sways: Float[Array, "drifters 2"]
    step: Int[Array, ""]


class Navigation(eqx.Module):
    """The lesson: a point is pushed along the way that the skill commands, and slides along walls.

    An ideal dog stands behind it. For another direction the dog flies around the point at `TURN`,
    and the slower it pushes the further it has to turn. The reward is the metres gained on
    the geodesic distance home, less the time; only the reward knows the map. Discs that move are
    not in it. The episode ends at the goal.
    """

    scenes: Scenes

    observation: ClassVar[int] = len(navigate.SEES)
    action: ClassVar[int] = 2

    def start(self, key: PRNGKeyArray) -> Episode:
        """A random scene, start and heading; and in half of the episodes discs that move."""
        keys = jax.random.split(key, 6)
        scene = jax.random.randint(keys[0], (), 0, len(self.scenes.side))
        start = jax.random.randint(keys[1], (), 0, STARTS)
        angle = jax.random.uniform(keys[4], (DRIFTERS,), maxval=2.0 * math.pi)
        return Episode(
            place=self.scenes.starts[scene, start],
            heading=jax.random.uniform(keys[2], maxval=2.0 * math.pi),
            scene=scene,
            drifts=jax.random.bernoulli(keys[3]),
            middles=self.scenes.side[scene] * jax.random.uniform(keys[5], (DRIFTERS, 2)),
            sways=SWAY * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1),
            step=jnp.asarray(0),
        )

    def observe(self, episode: Episode) -> Float[Array, " seen"]:
        """What the skill sees: `navigate.SEES`."""
        return self._seen(episode)[0]

    def step(self, episode: Episode, action: Float[Array, "2"]) -> tuple[Episode, Outcome]:
        """Push the point a step along the direction that the action means."""
        _, axes = self._seen(episode)
        asked = navigate.direction(action, axes)
        off = jnp.arctan2(asked[1], asked[0]) - episode.heading
        off = jnp.arctan2(jnp.sin(off), jnp.cos(off))
        turn = jnp.clip(off, -TURN, TURN)
        heading = episode.heading + turn
        push = STRIDE * jnp.maximum(jnp.cos(off - turn), 0.0)
        walls, side = self._walls(episode), self.scenes.side[episode.scene]
        to = episode.place + push * jnp.stack([jnp.cos(heading), jnp.sin(heading)])
        to = obstacles.moved(walls, episode.place[None], to[None], 0.0, side)[0]
        moved = Episode(
            place=jnp.clip(to, 0.0, side),
            heading=heading,
            scene=episode.scene,
            drifts=episode.drifts,
            middles=episode.middles,
            sways=episode.sways,
            step=episode.step + 1,
        )
        gained = self.distance(episode) - self.distance(moved)
        home = norm(moved.place - self.scenes.goal[episode.scene]) <= GOAL_RADIUS
        late = moved.step >= HORIZON
        return moved, Outcome(gained - STEP_COST, home, late & ~home, home)

    def distance(self, episode: Episode) -> Float[Array, ""]:
        """How far it is home around what stands, in sights."""
        scenes, scene = self.scenes, episode.scene
        at = jnp.clip(episode.place / scenes.cell[scene], 0.0, NODES - 1.0)
        low = jnp.minimum(jnp.floor(at).astype(int), NODES - 2)
        (x, y), (i, k) = at - low, low
        four = jax.lax.dynamic_slice(scenes.distance, (scene, i, k), (1, 2, 2))[0]
        return jnp.stack([1.0 - x, x]) @ four @ jnp.stack([1.0 - y, y])

    def _seen(self, episode: Episode) -> tuple[Float[Array, " seen"], navigate.Axes]:
        side, goal = self.scenes.side[episode.scene], self.scenes.goal[episode.scene]
        heading = jnp.stack([jnp.cos(episode.heading), jnp.sin(episode.heading)])
        return navigate.observe(self._walls(episode), side, goal, 1.0, episode.place, heading)

    def _walls(self, episode: Episode) -> Obstacles:
        """What stands in the scene, and the discs that move as they are now."""
        walls = self.scenes.walls
        phase = PACE * episode.step + jnp.arange(DRIFTERS)
        at = episode.middles + jnp.sin(phase)[:, None] * episode.sways
        at = jnp.where(episode.drifts, at, -jnp.ones(2) * FAR)
        return Obstacles(
            ends=jnp.concatenate([walls.ends[episode.scene], jnp.stack([at, at], axis=1)]),
            radius=jnp.append(walls.radius[episode.scene], jnp.full(DRIFTERS, 0.5 * DISCS[1])),
        )


FAR = 100.0  # where capsules are that a scene does not have


@cache  # some seconds
def lesson() -> Navigation:
    """The lesson in `SCENES` scenes, always the same ones."""
    drawn = np.random.default_rng(0)
    kept: list[tuple[np.ndarray, ...]] = []
    while len(kept) < SCENES:
        found = _scene(drawn, len(kept) % 4)
        if found is not None:
            kept.append(found)
    ends, radius, *rest = (
        jnp.asarray(np.stack(part), jnp.float32) for part in zip(*kept, strict=True)
    )
    return Navigation(Scenes(Obstacles(ends, radius), *rest))


def _scene(drawn: np.random.Generator, kind: int) -> tuple[np.ndarray, ...] | None:
    """A scene of one of four kinds: gates, traps, walls, discs; None if hardly a way leads home."""
    side = drawn.uniform(*SIDES)
    ends = np.full((WALLS, 2, 2), -FAR)
    radius = np.zeros(WALLS)
    lines = [_gates, _traps, _loose, _discs][kind](drawn, side)
    ends[: len(lines)] = lines
    radius[: len(lines)] = drawn.uniform(*DISCS, len(lines)) if kind == 3 else drawn.uniform(*THICK)
    goal = drawn.uniform(0.0, side, 2)
    # In sides, so that what is compiled for one scene serves all.
    walls = Obstacles(
        jnp.asarray(ends / side, jnp.float32), jnp.asarray(radius / side, jnp.float32)
    )
    x, y = map(float, goal / side)
    try:
        way = field.solve(
            walls, (x, y), GOAL_RADIUS / side, (1.0, 1.0), NODES, CLEARANCE / side, 0.1
        )
    except Refusal:
        return None  # the goal is within an obstacle
    spots = drawn.uniform(0.0, 1.0, (50 * STARTS, 2))
    places = jnp.asarray(spots, jnp.float32)
    good = np.asarray(way.reaches(places)) & (np.asarray(_clearance(walls, places)) > 0.0)
    good &= np.linalg.norm(side * spots - goal, axis=1) > 1.5 * GOAL_RADIUS
    if np.sum(good) < STARTS:
        return None
    starts, distance = side * spots[good][:STARTS], side * np.asarray(way.distance)
    return ends, radius, np.asarray(side), goal, starts, distance, side * np.asarray(way.cell)


_clearance = eqx.filter_jit(obstacles.clearance)


def _gates(drawn: np.random.Generator, side: float) -> np.ndarray:
    """One to three walls across the arena, a gate in each."""
    lines = []
    count = drawn.integers(1, 4)
    for at in side * (np.arange(1, count + 1) / (count + 1) + drawn.uniform(-0.05, 0.05, count)):
        wide, middle = drawn.uniform(0.2, 0.6), side * drawn.uniform(0.0, 1.0)
        for low, high in ((0.0, middle - wide / 2), (middle + wide / 2, side)):
            if high > low:
                lines.append([(low, at), (high, at)])
    turned = np.asarray(lines)
    return turned[..., ::-1] if drawn.random() < 0.5 else turned


def _traps(drawn: np.random.Generator, side: float) -> np.ndarray:
    """One to three walls of three parts, like a U."""
    lines = []
    for _ in range(drawn.integers(1, 4)):
        wide, deep, angle = drawn.uniform(0.4, 1.5), drawn.uniform(0.2, 1.0), drawn.uniform(0, 7)
        corners = np.array([(-wide / 2, deep), (-wide / 2, 0), (wide / 2, 0), (wide / 2, deep)])
        turn = np.array([(np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))])
        line = drawn.uniform(0.2, 0.8, 2) * side + corners @ turn.T
        lines += [(line[part], line[part + 1]) for part in range(3)]
    return np.asarray(lines)


def _loose(drawn: np.random.Generator, side: float) -> np.ndarray:
    """Three to twelve straight walls anywhere."""
    count = drawn.integers(3, 13)
    first, angle = drawn.uniform(0.0, side, (count, 2)), drawn.uniform(0.0, 7.0, count)
    length = drawn.uniform(0.3, 1.5, count)[:, None]
    last = first + length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.stack([first, np.clip(last, 0.0, side)], axis=1)


def _discs(drawn: np.random.Generator, side: float) -> np.ndarray:
    """Four to sixteen discs anywhere."""
    middle = drawn.uniform(0.0, side, (drawn.integers(4, WALLS + 1), 2))
    return np.stack([middle, middle], axis=1)
