"""The environments among obstacles."""

import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from skydog import envs
from skydog.errors import Refusal
from skydog.world import obstacles
from skydog.world.home import StraightHome
from skydog.world.presets import preset

with warnings.catch_warnings():  # of PettingZoo, about its own games
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test


clearance = jax.jit(obstacles.clearance)


@pytest.fixture(scope="module")
def pen(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "pen.toml"
    path.write_text("size = [9, 5]\nstart = [5, 1, 8, 4]\ngoal = [1, 4]\nwalls = [[[4, 0], [4, 3]]]")
    return path


@pytest.mark.filterwarnings("error")
def test_gymnasiums_checker_has_nothing_to_say_of_a_scene(monkeypatch, pen):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # it opens a window, too
    env: Any = gymnasium.make("skydog/Herd-v0", scene=pen, render_mode="rgb_array")
    check_env(env.unwrapped)


@pytest.mark.filterwarnings("error")
def test_pettingzoos_test_passes_in_a_scene():
    env = envs.herd_parallel_v0(dogs=2, sheep=4, scene="gate", max_steps=30)
    parallel_api_test(env, num_cycles=60)


def test_many_worlds_at_once_start_outside_obstacles():
    env: Any = gymnasium.make_vec("skydog/Herd-v0", num_envs=16, scene="clutter", sheep=5)
    env.reset(seed=3)
    seen, *_ = env.step(env.action_space.sample())
    assert seen.shape == (16, 4)


def test_an_option_may_place_nobody_within_an_obstacle_or_beyond_a_side(pen):
    env: Any = gymnasium.make("skydog/Herd-v0", scene=pen, sheep=1)
    env.reset(seed=0, options={"sheep": [[3.5, 1.0]]})
    with pytest.raises(Refusal, match=r"'sheep' places one within an obstacle, at \[4.0, 1.0\]"):
        env.reset(options={"sheep": [[4.0, 1.0]]})
    env.reset(options={"dogs": [[4.0, 1.0]]})  # it flies above
    with pytest.raises(Refusal, match="x and y from 0 to 9 m and 5 m, got"):
        env.reset(options={"sheep": [[3.0, 6.0]]})


def test_the_reward_pays_for_the_way_around():
    world = preset("paper", scene="gate")
    around, straight = (
        gymnasium.make("skydog/Herd-v0", world=each)
        for each in (world, replace(world, home=StraightHome()))
    )
    # At the wall, away from its gate: straight home is no way.
    options = {"sheep": [[1.0, 7.0], [1.2, 7.0], [1.0, 7.2]], "dogs": [[0.8, 7.6]]}
    paid = []
    for env in (around, straight):
        env.reset(seed=0, options=options)
        paid.append(sum(float(env.step(np.zeros(2, np.float32))[1]) for _ in range(15)))
    assert np.isfinite(paid).all()
    assert paid[0] != pytest.approx(paid[1], abs=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scene": "labyrinth"}, "no scene is called 'labyrinth'"),
        ({"scene": "gate", "world": preset("paper")}, "takes the place of preset, scene and arena"),
    ],
    ids=["name", "world"],
)
def test_a_scene_that_cannot_be_is_refused(options, said):
    with pytest.raises(Refusal, match=said):
        gymnasium.make("skydog/Herd-v0", **options)


@pytest.mark.parametrize("name", ["Collect", "Drive"])
def test_a_lesson_has_no_obstacles(name):
    with pytest.raises((Refusal, TypeError), match="scene|obstacles"):
        gymnasium.make(f"skydog/{name}-v0", scene="gate").reset()
    with pytest.raises(Refusal, match="a lesson has no obstacles; take a world without a scene"):
        gymnasium.make(f"skydog/{name}-v0", world=preset("paper", scene="gate"))


def test_a_whole_episode_leaves_no_sheep_inside_a_wall():
    env: Any = gymnasium.make("skydog/Herd-v0", scene="clutter", observation="full").unwrapped
    seen, _ = env.reset(seed=5)
    world = env.task.world
    goal = np.array([world.arena.goal_x, world.arena.goal_y])
    for _ in range(150):
        stray = int(np.argmax(np.linalg.norm(seen[:6].reshape(3, 2), axis=1)))
        seen, *_ = env.step(np.sign(seen[2 * stray : 2 * stray + 2]))
        sheep = seen[:6].reshape(3, 2) - seen[6:8] + goal
        assert float(jnp.min(clearance(world.obstacles, jnp.asarray(sheep)))) > -1e-4
