import sys
from typing import Any

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled, InvalidAction, ResetNeeded

import skydog
from skydog import envs
from skydog.errors import Refusal
from skydog.world import mission


def played(env, seed, steps=120):
    """Everything that an environment says in some episodes of aimless dogs."""
    for number, name in enumerate(env.possible_agents):
        env.action_space(name).seed(seed + number)
    said = [env.reset(seed=seed)]
    for _ in range(steps):
        if not env.agents:
            said.append(env.reset())
        said.append(env.step({name: env.action_space(name).sample() for name in env.agents}))
    return said


def same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            same(one[name], other[name])
    elif isinstance(one, tuple | list):
        for mine, yours in zip(one, other, strict=True):
            same(mine, yours)
    else:
        assert np.array_equal(one, other)


def test_a_seed_tells_all_that_follows_over_several_episodes():
    one = played(envs.herd_parallel_v0(dogs=3, preset="strombom2014", max_steps=40), seed=5)
    other = played(envs.herd_parallel_v0(dogs=3, preset="strombom2014", max_steps=40), seed=5)
    same(one, other)
    different = played(envs.herd_parallel_v0(dogs=3, preset="strombom2014", max_steps=40), seed=6)
    assert not np.array_equal(one[0][0]["dog_0"], different[0][0]["dog_0"])
    assert not np.array_equal(one[0][0]["dog_0"], one[41][0]["dog_0"])


def test_dogs_that_fly_the_rule_herd_as_a_rollout_does():
    env: Any = envs.herd_parallel_v0(dogs=3, sheep=6, arena=8.0)
    env.reset(seed=1)
    world, start = env.task.world, env._env.episode.state
    trace = mission.rollout(world, skydog.Strombom(), start, 40)
    for _ in range(40):
        velocity = skydog.Strombom()(world, env._env.episode.state) / world.dog.speed
        env.step(dict(zip(env.agents, np.asarray(velocity), strict=True)))
    end = env._env.episode.state
    np.testing.assert_allclose(end.sheep, trace.sheep[-1], atol=1e-3)
    np.testing.assert_allclose(end.dogs, trace.dogs[-1], atol=1e-3)


def test_each_dog_sees_the_others_and_the_flock_from_where_it_is():
    env = envs.herd_parallel_v0(dogs=3, observation="full")
    dogs = [[0.0, 1.0], [3.0, 1.0], [2.0, 4.0]]
    sheep = [[1.0, 2.0], [2.0, 2.0], [2.0, 3.0]]
    seen, _ = env.reset(seed=0, options={"sheep": sheep, "dogs": dogs})
    expected = np.array([*sheep, [0.0, 0.0], dogs[2], dogs[0]]) - dogs[1]
    np.testing.assert_allclose(seen["dog_1"], expected.ravel(), atol=1e-6)


def test_running_out_of_time_truncates_all_and_ends_the_episode():
    env = envs.herd_parallel_v0(dogs=2, max_steps=3)
    env.reset(seed=0)
    still = {name: np.zeros(2, np.float32) for name in env.agents}
    for _ in range(2):
        *_, truncated, _ = env.step(still)
        assert not any(truncated.values())
    _, _, terminated, truncated, _ = env.step(still)
    assert all(truncated.values())
    assert not any(terminated.values())
    with pytest.raises(ResetNeeded, match=r"env\.reset\(\)"):
        env.step({})


def test_it_is_drawn_with_all_its_dogs():
    env: Any = envs.herd_parallel_v0(dogs=3, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (480, 480, 3)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ({"dog_0": np.zeros(2)}, "dog_1"),
        ({"dog_0": np.zeros(2), "dog_1": np.zeros(2), "cat": np.zeros(2)}, "cat"),
        ({"dog_0": np.zeros(2), "dog_1": np.zeros(3)}, "shape"),
        ({"dog_0": np.zeros(2), "dog_1": np.full(2, np.nan)}, "finite"),
    ],
)
def test_a_bad_action_is_an_invalid_action(actions, message):
    env = envs.herd_parallel_v0(dogs=2)
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match=message):
        env.step(actions)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dogs": 0}, "dogs must be"),
        ({"dogs": 10**7}, "from 1 to 1,000"),
        ({"max_steps": 0}, "max_steps must be"),
        ({"world": "paper"}, r"skydog\.preset"),
    ],
)
def test_a_bad_option_is_refused_with_the_remedy(options, message):
    with pytest.raises(Refusal, match=message):
        envs.herd_parallel_v0(**options)


def test_a_missing_pettingzoo_is_told_with_the_line_to_type(monkeypatch):
    monkeypatch.delitem(sys.modules, "skydog.envs.parallel")
    monkeypatch.setitem(sys.modules, "pettingzoo", None)
    with pytest.raises(DependencyNotInstalled, match=r"pip install 'skydog\[pettingzoo\]'"):
        envs.herd_parallel_v0()
