# pyright: reportMissingImports=false
"""Stable-Baselines3's VecEnv over our worlds, and its callback. `make peers` runs them."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip(
    "stable_baselines3", reason="Stable-Baselines3 is not installed here; make peers runs these"
)
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

import skydog.envs  # noqa: F401
from skydog.envs.sb3 import EvaluationCallback, HerdingVecEnv, Metres
from skydog.errors import Refusal
from skydog.study import cases
from skydog.study.progress import Evaluation
from skydog.world.presets import preset


@pytest.mark.parametrize(
    ("task", "limit", "steps"), [("drive", None, 110), ("herd", 20, 45)], ids=["drive", "herd"]
)
def test_worlds_of_a_vecenv_are_single_environments_step_by_step(task, limit, steps):
    options = {"observation": "full", "sheep": 4}
    worlds = HerdingVecEnv(3, task, max_episode_steps=limit, **options)
    name = f"skydog/{task.capitalize()}-v0"
    alone = [gymnasium.make(name, max_episode_steps=limit, **options) for _ in range(3)]
    worlds.seed(7)
    seen = worlds.reset()
    for world, env in enumerate(alone):
        np.testing.assert_allclose(seen[world], env.reset(seed=7 + world)[0], atol=1e-4)
    acts = np.random.default_rng(0)
    ended = 0
    for _ in range(steps):
        actions = acts.uniform(-1, 1, (3, 2)).astype(np.float32)
        seen, reward, done, infos = worlds.step(actions)
        for world, env in enumerate(alone):
            theirs, pays, terminated, truncated, info = env.step(actions[world])
            assert done[world] == (terminated or truncated)
            assert reward[world] == pytest.approx(pays, abs=1e-4)
            assert {key: infos[world][key] for key in info} == pytest.approx(info, abs=1e-3)
            if done[world]:
                ended += 1
                last = infos[world]["terminal_observation"]
                np.testing.assert_allclose(last, theirs, atol=1e-4)
                assert infos[world]["TimeLimit.truncated"] == truncated
                assert infos[world]["is_success"] == info["success"]
                theirs, _ = env.reset()
            np.testing.assert_allclose(seen[world], theirs, atol=1e-4)
    assert ended == 6


def test_an_accomplished_mission_is_not_truncated_though_its_time_is_over():
    world = preset("paper", arena=4.0, goal=(2, 2), goal_radius=3.9)  # every start is home
    worlds = HerdingVecEnv(20, "herd", world=world, max_episode_steps=1)
    worlds.reset()
    _, _, done, infos = worlds.step(np.zeros((20, 2), np.float32))
    gathered = [info["success"] for info in infos]
    assert done.all()
    assert [info["TimeLimit.truncated"] for info in infos] == [not each for each in gathered]
    assert any(gathered)
    assert not all(gathered)


@pytest.mark.parametrize(
    ("how", "fix"),
    [
        (lambda: HerdingVecEnv(2, autoreset_mode="NextStep"), "leave it out"),
        (lambda: HerdingVecEnv(2, render_mode="human"), "leave it out"),
        (lambda: HerdingVecEnv(2, "fly"), "choose from herd, collect, drive"),
        (lambda: HerdingVecEnv(0), "from 1 to"),
        (lambda: HerdingVecEnv(2).set_attr("arena", 4.0), "make another HerdingVecEnv"),
        (lambda: HerdingVecEnv(2).env_method("render"), "use gymnasium.make"),
    ],
    ids=["autoreset", "render", "task", "none", "set", "method"],
)
def test_what_a_vecenv_cannot_do_is_refused(how, fix):
    with pytest.raises(Refusal, match=fix):
        how()


def test_a_policy_learns_in_a_vecenv_is_evaluated_and_saved_with_its_unit(tmp_path):
    world = preset("paper", arena=4.0)
    starts = cases.cases(world, 5, "anywhere", 3)
    evaluation = Evaluation(world, starts, 512, tmp_path / "evaluation.csv")
    callback = EvaluationCallback(evaluation, "full", keep=tmp_path / "best.zip")
    worlds = VecMonitor(HerdingVecEnv(8, observation="full", max_episode_steps=50))
    policy = {"features_extractor_class": Metres, "features_extractor_kwargs": {"unit": 4.0}}
    ppo = PPO("MlpPolicy", worlds, n_steps=32, batch_size=64, policy_kwargs=policy, seed=0)
    ppo.learn(1_024, callback=callback)
    assert list(evaluation.rows) == [8, 512, 1_024]
    assert evaluation.rows[8]["cases"] == 5
    assert (tmp_path / "evaluation.csv").read_text().count("\n") == 4
    assert len(ppo.ep_info_buffer) >= 8
    best = PPO.load(tmp_path / "best.zip")
    assert best.num_timesteps == evaluation.best
    ppo.save(tmp_path / "ppo.zip")
    again = PPO.load(tmp_path / "ppo.zip")
    seen = worlds.reset()
    acts, theirs = (each.predict(seen, deterministic=True)[0] for each in (ppo, again))
    np.testing.assert_array_equal(acts, theirs)
    assert again.policy.features_extractor.unit == 4.0


def test_a_training_stops_when_enough_missions_succeed():
    world = preset("paper", arena=4.0)
    starts = cases.cases(world, 5, "anywhere", 3)
    callback = EvaluationCallback(Evaluation(world, starts, 8), "full", stop=0.0)
    ppo = PPO("MlpPolicy", HerdingVecEnv(8, observation="full"), n_steps=32, seed=0)
    ppo.learn(1_024, callback=callback)
    assert ppo.num_timesteps == 8
