"""One world as a Gymnasium environment."""

from functools import partial
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from skydog.envs import games, inputs
from skydog.envs.games import Observation
from skydog.envs.window import Eyes


class Herding(gymnasium.Env[np.ndarray, Any]):
    """A mission (`task="herd"`) or a lesson (`"collect"`, `"drive"`) for one dog.

    The action is the dog's velocity, x and y, in shares of its speed limit. The observation is
    `compact`, the paper's four numbers, or `full`, where everybody is, seen from the dog; in
    metres, and in a lesson times ξ (see `skydog.envs.games.observe`). A mission is `terminated`
    when it is accomplished, and `truncated` by the time limit that `gymnasium.make` sets; a
    lesson ends as `skydog.learning.lessons.Lesson` tells. `info` has what
    `skydog.envs.games.told` lists.

    `reset(options={"sheep": [[x, y], ...], "dogs": [[x, y]]})` places a mission's start.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

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
        render_mode: str | None = None,
    ):
        """`world` takes the place of `preset` and `arena`. Raises `Refusal` for bad values."""
        self.game = games.game(task, preset, arena, sheep, 1, starts, reward, world)
        self._how = games.one_of(observation, Observation, "observation")
        self.observation_space, self.action_space = seen_and_done(self.game, self._how)
        self._seen = games.numbers(self.game, self._how)
        self.metadata = {**self.metadata, "render_fps": rate(self.game)}
        self.render_mode = render_mode
        self._eyes = Eyes(self.game, render_mode, self.metadata)
        self._seed, self._episode = 0, 0
        self._played: Any = None  # a `Played`, once it is reset

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        """A fresh episode: what the dog sees, and `info`."""
        placed = inputs.placed(self.game, options)
        given = None if seed is None else inputs.seed(seed)
        super().reset(seed=given)
        if given is None and self._played is not None:
            self._episode += 1
        else:
            self._seed = int(self.np_random.integers(2**31)) if given is None else given
            self._episode = 0
        key = jax.random.key(self._seed % 2**32)
        self._played, row = _begin(self.game, self._how, key, self._episode, placed)
        self._eyes.begin(self._played)
        seen, *_, info = self._unpacked(row)
        return seen, info

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one step: what the dog sees, reward, terminated, truncated, and `info`."""
        if self._played is None:
            raise ResetNeeded("step needs an episode to be under way; call env.reset() first")
        told = inputs.action(action, (2,))
        self._played, row = _turn(self.game, self._how, self._played, told)
        self._eyes.see(self._played)
        return self._unpacked(row)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The arena from above, 480 pixels a side, red, green and blue; None for a window."""
        if self._played is None:
            raise ResetNeeded("render needs an episode to be under way; call env.reset() first")
        return self._eyes.picture()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._eyes.close()

    def _unpacked(self, row: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        numbers = np.array(row, np.float32)
        reward, terminated, truncated, *told = numbers[self._seen :].tolist()
        kinds = zip(games.TOLD.items(), told, strict=True)
        info = {name: kind(value) for (name, kind), value in kinds}
        return numbers[: self._seen], reward, bool(terminated), bool(truncated), info


def seen_and_done(game: games.Game, how: Observation) -> tuple[spaces.Box, spaces.Box]:
    """The spaces of what a dog sees and of what it is told."""
    reach = float(games.reach(game))
    return (
        spaces.Box(-reach, reach, (games.numbers(game, how),), np.float32),
        spaces.Box(-1.0, 1.0, (2,), np.float32),
    )


def rate(game: games.Game) -> int:
    """Frames a second at which the game is shown in real time, one at least."""
    return max(1, round(1.0 / float(game.world.arena.dt)))


@partial(jax.jit, static_argnames="how")
def _begin(game, how, key, episode, placed) -> Any:
    played = games.place(games.begin(game, jax.random.fold_in(key, episode)), placed)
    return played, _packed(game, how, played)


@partial(jax.jit, static_argnames="how")
def _turn(game, how, played, action) -> Any:
    played, outcome = games.turn(game, played, action[None])
    return played, _packed(game, how, played, outcome)


def _packed(game, how, played, outcome=None) -> Any:
    # One row of numbers: a dozen small arrays would take longer to fetch than to compute.
    ended = [0.0] * 3
    if outcome is not None:
        ended = [outcome.reward, outcome.terminated, outcome.truncated]
    told = [games.told(game, played)[name] for name in games.TOLD]
    rest = jnp.stack([jnp.asarray(value, jnp.float32) for value in (*ended, *told)])
    return jnp.concatenate([games.observe(game, played, how)[0], rest])
