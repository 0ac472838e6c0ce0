import importlib
import re
import sys
from typing import Any

import equinox as eqx
import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded, UnsupportedMode
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import skydog
import skydog.envs
from skydog.errors import Refusal

COUNT = 5
MODES = list(AutoresetMode)


def native(name, mode=AutoresetMode.NEXT_STEP, count=COUNT, **options) -> Any:
    return gymnasium.make_vec(f"skydog/{name}", num_envs=count, autoreset_mode=mode, **options)


def one_by_one(name, mode, **options):
    make = [lambda: gymnasium.make(f"skydog/{name}", **options) for _ in range(COUNT)]
    return SyncVectorEnv(make, autoreset_mode=mode)


def same(ours, theirs):
    if theirs is None:
        assert ours is None
    elif isinstance(theirs, dict):
        assert set(ours) == set(theirs)
        for name in theirs:
            same(ours[name], theirs[name])
    elif isinstance(theirs, tuple) or theirs.dtype == object:
        for mine, yours in zip(ours, theirs, strict=True):
            same(mine, yours)
    else:
        assert ours.dtype == theirs.dtype
        np.testing.assert_allclose(ours.astype(np.float64), theirs.astype(np.float64), atol=2e-5)


WIDE = eqx.tree_at(lambda world: world.arena.goal_radius, skydog.preset(), 4.5)


# Both ends of an episode come up: a short time limit, and a goal so wide that some are soon home.
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("Herd-v0", {"max_episode_steps": 7}),
        ("Herd-v0", {"world": WIDE, "observation": "full", "max_episode_steps": 12}),
        ("Drive-v0", {"max_episode_steps": 9}),
        ("Collect-v0", {"reward": "paper", "max_episode_steps": 20, "sheep": 4}),
    ],
)
def test_worlds_stepped_together_do_what_each_does_by_itself(name, mode, options):
    together, alone = native(name, mode, **options), one_by_one(name, mode, **options)
    same(together.reset(seed=3), alone.reset(seed=3))
    chance = np.random.default_rng(0)
    ended = home = 0
    for _ in range(25):
        actions = chance.uniform(-1, 1, (COUNT, 2)).astype(np.float32)
        ours, theirs = together.step(actions), alone.step(actions)
        same(ours, theirs)
        over = ours[2] | ours[3]
        ended, home = ended + over.sum(), home + ours[2].sum()
        if mode is AutoresetMode.DISABLED and over.any():
            same(
                together.reset(options={"reset_mask": over.copy()})[0],
                alone.reset(options={"reset_mask": over.copy()})[0],
            )
    assert ended
    assert bool(home) == ("world" in options)


@pytest.mark.parametrize("mode", MODES)
def test_the_mode_is_told_in_both_places_where_others_look_for_it(mode):
    worlds = native("Drive-v0", mode.value)
    assert worlds.metadata["autoreset_mode"] is worlds.autoreset_mode is mode


def test_the_native_worlds_are_what_make_vec_picks():
    worlds = gymnasium.make_vec("skydog/Drive-v0", num_envs=1024)
    assert type(worlds).__name__ == "HerdingVectorEnv"
    seen, _ = worlds.reset(seed=0)
    assert seen.shape == (1024, 4)
    assert worlds.observation_space.contains(seen)
    for _ in range(52):
        seen, *rest, _ = worlds.step(worlds.action_space.sample())
        assert worlds.observation_space.contains(seen)
        assert [part.shape for part in rest] == [(1024,)] * 3


def test_gymnasiums_own_wrapper_counts_what_we_count():
    worlds = RecordEpisodeStatistics(native("Drive-v0", AutoresetMode.SAME_STEP))
    worlds.reset(seed=0)
    info = {}
    for _ in range(50):
        *_, info = worlds.step(worlds.action_space.sample())
    assert info["episode"]["l"].tolist() == [50] * COUNT


