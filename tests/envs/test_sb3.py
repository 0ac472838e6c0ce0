# pyright: reportMissingImports=false
"""A real client: Stable-Baselines3's own checker, and its PPO. `make peers` runs them."""

import gymnasium
import jax
import numpy as np
import pytest

pytest.importorskip(
    "stable_baselines3", reason="Stable-Baselines3 is not installed here; make peers runs these"
)
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

import skydog
import skydog.envs
from skydog.shepherds import store

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


@pytest.fixture(scope="module")
def untaught(tmp_path_factory):
    """Zips of models that have learnt nothing, by algorithm."""
    folder = tmp_path_factory.mktemp("zips")
    env = gymnasium.make("skydog/Herd-v0", observation="full")
    for kind in (PPO, SAC):
        kind("MlpPolicy", env, seed=0, device="cpu").save(folder / kind.__name__.lower())
    return folder


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_zip_flies_as_its_model_acts_and_is_saved_with_its_hash(untaught, tmp_path, algorithm):
    named = f"{algorithm}:{untaught / algorithm}.zip"
    dog = skydog.load(named)
    assert dog.observation == "full"
    world = skydog.preset("paper")
    state = skydog.reset(world, jax.random.key(0))
    seen = np.concatenate([state.sheep, np.zeros((1, 2))]) - state.dogs
    model = {"ppo": PPO, "sac": SAC}[algorithm].load(untaught / algorithm, device="cpu")
    acted, _ = model.predict(seen.reshape(1, -1).astype(np.float32), deterministic=True)
    assert np.allclose(dog(world, state), world.dog.speed * acted, atol=1e-5)

    store.save(tmp_path / store.FILE, skydog.from_policy(named, divide_by=4.0), {})
    again = skydog.load(f"policy:{tmp_path}")
    assert (again.observation, again.divide_by) == ("full", 4.0)


def test_a_zip_that_has_changed_since_it_was_saved_is_refused(untaught, tmp_path):
    file = tmp_path / "model.zip"
    file.write_bytes((untaught / "ppo.zip").read_bytes())
    store.save(tmp_path / store.FILE, skydog.from_policy(f"ppo:{file}"), {})
    assert skydog.load(f"policy:{tmp_path}").observation == "full"
    file.write_bytes((untaught / "sac.zip").read_bytes())
    with pytest.raises(skydog.Refusal, match="has changed since"):
        skydog.load(f"policy:{tmp_path}")
    with pytest.raises(skydog.Refusal, match="no PPO of Stable-Baselines3"):
        skydog.load(f"ppo:{file}")


def test_a_model_cannot_see_another_flock_than_it_learnt_with(untaught):
    world = skydog.preset("paper", arena=10.0, sheep=5)
    with pytest.raises(skydog.Refusal, match="as many sheep and dogs as it has learnt with"):
        skydog.compare([f"ppo:{untaught / 'ppo.zip'}"], world, sheep=5)
