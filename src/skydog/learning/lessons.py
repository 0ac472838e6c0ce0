"""The two lessons, collect and drive: start, observe, reward, end (paper, Section 3.2)."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.shepherds import sheepdog
from skydog.words import Reward, Skill
from skydog.world import herding, mission
from skydog.world.mission import State
from skydog.world.params import World
from skydog.world.vectors import norm

# A dog has arrived when it is as near as this to its subgoal, in metres. Not in the paper;
# its authors' laboratory code has 0.6 m in a paddock of 7 m, which is 0.34 m in one of 4 m.
ARRIVAL = 0.34
# A `progress` lesson goes on so many steps whatever happens: a dog that has arrived has yet
# to learn to hold a point that moves. The `paper` lesson lasts its 1000 steps at most.
HORIZON = {"progress": 200, "paper": mission.MAX_STEPS}
# Each episode draws where its subgoals lie, in shares of the world's own offset. A skill
# taught at one offset fails under ξ scaling, which shrinks distances and not offsets; one
# whose draws end at the mission's own offset, 1, is not at its best there.
OFFSETS = (0.3, 1.2)
# The `progress` reward takes its dog to a point a little nearer to the sheep than the subgoal
# that it sees. A dog that holds its driving point but for a few centimetres loses touch: the
# sheep line up across its way, each just out of sight of it, and nobody ever moves again.
NEARER = 0.9
# What the `progress` reward adds to the metres gained on the subgoal: so much for each metre
# that the flock gained, less so much for each metre between dog and subgoal after the step.
# The first is what makes a sheepdog faster than a rule that merely stands on its point.
FLOCK_SHARE = 4.0
DISTANCE_COST = 0.1


class Episode(eqx.Module):
    """One attempt at a lesson."""

    state: State
    offset: Float[Array, ""]  # where this episode's subgoals lie, in shares of the world's
    step: Int[Array, ""]
    arrived: Bool[Array, ""]  # whether the dog has been where the reward takes it


class Outcome(eqx.Module):
    """What a step brought. The end of the task and the end of the time are told apart."""

    reward: Float[Array, ""]
    terminated: Bool[Array, ""]
    truncated: Bool[Array, ""]
    success: Bool[Array, ""]


class Lesson(eqx.Module):
    """A training task for one dog: fly to the collecting or to the driving point.

    `paper` is the paper's lesson: ±0.1 for getting nearer or not, ended by arrival. It can
    be gamed by never arriving. `progress`, the default, pays the metres gained on a
    point a little nearer than the subgoal, and by the flock, and goes on after arrival. The
    subgoal is the mission's own: kept within the airspace, behind whichever sheep is the stray
    at the time.
    """

    world: World
    skill: Skill = eqx.field(static=True)
    reward: Reward = eqx.field(static=True, default="progress")
    sheep: int = eqx.field(static=True, default=3)

    observation: ClassVar[int] = len(sheepdog.OBSERVES)
    action: ClassVar[int] = len(sheepdog.COMMANDS)

    def start(self, key: PRNGKeyArray) -> Episode:
        """A gathered flock somewhere in the arena, and the dog somewhere in the airspace.

        To collect, one sheep stands apart (paper, "Skill Decomposition Framework"): 1.2 to 3.2
        f(N) from the middle of the others, or less where the wall is nearer. The distances are
        ours.
        """
        for_centre, for_angle, for_radius, for_stray, for_dog, for_offset = jax.random.split(key, 6)
        size = self.world.arena.size
        radius = herding.gathered_radius(self.world.flock, self.sheep)
        centre = size * jax.random.uniform(for_centre, (2,), minval=0.15, maxval=0.9)
        share = jnp.sqrt(jax.random.uniform(for_radius, (self.sheep,)))
        if self.skill == "collect":
            apart = jax.random.uniform(for_stray, minval=1.2, maxval=3.2)
            share = share.at[0].set(apart)
        angle = jax.random.uniform(for_angle, (self.sheep,), maxval=2 * jnp.pi)
        around = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
        sheep = jnp.clip(centre + radius * share[:, None] * around, 0.0, size)
        dog = size * jax.random.uniform(for_dog, (1, 2), minval=-0.1, maxval=1.1)
        return Episode(
            state=mission.start(sheep, herding.within_airspace(self.world, dog)),
            offset=jax.random.uniform(for_offset, minval=OFFSETS[0], maxval=OFFSETS[1]),
            step=jnp.asarray(0),
            arrived=jnp.asarray(False),
        )

    def observe(self, episode: Episode) -> Float[Array, "4"]:
        """What the dog sees, as a sheepdog does: `sheepdog.OBSERVES`, in metres."""
        state = episode.state
        return sheepdog.observe(state.sheep, state.dogs, self._subgoal(episode))[0]

    def step(self, episode: Episode, action: Float[Array, "2"]) -> tuple[Episode, Outcome]:
        """Fly one step; `action` is the velocity in shares of the speed limit."""
        before = episode.state
        velocity = self.world.dog.speed * action[None]
        after = mission.step(self.world, before, velocity)
        moved = Episode(after, episode.offset, episode.step + 1, episode.arrived)

        aim = 1.0 if self.reward == "paper" else NEARER
        was = norm(before.dogs - self._subgoal(episode, aim))[0]
        now = norm(after.dogs - self._subgoal(moved, aim))[0]
        arrived = now <= ARRIVAL
        if self.reward == "paper":
            reward = jnp.where(now <= was, 0.1, -0.1)
            terminated = arrived
        else:
            reward = (was - now) + FLOCK_SHARE * self._flock_gain(before, after)
            reward = reward - DISTANCE_COST * now
            terminated = jnp.asarray(False)
        moved = eqx.tree_at(lambda e: e.arrived, moved, episode.arrived | arrived)
        out_of_time = moved.step >= HORIZON[self.reward]
        return moved, Outcome(reward, terminated, out_of_time & ~terminated, moved.arrived)

    def _flock_gain(self, before: State, after: State) -> Float[Array, ""]:
        """Metres by which the centre came nearer to the goal, or the stray to the centre."""
        centre = herding.gcm(before.sheep)
        if self.skill == "drive":
            goal = herding.goal(self.world.arena)
            return norm(centre - goal) - norm(herding.gcm(after.sheep) - goal)
        stray = jnp.argmax(norm(before.sheep - centre))
        return norm(before.sheep[stray] - centre) - norm(after.sheep[stray] - centre)

    def _subgoal(self, episode: Episode, aim: float = 1.0) -> Float[Array, "dogs 2"]:
        state = episode.state
        world = eqx.tree_at(
            lambda w: (w.dog.driving, w.dog.collecting),
            self.world,
            replace_fn=lambda offset: offset * episode.offset * aim,
        )
        if self.skill == "drive":
            point = herding.driving_points(world, state.sheep, state.dogs)
        else:
            point, _ = herding.collecting_points(world, state.sheep, state.dogs)
        return herding.within_airspace(world, point)
