"""The tasks of the environments: a mission or a lesson, as pure functions of an episode."""

from dataclasses import replace
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from skydog.envs import inputs
from skydog.errors import Refusal, short
from skydog.learning import lessons
from skydog.learning.lessons import Lesson, Outcome
from skydog.learning.options import Reward
from skydog.shepherds import observing
from skydog.shepherds.options import ObservationKind as ObservationKind
from skydog.study import cases
from skydog.study.options import Starts
from skydog.world import herding, memory, mission, obstacles, params, serialise
from skydog.world.home import AroundHome
from skydog.world.params import World
from skydog.world.presets import PRESETS
from skydog.world.presets import preset as preset_world
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm

TaskName = Literal["herd", "collect", "drive"]
"""The whole mission, or one of the two lessons."""

MAX_SHEEP, MAX_DOGS = 10_000, 1_000
NEVER = 2**31 - 1  # the step at which an episode without a limit ends

# The `info` beside an observation, by name and kind: see `info`.
INFO = {
    "success": bool,
    "steps": int,
    "distance": float,
    "dog_to_subgoal": float,
    "centre_to_goal": float,
    "spread": float,
    "drives": bool,
}

# What a mission pays besides the metres gained: for its end, and for every step.
ACCOMPLISHED = 1.0
STEP_COST = 0.01


class Mission(eqx.Module):
    """A herding mission under way."""

    state: State
    key: PRNGKeyArray  # of its noise
    step: Int[Array, ""]


class HerdTask(eqx.Module):
    """The whole mission: collect the strays, drive the flock home.

    The reward is the metres by which the flock came nearer to its end in the step: the sheep's
    mean distance to the goal, and how far the stray stands beyond f(N). Less `STEP_COST`; and
    `ACCOMPLISHED` when all are home and gathered, which ends the episode. It adds up to about
    the same over any mission that succeeds, less the time it took. Ours; the paper rewards
    lessons only. Distances are straight ones; in a scene, those around its obstacles.
    """

    world: World
    sheep: int = eqx.field(static=True, default=3)
    dogs: int = eqx.field(static=True, default=1)
    starts: Starts = eqx.field(static=True, default="random")
    noisy: bool = eqx.field(static=True, default=False)

    def start(self, key: PRNGKeyArray) -> Mission:
        """A mission that has not begun."""
        for_start, for_noise = jax.random.split(key)
        state = cases.draw(self.world, for_start, self.starts, self.sheep, self.dogs)
        return Mission(memory.begin(self.world, state), for_noise, jnp.asarray(0))

    def step(self, episode: Mission, action: Float[Array, "dogs 2"]) -> tuple[Mission, Outcome]:
        """Fly one step; `action` is each dog's velocity, in shares of the speed limit."""
        moving = self._keys(episode)[0] if self.noisy else None
        velocity = observing.velocity(self.world, action)
        after = mission.step(self.world, episode.state, velocity, moving)
        success = mission.accomplished(self.world, after)
        reward = self._remaining(episode.state) - self._remaining(after) - STEP_COST
        moved = Mission(after, episode.key, episode.step + 1)
        reward = reward + ACCOMPLISHED * success
        return moved, Outcome(reward, success, jnp.asarray(False), success)

    def perceived(self, episode: Mission) -> tuple[State, Float[Array, "dogs 2"], Float[Array, ""]]:
        """What the dogs make out: the state, their subgoals in it, and the scale, which is 1."""
        perceiving = self._keys(episode)[1] if self.noisy else None
        state = mission.perceive(self.world, episode.state, perceiving)
        subgoal, _ = herding.gate(self.world, state.sheep, state.dogs)
        return state, subgoal, jnp.ones(())

    def scene(self, episode: Mission) -> tuple[World, State, Float[Array, "dogs 2"], Array, Array]:
        """World, state, subgoals, who drives, and whether it is accomplished."""
        subgoal, drives = herding.gate(self.world, episode.state.sheep, episode.state.dogs)
        success = mission.accomplished(self.world, episode.state)
        return self.world, episode.state, subgoal, drives, success

    def _remaining(self, state: State) -> Float[Array, ""]:
        home = self.world.home
        away = jnp.mean(
            home.field.at(state.sheep)[0]
            if isinstance(home, AroundHome)
            else norm(state.sheep - herding.goal(self.world.arena))
        )
        stray = jnp.max(norm(state.sheep - herding.gcm(state.sheep)))
        spread = herding.gathered_radius(self.world, self.sheep)
        return away + jnp.maximum(stray - spread, 0.0)

    def _keys(self, episode: Mission) -> Key[Array, "2"]:
        # As `mission.instant` draws them, so that an environment flies a rollout over again.
        return jax.random.split(jax.random.fold_in(episode.key, episode.step))


