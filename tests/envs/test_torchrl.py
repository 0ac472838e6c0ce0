# pyright: reportMissingImports=false
"""A real client: TorchRL's own checker, and its rollouts. `make peers` runs them."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("torchrl", reason="TorchRL is not installed here; make peers runs these")
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torchrl.envs import GymEnv, GymWrapper, PettingZooWrapper, check_env_specs

from skydog.envs import herd_parallel_v0

NAMES = ("skydog/Herd-v0", "skydog/Collect-v0", "skydog/Drive-v0")
MODES = (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED)
# Worlds end at different steps: by arrival, or after 30.
OPTIONS = {"reward": "paper", "max_episode_steps": 30}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("observation", ["compact", "full"])
def test_torchrls_checker_has_nothing_to_say(name, observation):
    check_env_specs(GymEnv(name, observation=observation))
    print(f"torchrl check_env_specs: nothing to say of {name}, {observation}")


@pytest.mark.parametrize("mode", MODES)
def test_torchrls_checker_has_nothing_to_say_of_worlds_stepped_together(mode):
    for name in NAMES:
        check_env_specs(GymWrapper(gymnasium.make_vec(name, num_envs=3, autoreset_mode=mode)))
        print(f"torchrl check_env_specs: nothing to say of 3 × {name}, {mode.value}")


@pytest.mark.filterwarnings("ignore:PettingZoo in TorchRL is tested using version")
def test_torchrls_checker_has_nothing_to_say_of_several_dogs():
    check_env_specs(PettingZooWrapper(herd_parallel_v0(dogs=3)))
    print("torchrl check_env_specs: nothing to say of herd_parallel_v0, 3 dogs")


@pytest.mark.parametrize("mode", MODES)
def test_a_rollout_by_torchrl_resets_where_an_episode_ends_and_keeps_its_last_observation(mode):
    together = gymnasium.make_vec("skydog/Drive-v0", num_envs=3, autoreset_mode=mode, **OPTIONS)
    alone = [lambda: gymnasium.make("skydog/Drive-v0", **OPTIONS)] * 3
    ours, theirs = rollout(together), rollout(SyncVectorEnv(alone, autoreset_mode=mode))
    for key in ("observation", ("next", "observation"), ("next", "reward"), ("next", "done")):
        np.testing.assert_allclose(ours[key], theirs[key], atol=2e-4)
    ended = ours["next", "done"][:, :-1, 0]
    before, after = ours["next", "observation"][:, :-1], ours["observation"][:, 1:]
    assert 3 <= ended.sum() < ended.numel()
    assert (ended.any(0) != ended.all(0)).any()  # not all at the same step
    assert torch.equal(before[~ended], after[~ended])
    assert (before[ended] != after[ended]).any(-1).all()


def rollout(worlds):
    """What TorchRL records of 80 steps of dogs that fly to their subgoals."""
    env = GymWrapper(worlds)
    env.set_seed(5)
    return env.rollout(80, policy=to_subgoal, break_when_any_done=False)


def to_subgoal(tensordict):
    return tensordict.set("action", (-9 * tensordict["observation"][..., 2:]).clamp(-1, 1))
