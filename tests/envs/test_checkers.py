"""What the libraries' own checkers say; `make peers` shows their verdicts, SB3's among them."""

import warnings
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

from skydog import envs

with warnings.catch_warnings():  # of PettingZoo, about its own games
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test

NAMES = ("skydog/Herd-v0", "skydog/Collect-v0", "skydog/Drive-v0")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("observation", ["compact", "full"])
def test_gymnasiums_checker_has_nothing_to_say(monkeypatch, name, observation):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # it opens a window, too
    env: Any = gymnasium.make(name, observation=observation, render_mode="rgb_array")
    check_env(env.unwrapped)
    print(f"gymnasium.utils.env_checker.check_env: nothing to say of {name}, {observation}")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("dogs", [1, 3])
@pytest.mark.parametrize("observation", ["compact", "full"])
def test_pettingzoos_test_passes(dogs, observation):
    env = envs.herd_parallel_v0(dogs=dogs, sheep=5, observation=observation, max_steps=60)
    parallel_api_test(env, num_cycles=150)