class LessonTask(eqx.Module):
    """A lesson (`skydog.learning.lessons.Lesson`) in the world's axes, with the world's goal."""

    lesson: Lesson
    dogs: int = eqx.field(static=True, default=1)

    @property
    def world(self) -> World:
        """The world at scale 1."""
        return self.lesson.world

    @property
    def sheep(self) -> int:
        """Sheep in the flock."""
        return self.lesson.sheep

    def start(self, key: PRNGKeyArray) -> lessons.Episode:
        """A lesson that has not begun."""
        return self.lesson.start(key)

    def step(
        self, episode: lessons.Episode, action: Float[Array, "1 2"]
    ) -> tuple[lessons.Episode, Outcome]:
        """Fly one step; `action` is the velocity in shares of the speed limit."""
        return self.lesson.step(episode, action[0])

    def perceived(
        self, episode: lessons.Episode
    ) -> tuple[State, Float[Array, "1 2"], Float[Array, ""]]:
        """The state, the subgoal in it, and the scale that the dog sees them at."""
        seen = replace(episode, state=mission.perceive(self.world, episode.state))
        return seen.state, self.lesson.subgoal(seen), episode.scale

    def scene(
        self, episode: lessons.Episode
    ) -> tuple[World, State, Float[Array, "1 2"], Array, Array]:
        """World, state, subgoal, whether it drives, and whether it has arrived."""
        drives = jnp.full(1, self.lesson.skill == "drive")
        subgoal = self.lesson.subgoal(episode)
        return (
            self.lesson.world_at(episode.scale, episode.goal),
            episode.state,
            subgoal,
            drives,
            episode.arrived,
        )


class EnvState(eqx.Module):
    """An episode, and how far the dogs have flown in it."""

    episode: Any  # of the task
    flown: Float[Array, ""]  # metres, all dogs together


Task = HerdTask | LessonTask


def make_task(
    task: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
    starts: str = "random",
    reward: str = "progress",
    world: Any = None,
    scene: Any = None,
    mix: Any = None,
) -> Task:
    """The task of a `TaskName`, in a preset's world or in one of your own.

    Raises `Refusal` for what cannot be.
    """
    what = inputs.choice(task, get_args(TaskName), "task")
    where = inputs.choice(starts, get_args(Starts), "starts")
    pays = inputs.choice(reward, get_args(Reward), "reward")
    inputs.choice(preset, PRESETS, "preset")
    sheep = inputs.count(sheep, "sheep", MAX_SHEEP)
    dogs = inputs.count(dogs, "dogs", MAX_DOGS)
    if world is not None and (arena is not None or preset != "paper" or scene or mix):
        raise Refusal("world takes the place of preset, scene, arena and mix; leave those out")
    if scene is not None and what != "herd":
        raise Refusal(f"the lesson {what!r} has no obstacles; leave out scene={short(scene)}")
    if world is None:
        chosen = preset_world(preset, arena, sheep, scene=scene, mix=inputs.options(mix, "mix"))
    else:
        chosen = mission.check(_with_numbers(world), sheep, dogs)
    traced = params.traced(chosen)
    if what == "herd":
        cases.check(where, sheep, dogs)
        return HerdTask(traced, sheep, dogs, where, params.noisy(chosen))
    return LessonTask(Lesson(traced, what, pays, sheep, frame="paper", draws=lessons.EVEN))


def _with_numbers(world: Any) -> World:
    """The world of somebody's own, if its numbers are numbers. Raises `Refusal`."""
    if not isinstance(world, World):
        raise Refusal(
            f"world is one that skydog.preset makes, or a change of it, got {short(world)}"
        )
    for part, kind in serialise.PARTS.items():
        body = getattr(world, part)
        if not isinstance(body, kind):
            raise Refusal(f"world.{part} is an {kind.__name__}, got {short(body)}")
        for name, value in vars(body).items():
            square = name == "height" and value is None
            if square or f"{part}.{name}" in serialise.LAWS:
                continue
            given = inputs.numbers(value)
            above_zero = f"{part}.{name}" in serialise.POSITIVE
            least = np.finfo(np.float32).tiny if above_zero else 0.0
            inside = given is not None and bool(np.all((least <= given) & (given < np.inf)))
            if given is None or not inside or (given.ndim and kind is not params.Sheep):
                above = "above 0" if least else "from 0 on"
                raise Refusal(
                    f"world.{part}.{name} is a number {above}, got {short(value)}; "
                    "try skydog.preset"
                )
    return world


