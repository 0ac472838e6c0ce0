"""One world as a Gymnasium environment."""

from functools import partial
from typing import Any, get_args

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from skydog import numerics
from skydog.envs import inputs, tasks
from skydog.envs.tasks import ObservationKind
from skydog.envs.window import Renderer


class HerdingEnv(gymnasium.Env[np.ndarray, Any]):
    """A mission (`task="herd"`) or a lesson (`"collect"`, `"drive"`) for one dog.

    The action is the dog's velocity, x and y, in shares of its speed limit. The observation is
    `compact`, the paper's four numbers, or `full`, where everybody is, seen from the dog; in
    metres, and in a lesson times ξ (see `skydog.envs.tasks.observe`). A mission is `terminated`
    when it is accomplished, and `truncated` by the time limit that `gymnasium.make` sets; a
    lesson ends as `skydog.learning.lessons.Lesson` tells. `info` has what
    `skydog.envs.tasks.info` lists.

    `reset(options={"sheep": [[x, y], ...], "dogs": [[x, y]]})` places a mission's start.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    @numerics.ours()
    def __init__(
        self,
        task: str = "herd",
        preset: str = "paper",
        arena: float | None = None,
        sheep: int = 3,
        starts: str = "random",
        reward: str = "progress",
        observation: str = "compact",
        world: Any = None,
        scene: Any = None,
        mix: Any = None,
        render_mode: str | None = None,
    ):
        """`world` takes the place of preset, scene, arena and mix. Raises `Refusal`."""
        self.task = tasks.make_task(
            task, preset, arena, sheep, 1, starts, reward, world, scene, mix
        )
        self._how = inputs.choice(observation, get_args(ObservationKind), "observation")
        self.observation_space, self.action_space = spaces_of(self.task, self._how)
        self._seen = tasks.observation_size(self.task, self._how)
        self.metadata = {**self.metadata, "render_fps": render_fps(self.task)}
        self.render_mode = render_mode
        self._renderer = Renderer(self.task, render_mode, self.metadata)
        self._seed, self._episode = 0, 0
        self._env: Any = None  # an `EnvState`, once it is reset

    @numerics.ours()
    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        """A fresh episode: what the dog sees, and `info`."""
        placed = tasks.placed(self.task, options)
        given = None if seed is None else inputs.seed(seed)
        super().reset(seed=given)
        if given is None and self._env is not None:
            self._episode += 1
        else:
            self._seed = int(self.np_random.integers(2**31)) if given is None else given
            self._episode = 0
        key = jax.random.key(self._seed % 2**32)
        self._env, row = _reset(self.task, self._how, key, self._episode, placed)
        self._renderer.reset(self._env)
        seen, *_, info = self._unpacked(row)
        return seen, info

    @numerics.ours()
    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one step: what the dog sees, reward, terminated, truncated, and `info`."""
        if self._env is None:
            raise ResetNeeded("step needs an episode to be under way; call env.reset() first")
        command = inputs.action(action, (2,))
        self._env, row = _step(self.task, self._how, self._env, command)
        self._renderer.add(self._env)
        return self._unpacked(row)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The arena from above, 480 pixels a side, red, green and blue; None for a window."""
        if self._env is None:
            raise ResetNeeded("render needs an episode to be under way; call env.reset() first")
        return self._renderer.frame()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._renderer.close()

    def _unpacked(self, row: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        numbers = np.array(row, np.float32)
        reward, terminated, truncated, *values = numbers[self._seen :].tolist()
        kinds = zip(tasks.INFO.items(), values, strict=True)
        info = {name: kind(value) for (name, kind), value in kinds}
        return numbers[: self._seen], reward, bool(terminated), bool(truncated), info


def spaces_of(task: tasks.Task, how: ObservationKind) -> tuple[spaces.Box, spaces.Box]:
    """The spaces of observations and actions."""
    bound = float(tasks.observation_bound(task))
    return (
        spaces.Box(-bound, bound, (tasks.observation_size(task, how),), np.float32),
        spaces.Box(-1.0, 1.0, (2,), np.float32),
    )


def render_fps(task: tasks.Task) -> int:
    """Frames a second at which the task is shown in real time, one at least."""
    return max(1, round(1.0 / float(task.world.arena.dt)))


@partial(jax.jit, static_argnames="how")
def _reset(task, how, key, episode, placed) -> Any:
    env = tasks.place(task, tasks.reset(task, jax.random.fold_in(key, episode)), placed)
    return env, _packed(task, how, env)


@partial(jax.jit, static_argnames="how")
def _step(task, how, env, action) -> Any:
    env, outcome = tasks.step(task, env, action[None])
    return env, _packed(task, how, env, outcome)


def _packed(task, how, env, outcome=None) -> Any:
    # One row of numbers: a dozen small arrays would take longer to fetch than to compute.
    ended = [0.0] * 3
    if outcome is not None:
        ended = [outcome.reward, outcome.terminated, outcome.truncated]
    info = [tasks.info(task, env)[name] for name in tasks.INFO]
    rest = jnp.stack([jnp.asarray(value, jnp.float32) for value in (*ended, *info)])
    return jnp.concatenate([tasks.observe(task, env, how)[0], rest])