def test_what_is_handed_out_is_the_callers_to_change():
    worlds = native("Herd-v0")
    first, _ = worlds.reset(seed=0)
    kept = first.copy()
    seen, *_ = worlds.step(np.zeros((COUNT, 2), np.float32))
    seen[:] = 0.0
    assert np.array_equal(first, kept)


def test_seeds_may_be_one_for_each_world():
    worlds = native("Herd-v0")
    counted, _ = worlds.reset(seed=3)
    named, _ = worlds.reset(seed=[3, 4, 5, 6, 7])
    assert np.array_equal(counted, named)
    assert np.array_equal(worlds.reset(seed=np.array(3))[0], named)
    assert not np.array_equal(worlds.reset()[0], named)


def test_worlds_outside_the_first_mask_begin_each_on_its_own():
    worlds = native("Herd-v0", AutoresetMode.DISABLED)
    half = np.arange(COUNT) < 2
    worlds.reset(options={"reset_mask": half})
    seen, _ = worlds.reset(options={"reset_mask": ~half})
    assert len(np.unique(seen, axis=0)) == COUNT


# Bad input


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(2, np.float32), "shape"),
        (np.zeros((COUNT, 3), np.float32), "shape"),
        (np.full((COUNT, 2), np.nan), "finite"),
        (np.full((COUNT, 2), "x"), "numbers"),
    ],
)
def test_bad_actions_are_invalid_and_move_nobody(actions, message):
    worlds = native("Herd-v0")
    worlds.reset(seed=0)
    with pytest.raises(InvalidAction, match=message):
        worlds.step(actions)
    *_, info = worlds.step(np.zeros((COUNT, 2), np.float32))
    assert info["steps"].tolist() == [1] * COUNT


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "num_envs must be"),
        ({"count": 10**12}, "from 1 to 1,048,576"),
        ({"count": 2**20, "sheep": 30, "arena": 9.0}, "num_envs, with 30 sheep, must be"),
        ({"mode": "never"}, "choose from NextStep, SameStep, Disabled"),
        ({"max_episode_steps": 0}, "max_episode_steps must be"),
        ({"sheep": -1}, "sheep must be"),
        ({"observation": "all"}, "compact, full"),
    ],
)
def test_a_bad_option_is_refused_with_the_remedy(options, message):
    with pytest.raises(Refusal, match=re.escape(message)):
        native("Herd-v0", **options)


def test_what_cannot_be_done_is_said():
    with pytest.raises(UnsupportedMode, match="sync"):
        native("Herd-v0", render_mode="rgb_array")
    worlds = native("Drive-v0", AutoresetMode.DISABLED)
    with pytest.raises(ResetNeeded, match="reset"):
        worlds.step(np.zeros((COUNT, 2), np.float32))
    worlds.reset(seed=0)
    for _ in range(50):
        worlds.step(np.zeros((COUNT, 2), np.float32))
    with pytest.raises(ResetNeeded, match="reset_mask"):
        worlds.step(np.zeros((COUNT, 2), np.float32))
    for seed in (-1, [1, 2, 3, 4, -5], [0.5] * COUNT, "7"):
        before = worlds._seeds.copy()
        with pytest.raises(Refusal, match="whole number from 0 on"):
            worlds.reset(seed=seed)
        assert np.array_equal(worlds._seeds, before)
    with pytest.raises(Refusal, match="as many seeds"):
        worlds.reset(seed=[1, 2])
    with pytest.raises(Refusal, match="reset_mask"):
        worlds.reset(options={"cat": 1})
    with pytest.raises(Refusal, match="array of bool"):
        worlds.reset(options={"reset_mask": [True] * COUNT})
    with pytest.raises(Refusal, match="one world at least"):
        worlds.reset(options={"reset_mask": np.zeros(COUNT, bool)})


def test_without_stable_baselines3_its_vecenv_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "skydog.envs.sb3", raising=False)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[sb3\]'"):
        importlib.import_module("skydog.envs.sb3")
