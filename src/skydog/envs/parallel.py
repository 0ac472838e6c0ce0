"""The mission of several dogs, each an agent, as a PettingZoo parallel environment."""

from functools import partial
from typing import Any, get_args

import jax
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.seeding import np_random
from pettingzoo import ParallelEnv

from skydog import numerics
from skydog.envs import inputs, tasks
from skydog.envs.single import render_fps, spaces_of
from skydog.envs.tasks import ObservationKind
from skydog.envs.window import Renderer
from skydog.world.mission import MAX_STEPS

PLACED = ("sheep", "dogs")  # whom an option of `reset` may place


class ParallelHerdingEnv(ParallelEnv[str, np.ndarray, Any]):
    """The whole mission, `dog_0` and so on each an agent; all are paid the flock's reward.

    Actions, observations and reward are those of `skydog/Herd-v0`, each dog with a subgoal
    of its own: with more than one stray to fetch, the gate shares them out. The episode ends for
    all dogs at once, terminated when the mission is accomplished, truncated after `max_steps`.
    """

    metadata = {
        "name": "herd_parallel_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    @numerics.ours()
    def __init__(
        self,
        dogs: int = 3,
        preset: str = "paper",
        arena: float | None = None,
        sheep: int = 3,
        starts: str = "random",
        observation: str = "compact",
        world: Any = None,
        scene: Any = None,
        mix: Any = None,
        max_steps: int = MAX_STEPS,
        render_mode: str | None = None,
    ):
        """`world` takes the place of preset, scene, arena and mix. Raises `Refusal`."""
        self._max_steps = inputs.count(max_steps, "max_steps", tasks.NEVER)
        self.task = tasks.make_task(
            "herd", preset, arena, sheep, dogs, starts, world=world, scene=scene, mix=mix
        )
        self._how = inputs.choice(observation, get_args(ObservationKind), "observation")
        seen, done = spaces_of(self.task, self._how)
        self.possible_agents = [f"dog_{number}" for number in range(dogs)]
        self.agents: list[str] = []
        # One of its own for each agent: a space holds the generator that samples it.
        self.observation_spaces = {name: _copy(seen) for name in self.possible_agents}
        self.action_spaces = {name: _copy(done) for name in self.possible_agents}
        self.metadata = {**self.metadata, "render_fps": render_fps(self.task)}
        self.render_mode = render_mode
        self._renderer = Renderer(self.task, render_mode, self.metadata)
        self._seed: int | None = None
        self._episode = 0
        self._env: Any = None  # an `EnvState`, once it is reset

    def observation_space(self, agent: str) -> spaces.Space[np.ndarray]:
        """What a dog sees."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """A dog's velocity, in shares of its speed limit."""
        return self.action_spaces[agent]

    @numerics.ours()
    def reset(
        self, seed: Any = None, options: Any = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """A fresh episode. `options` may place `sheep` and `dogs`, in metres."""
        # PettingZoo's own test passes an option that nobody knows, and expects it to be ignored.
        known = {name: value for name, value in inputs.options(options).items() if name in PLACED}
        placed = tasks.placed(self.task, known)
        given = None if seed is None else inputs.seed(seed)
        if given is None and self._seed is not None:
            self._episode += 1
        else:
            self.np_random, _ = np_random(given)  # other people's wrappers draw from it
            drawn = int(self.np_random.integers(2**31)) if given is None else given
            self._seed, self._episode = drawn, 0
        key = jax.random.key(self._seed % 2**32)
        self._env, seen, info = _reset(self.task, self._how, key, self._episode, placed)
        self._renderer.reset(self._env)
        self.agents = list(self.possible_agents)
        return self._each(np.array(seen, np.float32)), self._infos(info)

    @numerics.ours()
    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, np.ndarray],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Fly one step, with an action for each dog."""
        if self._env is None or not self.agents:
            raise ResetNeeded("step needs an episode to be under way; call env.reset() first")
        if not isinstance(actions, dict):
            raise InvalidAction(f"actions are a dict, one for each of {', '.join(self.agents)}")
        if set(actions) != set(self.agents):
            odd = ", ".join(sorted(map(str, set(actions) ^ set(self.agents))))
            raise InvalidAction(f"each of {', '.join(self.agents)} has one action; see to {odd}")
        commands = np.stack([inputs.action(actions[name], (2,)) for name in self.agents])
        self._env, seen, outcome, info = _step(self.task, self._how, self._env, commands)
        self._renderer.add(self._env)
        info = self._infos(info)
        late = next(iter(info.values()))["steps"] >= self._max_steps
        ended = bool(outcome.terminated)
        flown = (
            self._each(np.array(seen, np.float32)),
            dict.fromkeys(self.agents, float(outcome.reward)),
            dict.fromkeys(self.agents, ended),
            dict.fromkeys(self.agents, bool(late)),
            info,
        )
        if ended or late:
            self.agents = []
        return flown

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The arena from above, 480 pixels a side, red, green and blue; None for a window."""
        if self._env is None:
            raise ResetNeeded("render needs an episode to be under way; call env.reset() first")
        return self._renderer.frame()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._renderer.close()

    def _each(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(self.agents, rows, strict=True))

    def _infos(self, info: dict[str, Any]) -> dict[str, dict[str, Any]]:
        plain = {name: value.item() for name, value in jax.device_get(info).items()}
        return {name: dict(plain) for name in self.agents}


def _copy(space: spaces.Box) -> spaces.Box:
    return spaces.Box(space.low, space.high, dtype=np.float32)


@partial(jax.jit, static_argnames="how")
def _reset(task, how, key, episode, placed) -> Any:
    env = tasks.place(task, tasks.reset(task, jax.random.fold_in(key, episode)), placed)
    return env, tasks.observe(task, env, how), tasks.info(task, env)


@partial(jax.jit, static_argnames="how")
def _step(task, how, env, commands) -> Any:
    env, outcome = tasks.step(task, env, commands)
    return env, tasks.observe(task, env, how), outcome, tasks.info(task, env)
