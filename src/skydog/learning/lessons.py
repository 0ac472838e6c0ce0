"""The two lessons, collect and drive: start, observe, reward, end.

Paper, "A Hierarchical Framework of DDPGs".
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.learning import dynamics
from skydog.learning.options import Bodies, Reward, Skill
from skydog.shepherds import frame as frames
from skydog.shepherds import sheepdog
from skydog.shepherds.options import Frame
from skydog.world import herding, memory, mission, scenes
from skydog.world.params import World
from skydog.world.state import State, start
from skydog.world.vectors import norm

# A dog has arrived when it is as near as this to its subgoal, in metres. Not in the paper;
# its authors' laboratory code has 0.6 m in a paddock of 7 m, which is 0.34 m in one of 4 m.
ARRIVAL = 0.34
# A `progress` lesson goes on so many steps whatever happens: a dog that has arrived has yet
# to learn to hold a point that moves. The `paper` lesson lasts its 1000 steps at most.
HORIZON = {"progress": 50, "paper": mission.MAX_STEPS}
# Each episode draws its scale ξ: 0.5 is an arena twice as long, in which distances are multiplied
# by 0.5 before the dog sees them. What does not scale with an arena is the flock in it; a skill
# that has met it at one size only misses, through ξ, by centimetres that ξ then magnifies.
# Uniform in the logarithm; the ends bracket the arenas from 3 to 20 m, for 4 m.
SCALES = (0.1, 1.4)
# How far from the middle of the others a stray starts: at least so many f(N), and at most so
# many sides of the arena. Ours.
NEAREST_STRAY = 1.2
FURTHEST_STRAY = 1.0
# The dog starts within so many metres of the flock, on each axis, in arenas of any size: about
# as far as it flies in an episode.
REACH = 4.8
# The `progress` reward takes its dog to a point a little nearer to the sheep than the subgoal
# that it sees. If a dog stays a few centimetres behind its driving point, the sheep line up at a
# distance from which they just do not see it, and nothing ever moves again.
NEARER = 0.9
# What the `progress` reward adds to the metres gained on the subgoal: so much for each metre
# that the flock gained, less so much for each metre between dog and subgoal, as the dog sees
# them, after the step, and for each metre flown. The first is what makes a sheepdog faster
# than a rule that only holds its point, the last prevents it from trembling there.
FLOCK_SHARE = 4.0
DISTANCE_COST = 0.1
FLIGHT_COST = 0.5


@dataclass(frozen=True)
class Draws:
    """How starts are drawn. A flock starts gathered, about a centre."""

    # The distance of a sheep from the centre is f(N) times a uniform number to this power: 1/2
    # fills the disc evenly, and a smaller one its rim.
    power: float = 0.5
    # The share of the episodes whose goal, and whose sheep to collect, are anywhere in the arena.
    anywhere: float = 0.0


EVEN = Draws()
# What missions meet: flocks that have only just been gathered, strays against walls and in corners,
# subgoals beyond the airspace, and every goal. Ours.
AS_IN_MISSIONS = Draws(power=0.25, anywhere=0.25)


class Episode(eqx.Module):
    """One attempt at a lesson."""

    state: State
    goal: Float[Array, "2"]  # in sides of the arena
    scale: Float[Array, ""]  # ξ: the lesson's arena, as a share of the episode's
    step: Int[Array, ""]
    arrived: Bool[Array, ""]  # whether the dog has been where the reward takes it
    body: dynamics.Body | None = None  # how the bodies obey; None: as commanded


class Outcome(eqx.Module):
    """The result of a step. The end of the task and the end of the time are separate fields."""

    reward: Float[Array, ""]
    terminated: Bool[Array, ""]
    truncated: Bool[Array, ""]
    success: Bool[Array, ""]


class Lesson(eqx.Module):
    """A training task for one dog: fly to the collecting or to the driving point.

    `paper` is the paper's lesson: ±0.1 for getting nearer or not, ended by arrival. A dog can
    earn it for ever by never arriving. `progress`, the default, pays the metres gained on a
    point a little nearer than the subgoal, and by the flock, and goes on after arrival. Each
    episode draws its own scale ξ (see `SCALES`). The subgoal is the
    mission's own: kept within the airspace, behind whichever sheep is the stray at the time.
    What is seen and flown is in the axes of `frame`.
    """

    world: World
    skill: Skill = eqx.field(static=True)
    reward: Reward = eqx.field(static=True, default="progress")
    sheep: int = eqx.field(static=True, default=3)
    # Whether 1/ξ stretches what the dog commands; a step of fixed length it cannot (DHRL).
    stretches: bool = eqx.field(static=True, default=True)
    scales: tuple[float, float] = eqx.field(static=True, default=SCALES)
    frame: Frame = eqx.field(static=True, default="folded")
    draws: Draws = eqx.field(static=True, default=AS_IN_MISSIONS)
    bodies: Bodies = eqx.field(static=True, default="ideal")

    observation: ClassVar[int] = len(sheepdog.OBSERVES)
    action: ClassVar[int] = len(sheepdog.COMMANDS)

    def __check_init__(self):
        scenes.check_open(self.world, "a lesson")

    def start(self, key: PRNGKeyArray) -> Episode:
        """A gathered flock somewhere in the arena, and the dog somewhere about it.

        To collect, one sheep stands apart (paper, "Skill Decomposition Framework"): from
        `NEAREST_STRAY` to `FURTHEST_STRAY` from the middle of the others, or less where the wall
        is nearer.
        """
        keys = jax.random.split(key, 9)
        for_centre, for_angle, for_radius, for_stray, for_dog, for_scale, *for_anywhere = keys
        small, large = map(math.log, self.scales)
        scale = jnp.exp(jax.random.uniform(for_scale, minval=small, maxval=large))
        goal = self._goal(for_anywhere[0])
        world = self.world_at(scale, goal)
        size = world.arena.size
        radius = herding.gathered_radius(self.world, self.sheep)
        centre = size * jax.random.uniform(for_centre, (2,), minval=0.15, maxval=0.9)
        share = self._distance(jax.random.uniform(for_radius, (self.sheep,)))
        if self.skill == "collect":
            least, most = NEAREST_STRAY * radius, FURTHEST_STRAY * size
            apart = jax.random.uniform(for_stray, minval=least, maxval=most) / radius
            share = share.at[0].set(apart)
        angle = jax.random.uniform(for_angle, (self.sheep,), maxval=2 * jnp.pi)
        around = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
        sheep = jnp.clip(centre + radius * share[:, None] * around, 0.0, size)
        if self.skill == "collect" and self.draws.anywhere:
            anywhere = jax.random.uniform(for_anywhere[1]) < self.draws.anywhere
            drawn = size * jax.random.uniform(for_anywhere[2], (self.sheep, 2))
            sheep = jnp.where(anywhere, drawn, sheep)
        dog = herding.gcm(sheep) + jax.random.uniform(for_dog, (1, 2), minval=-REACH, maxval=REACH)
        return Episode(
            state=memory.begin(world, start(sheep, herding.within_airspace(world, dog))),
            goal=goal,
            scale=scale,
            step=jnp.asarray(0),
            arrived=jnp.asarray(False),
            body=None if self.bodies == "ideal" else dynamics.draw(jax.random.fold_in(key, 1)),
        )

    def observe(self, episode: Episode) -> Float[Array, "4"]:
        """What the dog sees, as a sheepdog does: `sheepdog.OBSERVES`, in metres times ξ."""
        seen = episode.scale * self._observed(episode)
        return frames.fold(seen)[0] if self.frame == "folded" else seen

    def step(self, episode: Episode, action: Float[Array, "2"]) -> tuple[Episode, Outcome]:
        """Fly one step; `action` is the velocity in shares of the speed limit, before 1/ξ."""
        before, world = episode.state, self.world_at(episode.scale, episode.goal)
        if self.frame == "folded":
            action = frames.unfold(action, frames.fold(self._observed(episode))[1])
        flown = sheepdog.stretched(action, episode.scale) if self.stretches else action
        velocity, body = world.dog.speed * flown, episode.body
        if body is not None:
            commanded = mission.limited(world.dog, velocity[None])[0]
            body, velocity = dynamics.obey(body, commanded, world.dog.speed, world.arena.dt)
            world = dynamics.slowed(world, body)
        after = mission.step(world, before, velocity[None])
        moved = Episode(after, episode.goal, episode.scale, episode.step + 1, episode.arrived, body)

        aim = 1.0 if self.reward == "paper" else NEARER
        was = norm(before.dogs - self.subgoal(episode, aim))[0]
        now = norm(after.dogs - self.subgoal(moved, aim))[0]
        arrived = now <= ARRIVAL
        if self.reward == "paper":
            reward = jnp.where(now <= was, 0.1, -0.1)
            terminated = arrived
        else:
            reward = (was - now) + FLOCK_SHARE * self._flock_gain(world, before, after)
            reward = reward - DISTANCE_COST * episode.scale * now
            reward = reward - FLIGHT_COST * norm(after.dogs - before.dogs)[0]
            terminated = jnp.asarray(False)
        moved = eqx.tree_at(lambda e: e.arrived, moved, episode.arrived | arrived)
        out_of_time = moved.step >= HORIZON[self.reward]
        return moved, Outcome(reward, terminated, out_of_time & ~terminated, moved.arrived)

    def _flock_gain(self, world: World, before: State, after: State) -> Float[Array, ""]:
        """Metres by which the centre came nearer to the goal, or the stray to the centre."""
        way = herding.way_home(world, before.sheep)
        if self.skill == "drive":
            return way.distance_home - herding.way_home(world, after.sheep).distance_home
        centre, stray = herding.gcm(before.sheep), jnp.argmax(way.stray_distance)
        return norm(before.sheep[stray] - centre) - norm(after.sheep[stray] - centre)

    def subgoal(self, episode: Episode, aim: float = 1.0) -> Float[Array, "1 2"]:
        """The point to fly to, in metres; `aim` shortens how far it lies behind the sheep."""
        state = episode.state
        world = eqx.tree_at(
            lambda w: (w.dog.driving, w.dog.collecting),
            self.world_at(episode.scale, episode.goal),
            replace_fn=lambda offset: offset * aim,
        )
        if self.skill == "drive":
            point = herding.driving_points(world, state.sheep, state.dogs)
        else:
            point, _ = herding.collecting_points(world, state.sheep, state.dogs)
        return herding.within_airspace(world, point)

    def world_at(self, scale: Float[Array, ""], goal: Float[Array, "2"]) -> World:
        """The world of an episode at a scale: its arena is 1/ξ times as long.

        `goal` is in sides of the arena. The stray is the furthest, whatever the world's gate: a
        dog that could change the stray by its flight would be paid for a subgoal that jumps nearer.
        """
        size = self.world.arena.size / scale
        return eqx.tree_at(
            lambda w: (w.arena.size, w.arena.goal_x, w.arena.goal_y, w.dog.nearness),
            self.world,
            (size, size * goal[0], size * goal[1], 0.0),
        )

    def _goal(self, key: PRNGKeyArray) -> Float[Array, "2"]:
        """The goal of an episode, in sides of the arena: the world's own, or anywhere."""
        own = herding.goal(self.world.arena) / self.world.arena.size
        whether, x, y = jax.random.uniform(key, (3,))
        return jnp.where(whether < self.draws.anywhere, jnp.stack([x, y]), own)

    def _distance(self, drawn: Float[Array, " sheep"]) -> Float[Array, " sheep"]:
        """How far sheep of a gathered flock start from its centre, in f(N)."""
        return jnp.sqrt(drawn) if self.draws.power == 0.5 else drawn**self.draws.power

    def _observed(self, episode: Episode) -> Float[Array, "4"]:
        """What the dog sees in metres, in the world's axes."""
        state = mission.perceive(self.world, episode.state)
        subgoal = self.subgoal(replace(episode, state=state))
        return sheepdog.observe(state.sheep, state.dogs, subgoal)[0]