def reset(task: Task, key: PRNGKeyArray) -> EnvState:
    """An episode that has not begun."""
    return EnvState(task.start(key), jnp.zeros(()))


def placed(task: Task, options: Any) -> dict[str, np.ndarray]:
    """Where `options` of `reset` place `sheep` and `dogs`, in metres.

    Raises `Refusal` for an unknown option, another number of them, or a place out of bounds.
    """
    (wide, high), beyond = task.world.arena.plain_sides, float(task.world.dog.airspace)
    airspace = wide + beyond, high + beyond
    bounds = {
        "sheep": (task.sheep, 0.0, (wide, high)),
        "dogs": (task.dogs, -beyond, airspace),
    }
    if isinstance(task, LessonTask):  # it draws the arena too
        bounds = {}
    where = {}
    for name, value in inputs.options(options).items():
        if name not in bounds:
            choices = ", ".join(bounds) or "none: a lesson draws its start"
            raise Refusal(f"reset has no option {short(name)}; choose from {choices}")
        where[name] = inputs.places(value, name, *bounds[name])
        _check_free(task.world, name, where[name])
    return where


def _check_free(world: World, name: str, places: np.ndarray) -> None:
    """Raise `Refusal` for a place within an obstacle that it may not be in."""
    if world.obstacles is None or (name == "dogs" and not world.obstacles.tall):
        return
    inside = np.asarray(obstacles.clearance(world.obstacles, jnp.asarray(places))) < 0.0
    if inside.any():
        at = np.round(places[np.argmax(inside)], 3).tolist()
        raise Refusal(f"the option {name!r} places one within an obstacle, at {at}; move it")


def place(task: Task, env: EnvState, where: dict[str, Float[Array, "some 2"]]) -> EnvState:
    """The mission begun somewhere else: `sheep` and `dogs` in metres, those that are given."""
    state = memory.begin(task.world, replace(env.episode.state, memory=None, **where))
    return replace(env, episode=replace(env.episode, state=state))


def step(task: Task, env: EnvState, action: Float[Array, "dogs 2"]) -> tuple[EnvState, Outcome]:
    """The episode a step later, and what the step brought."""
    before = env.episode.state.dogs
    episode, outcome = task.step(env.episode, action)
    flown = jnp.sum(norm(episode.state.dogs - before))
    return EnvState(episode, env.flown + flown), outcome


def observe(task: Task, env: EnvState, how: ObservationKind) -> Float[Array, "dogs seen"]:
    """What each dog sees (`skydog.shepherds.observing.observe`), within `observation_bound`.

    In metres, and in a lesson times ξ.
    """
    state, subgoal, scale = task.perceived(env.episode)
    seen = observing.observe(task.scene(env.episode)[0], state, subgoal, how)
    return jnp.clip(scale * seen, -observation_bound(task), observation_bound(task))


def observation_bound(task: Task) -> Scalar:
    """The furthest, in metres on an axis, that anything can be from a dog, as the dog sees it."""
    widest = max(1.0, task.lesson.scales[1]) if isinstance(task, LessonTask) else 1.0
    return observing.bound(task.world, widest)


def observation_size(task: Task, how: ObservationKind) -> int:
    """How many numbers a dog sees."""
    return observing.size(how, task.sheep, task.dogs)


def info(task: Task, env: EnvState) -> dict[str, Array]:
    """The `info` beside an observation: how far the mission or lesson has come.

    `success`; `steps`; `distance`, metres flown by all dogs; `dog_to_subgoal` and
    `centre_to_goal`, metres; `spread`, metres from the flock's centre to its stray; `drives`,
    whether all dogs drive, else they collect.
    """
    world, state, subgoal, drives, success = task.scene(env.episode)
    centre = herding.gcm(state.sheep)
    return {
        "success": success,
        "steps": env.episode.step,
        "distance": env.flown,
        "dog_to_subgoal": jnp.mean(norm(state.dogs - subgoal)),
        "centre_to_goal": norm(centre - herding.goal(world.arena)),
        "spread": jnp.max(norm(state.sheep - centre)),
        "drives": jnp.all(drives),
    }
