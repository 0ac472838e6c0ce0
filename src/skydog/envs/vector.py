"""Many worlds as one Gymnasium vector environment, stepped by one compiled call."""

from functools import partial
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.error import ResetNeeded, UnsupportedMode
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from skydog import numerics
from skydog.envs import inputs, tasks
from skydog.envs.single import render_fps, spaces_of
from skydog.envs.tasks import ObservationKind
from skydog.errors import Refusal, short
from skydog.world.neighbours import ALL_PAIRS

MOST = 1 << 20  # worlds
MOST_PAIRS = 1 << 28  # of sheep, in all worlds: some 20 bytes of memory each


class HerdingVectorEnv(VectorEnv[np.ndarray, Any, np.ndarray]):
    """`num_envs` worlds of `skydog.envs.single.HerdingEnv`, with the same options and numbers.

    A world whose seed is s + i does, to rounding, what the single environment with that seed does;
    no option of `reset` places sheep or dogs. Where
    an episode ends, `autoreset_mode` says what follows, as Gymnasium defines it: the reset takes
    the next step (`AutoresetMode.NEXT_STEP`), happens in the same one, with `final_obs` and
    `final_info` in `info` (`SAME_STEP`), or is the caller's (`DISABLED`, through
    `reset(options={"reset_mask": ...})`).
    """

    metadata = {
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    @numerics.ours()
    def __init__(
        self,
        num_envs: int = 1,
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
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ):
        """Raises `Refusal` for bad values, and `UnsupportedMode` for a render mode."""
        inputs.count(num_envs, "num_envs", MOST)
        if max_episode_steps is not None:
            max_episode_steps = inputs.count(max_episode_steps, "max_episode_steps", tasks.NEVER)
        if render_mode is not None:
            raise UnsupportedMode(
                'worlds stepped together are not shown; try vectorization_mode="sync"'
            )
        if not isinstance(autoreset_mode, AutoresetMode):
            modes = [mode.value for mode in AutoresetMode]
            autoreset_mode = AutoresetMode(inputs.choice(autoreset_mode, modes, "autoreset_mode"))
        self.autoreset_mode = autoreset_mode  # where TorchRL looks for it
        self.task = tasks.make_task(
            task, preset, arena, sheep, 1, starts, reward, world, scene, mix
        )
        pairs = self.task.sheep * min(self.task.sheep, ALL_PAIRS)
        what = f"num_envs, with {self.task.sheep} sheep,"
        num_envs = inputs.count(num_envs, what, min(MOST, MOST_PAIRS // pairs))
        self.num_envs = num_envs
        self.metadata = {
            **self.metadata,
            "autoreset_mode": self.autoreset_mode,
            "render_fps": render_fps(self.task),
        }
        self._how = inputs.choice(observation, get_args(ObservationKind), "observation")
        self._limit = np.int32(max_episode_steps or tasks.NEVER)
        self.single_observation_space, self.single_action_space = spaces_of(self.task, self._how)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeds = np.zeros(num_envs, np.uint32)
        self._episodes = np.zeros(num_envs, np.int32)
        self._over = np.zeros(num_envs, bool)
        self._env: Any = None  # `EnvState` of all worlds, once they are reset

    @numerics.ours()
    def reset(
        self,
        *,
        seed: Any = None,
        options: Any = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Fresh episodes, of all worlds or of those in `options["reset_mask"]`.

        `seed` is one for each world, or that of the first, the others counting on.
        """
        first = self._env is None
        again = self._mask(options)
        seeds = inputs.seeds(seed, self.num_envs)
        super().reset(seed=seeds[0])
        # The first time all worlds are reset, whatever the mask: the others are just not reported.
        for world in np.flatnonzero(again | first):
            given = seeds[world]
            if given is None and not first:
                self._episodes[world] += 1
                continue
            drawn = int(self.np_random.integers(2**31)) if given is None else given
            self._seeds[world], self._episodes[world] = drawn % 2**32, 0
        self._over &= ~again
        fresh = _reset(self.task, self._seeds, self._episodes)
        if self._env is None or again.all():
            self._env = fresh
        else:
            self._env = _chosen(again, fresh, self._env)
        seen, info = _look(self.task, self._how, self._env)
        return np.array(seen, np.float32), _masked(info, again)

    @numerics.ours()
    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly one step in every world."""
        if self._env is None:
            raise ResetNeeded("step needs episodes to be under way; call envs.reset() first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            raise ResetNeeded(
                f"world {int(np.argmax(self._over))} has ended; call envs.reset with "
                'options={"reset_mask": terminated | truncated}'
            )
        commands = inputs.action(actions, (self.num_envs, 2))
        self._env, new = _step(
            self.task,
            self._how,
            self.autoreset_mode.value,
            self._env,
            commands,
            self._over,
            self._seeds,
            self._episodes,
            self._limit,
        )
        seen, reward, terminated, truncated, info, again, final = jax.tree.map(np.array, new)
        self._episodes += again
        info = _masked(info, np.ones(self.num_envs, bool))
        if self.autoreset_mode is AutoresetMode.SAME_STEP and again.any():
            final_seen, final_info = final
            info["final_obs"], info["_final_obs"] = np.full(self.num_envs, None), again
            for world in np.flatnonzero(again):
                info["final_obs"][world] = final_seen[world]
            info["final_info"], info["_final_info"] = _masked(final_info, again), again.copy()
        self._over = terminated | truncated
        return seen.astype(np.float32), reward.astype(np.float64), terminated, truncated, info

    def _mask(self, options: Any) -> np.ndarray:
        rest = inputs.options(options)
        mask = rest.pop("reset_mask", np.ones(self.num_envs, bool))
        if rest:
            odd = short(next(iter(rest)))
            raise Refusal(f"reset has no option {odd}; choose from reset_mask")
        return inputs.mask(mask, self.num_envs)


def _masked(info: dict[str, Any], mask: np.ndarray) -> dict[str, Any]:
    """The info, and beside it a mask of the worlds that it is about; for the others it is zero."""
    masked: dict[str, Any] = {}
    for name, kind in tasks.INFO.items():
        masked[name] = np.where(mask, np.asarray(info[name]), 0).astype(kind)
        masked[f"_{name}"] = mask.copy()
    return masked


@jax.jit
def _reset(task, seeds, episodes) -> Any:
    def one(seed, episode):
        return tasks.reset(task, jax.random.fold_in(jax.random.key(seed), episode))

    return jax.vmap(one)(seeds, episodes)


@partial(jax.jit, static_argnames="how")
def _look(task, how, env) -> Any:
    seen = jax.vmap(lambda env: tasks.observe(task, env, how)[0])(env)
    return seen, jax.vmap(partial(tasks.info, task))(env)


@jax.jit
def _chosen(which, new, old) -> Any:
    def choose(new, old):
        return jnp.where(which.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return jax.tree.map(choose, new, old)


@partial(jax.jit, static_argnames=("how", "mode"), donate_argnames="env")
def _step(task, how, mode, env, commands, over, seeds, episodes, limit) -> Any:
    after, outcome = jax.vmap(partial(tasks.step, task))(env, commands[:, None])
    terminated = outcome.terminated
    truncated = outcome.truncated | (after.episode.step >= limit)
    reward = outcome.reward
    if mode == AutoresetMode.NEXT_STEP.value:
        again = over
        reward = jnp.where(over, 0.0, reward)
        terminated, truncated = terminated & ~over, truncated & ~over
    elif mode == AutoresetMode.SAME_STEP.value:
        again = terminated | truncated
    else:
        again = jnp.zeros_like(over)
    final = _look(task, how, after) if mode == AutoresetMode.SAME_STEP.value else None
    # Only when there is something to begin: a start costs as much as several steps.
    now = jax.lax.cond(
        jnp.any(again),
        lambda: _chosen(again, _reset(task, seeds, episodes + 1), after),
        lambda: after,
    )
    seen, info = _look(task, how, now)
    return now, (seen, reward, terminated, truncated, info, again, final)
