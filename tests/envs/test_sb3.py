# pyright: reportMissingImports=false
"""A real client: Stable-Baselines3's own checker, and its PPO. `make peers` runs them."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip(
    "stable_baselines3", reason="Stable-Baselines3 is not installed here; make peers runs these"
)
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

import skydog.envs  # noqa: F401

NAMES = ("skydog/Herd-v0", "skydog/Collect-v0", "skydog/Drive-v0")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("observation", ["compact", "full"])
@pytest.mark.filterwarnings("error")
def test_stable_baselines3s_checker_has_nothing_to_say(name, observation):
    check_env(gymnasium.make(name, observation=observation, render_mode="rgb_array").unwrapped)
    print(f"stable_baselines3 check_env: nothing to say of {name}, {observation}")


class Curve(BaseCallback):
    """Prints the learning curve, a line a rollout."""

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        returns = [episode["r"] for episode in self.model.ep_info_buffer]
        print(f"{self.num_timesteps:6d} steps: a return of {np.mean(returns):6.2f}", flush=True)


def test_ppo_improves_on_drive():
    import torch

    torch.set_num_threads(1)
    worlds = make_vec_env("skydog/Drive-v0", n_envs=8, seed=0)
    trials = make_vec_env("skydog/Drive-v0", n_envs=1, seed=10_000)
    ppo = PPO("MlpPolicy", worlds, n_steps=512, batch_size=256, learning_rate=1e-3, seed=0)
    before, _ = evaluate_policy(ppo, trials, n_eval_episodes=100)
    ppo.learn(40_000, callback=Curve())
    trials.seed(10_000)
    after, _ = evaluate_policy(ppo, trials, n_eval_episodes=100)
    print(f"PPO on Drive-v0: a return of {before:.2f} untaught, {after:.2f} after 40,000 steps")
    assert after > before + 1.0
