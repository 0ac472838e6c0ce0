"""The environments among obstacles."""

import warnings
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from skydog import envs
from skydog.envs import tasks
from skydog.errors import Refusal
from skydog.world import herding, obstacles
from skydog.world.presets import preset

with warnings.catch_warnings():  # of PettingZoo, about its own games
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test


pytestmark = pytest.mark.usefixtures("unchecked")

clearance = jax.jit(obstacles.clearance)
distance = jax.jit(lambda home, places: home.field.at(places)[0])


PEN = """
size = [9, 5]
start = [5, 1, 8, 4]
goal = [1, 4]
walls = [[[4, 0], [4, 3]]]
"""


@pytest.fixture(scope="module")
def pen(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "pen.toml"
    path.write_text(
        "size = [9, 5]\nstart = [5, 1, 8, 4]\ngoal = [1, 4]\nwalls = [[[4, 0], [4, 3]]]"
    )
    return path


@pytest.fixture
def env(pen) -> Any:
    return gymnasium.make("skydog/Herd-v0", scene=pen, observation="full").unwrapped


@pytest.mark.filterwarnings("error")
def test_gymnasiums_checker_has_nothing_to_say_of_a_scene(monkeypatch, pen):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # it opens a window, too
    options: Any = {"observation": "full", "render_mode": "rgb_array"}
    check_env(gymnasium.make("skydog/Herd-v0", scene=pen, **options).unwrapped)


@pytest.mark.filterwarnings("error")
def test_pettingzoos_test_passes_in_a_scene(pen):
    env = envs.herd_parallel_v0(dogs=2, sheep=4, scene=pen, max_steps=30)
    parallel_api_test(env, num_cycles=60)


def placed(seen):
    """Where the sheep are, by what the dog sees of them and of the goal. Metres."""
    return seen[:6].reshape(3, 2) - seen[6:8] + np.array([1.0, 4.0], np.float32)


def test_an_option_may_place_nobody_within_an_obstacle_or_beyond_a_side(env):
    three = [[3.5, 1.0], [3.0, 1.0], [3.0, 2.0]]
    seen, _ = env.reset(seed=0, options={"sheep": three})
    np.testing.assert_allclose(placed(seen), three, atol=1e-5)
    with pytest.raises(Refusal, match=r"'sheep' places one within an obstacle, at \[4.0, 1.0\]"):
        env.reset(options={"sheep": [*three[:2], [4.0, 1.0]]})
    env.reset(options={"dogs": [[4.0, 1.0]]})  # it flies above
    with pytest.raises(Refusal, match="x and y from 0 to 9 m and 5 m, got"):
        env.reset(options={"sheep": [*three[:2], [3.0, 6.0]]})


def test_a_mission_pays_for_the_metres_around_and_no_sheep_is_ever_inside_a_wall(env):
    world = env.task.world

    def left(seen):
        sheep = jnp.asarray(placed(seen))
        assert float(clearance(world.obstacles, sheep).min()) > -1e-4
        stray = np.linalg.norm(sheep - np.mean(sheep, axis=0), axis=1).max()
        beyond = max(stray - float(herding.gathered_radius(world, 3)), 0.0)
        return float(distance(world.home, sheep).mean()) + beyond

    # At the wall, and the dog behind them: they go along it, and by its end.
    options = {"sheep": [[4.3, 1.0], [4.4, 1.6], [4.3, 2.2]], "dogs": [[4.6, 0.2]]}
    seen, _ = env.reset(seed=0, options=options)
    before = after = left(seen)
    paid = 0.0
    for _ in range(40):
        seen, reward, *_ = env.step(np.array([0.0, 0.3], np.float32))
        paid += float(reward) + tasks.STEP_COST
        after = left(seen)
    assert paid == pytest.approx(before - after, abs=1e-3)
    assert before - after > 0.3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scene": "labyrinth"}, "no scene is called 'labyrinth'"),
        ({"scene": "gate", "world": preset("paper")}, "takes the place of preset, scene, arena"),
    ],
    ids=["name", "world"],
)
def test_a_scene_that_cannot_be_is_refused(options, said):
    with pytest.raises(Refusal, match=said):
        gymnasium.make("skydog/Herd-v0", **options)


@pytest.mark.parametrize("name", ["Collect", "Drive"])
def test_a_lesson_has_no_obstacles(name):
    with pytest.raises((Refusal, TypeError), match=r"scene|obstacles"):
        gymnasium.make(f"skydog/{name}-v0", scene="gate").reset()
    with pytest.raises(Refusal, match="a lesson has no obstacles; take a world without a scene"):
        gymnasium.make(f"skydog/{name}-v0", world=preset("paper", scene="gate"))
