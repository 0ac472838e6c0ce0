# pyright: reportMissingImports=false
"""Many worlds as Stable-Baselines3's `VecEnv`, stepped by one compiled call.

It needs `pip install 'skydog[sb3]'`.
"""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from skydog import files
from skydog.envs import tasks
from skydog.envs.vector import HerdingVectorEnv
from skydog.errors import Refusal, short
from skydog.shepherds.foreign import from_policy
from skydog.shepherds.options import ObservationKind
from skydog.study.progress import Evaluation
from skydog.world.mission import MAX_STEPS

try:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise Refusal("this needs Stable-Baselines3; run: pip install 'skydog[sb3]'") from None


class HerdingVecEnv(VecEnv):
    """`HerdingVecEnv(num_envs, task, **options)`: worlds for Stable-Baselines3.

    It is a `HerdingVectorEnv`, with the same options; a mission has 1000 steps if
    `max_episode_steps` is not given.
    A world whose episode has ended is reset in the same step. Its `infos` then have what
    Stable-Baselines3 looks for: `terminal_observation`, `TimeLimit.truncated` and `is_success`;
    beside them, and in every other step, what `skydog.envs.tasks.info` lists. Put
    `stable_baselines3.common.vec_env.VecMonitor` around it to log returns.
    """

    def __init__(self, num_envs: int = 1, task: str = "herd", **options: Any):
        """Raises `Refusal` for bad values."""
        for name in ("autoreset_mode", "render_mode"):
            if name in options:
                raise Refusal(f"Stable-Baselines3's VecEnv has no {name}; leave it out")
        if task == "herd":  # as `gymnasium.make` limits it
            options = {"max_episode_steps": MAX_STEPS, **options}
        same = AutoresetMode.SAME_STEP
        self.worlds = HerdingVectorEnv(num_envs, task, autoreset_mode=same, **options)
        self.render_mode = None
        self._actions: Any = None
        observes, acts = self.worlds.single_observation_space, self.worlds.single_action_space
        super().__init__(self.worlds.num_envs, observes, acts)

    def reset(self) -> np.ndarray:
        """Fresh episodes of all worlds, from the seeds of `seed` if it was called."""
        if any(self._options):
            raise Refusal("worlds that are stepped together are placed by their seeds alone")
        seeds = None if None in self._seeds else self._seeds
        seen, info = self.worlds.reset(seed=seeds)
        self.reset_infos = _by_world(info)
        self._reset_seeds()
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, whether episodes ended, and infos."""
        seen, reward, terminated, truncated, info = self.worlds.step(self._actions)
        done = terminated | truncated
        infos = _by_world(info)
        if done.any():
            last = _by_world(info["final_info"])
            for world in np.flatnonzero(done):
                infos[world] = last[world] | {
                    "is_success": last[world]["success"],
                    "terminal_observation": info["final_obs"][world],
                    "TimeLimit.truncated": bool(truncated[world] & ~terminated[world]),
                }
        return seen, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Nothing is left open."""
        self.worlds.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, the same of every world. Raises `AttributeError`."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Worlds are one program: none has an attribute of its own. Raises `Refusal`."""
        raise Refusal(f"{short(attr_name)} is not set world by world; make another HerdingVecEnv")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Worlds are one program: none has a method of its own. Raises `Refusal`."""
        raise Refusal(f"no world has the method {short(method_name)}; use gymnasium.make for one")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No world is wrapped."""
        return [False for _ in self._get_indices(indices)]


def _by_world(info: dict[str, Any]) -> list[dict[str, Any]]:
    """The info of each world, in Python's own numbers."""
    columns = [info[name].tolist() for name in tasks.INFO]
    return [dict(zip(tasks.INFO, row, strict=True)) for row in zip(*columns, strict=True)]


class Metres(BaseFeaturesExtractor):
    """The first layer of a policy: it divides what is observed, in metres, by `unit` metres.

    It belongs to the policy and is saved with it, so that the policy takes metres wherever it
    flies: `policy_kwargs={"features_extractor_class": Metres}`.
    """

    def __init__(self, observation_space: Any, unit: float = 4.0):
        super().__init__(observation_space, features_dim=observation_space.shape[0])
        self.unit = unit

    def forward(self, observations: Any) -> Any:
        """The observations in units."""
        return observations / self.unit


class EvaluationCallback(BaseCallback):
    """`EvaluationCallback(evaluation, observation, stop=None, keep=None)`: missions on the way.

    It flies those of a `skydog.study.progress.Evaluation` while a model learns.
    `observation` is that of the model's environment, and the evaluation's world is to have the same
    flock. With `stop` the training ends as soon as that share of the missions succeeds. With `keep`
    the best model so far is saved there, a zip.
    """

    def __init__(
        self,
        evaluation: Evaluation,
        observation: ObservationKind = "compact",
        stop: float | None = None,
        keep: str | Path | None = None,
    ):
        super().__init__()
        self.evaluation, self.stop, self.keep = evaluation, stop, keep
        self._shepherd = from_policy(self._predict, observation)

    def _predict(self, seen: np.ndarray) -> np.ndarray:
        return self.model.predict(seen, deterministic=True)[0]

    def _on_step(self) -> bool:
        row = self.evaluation(self.num_timesteps, self._shepherd)
        if row is None:
            return True
        self.logger.record("evaluation/success", row["success"])
        self.logger.record("evaluation/steps", row["steps"]["mean"])
        if self.keep is not None and self.evaluation.best == self.num_timesteps:
            buffer = BytesIO()
            self.model.save(buffer)
            files.write_bytes(Path(self.keep), buffer.getvalue())
        return self.stop is None or row["success"] < self.stop
