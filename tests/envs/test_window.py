import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import UnsupportedMode

import skydog.envs
from skydog.envs import window

NAMES = ("skydog/Herd-v0", "skydog/Collect-v0", "skydog/Drive-v0")
STILL = np.zeros(2, np.float32)


def make(name, **options) -> Any:
    return gymnasium.make(name, **options)


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_shows_the_dog_where_it_flies(name):
    env = make(name, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(10):
        env.step(np.array([1.0, 1.0], np.float32))
    second = env.render()
    assert first.shape == second.shape == (480, 480, 3)
    assert first.dtype == np.uint8
    assert (first != second).any()


def test_a_picture_shows_where_the_dog_has_come_from():
    env = make("skydog/Herd-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=0, options={"dogs": [[1.0, 1.0]]})
    for _ in range(10):
        env.step(np.array([1.0, 0.0], np.float32))
    flown, state = env.render(), env._env.episode.state
    env.reset(options={"dogs": state.dogs, "sheep": state.sheep})
    ground = slice(60, None)  # below the title, which counts the steps
    assert (flown[ground] != env.render()[ground]).any()


def test_what_an_episode_keeps_for_its_pictures_stops_growing():
    env = make("skydog/Herd-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    kept = []
    for _ in range(3):
        for _ in range(window.TRAIL):
            env.step(STILL)
        kept.append(len(pickle.dumps(env._renderer)))
    assert kept[0] == kept[1] == kept[2]


def test_a_window_opens_shows_and_closes(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    env = make("skydog/Drive-v0", render_mode="human")
    env.reset(seed=0)
    env.step(STILL)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    assert shown.shape == (480, 480, 3)
    assert len(np.unique(shown)) > 10
    assert env.render() is None
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_a_second_window_takes_the_place_of_the_first_and_outlives_it(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    first = make("skydog/Drive-v0", render_mode="human")
    first.reset(seed=0)
    second = make("skydog/Drive-v0", render_mode="human")
    second.reset(seed=1)
    first.step(STILL)
    first.close()
    second.step(STILL)
    assert len(np.unique(pygame.surfarray.array3d(pygame.display.get_surface()))) > 10
    second.close()
    assert not pygame.display.get_init()


def test_a_window_without_a_display_names_the_remedy(monkeypatch):
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    with pytest.raises(UnsupportedMode, match="rgb_array"):
        make("skydog/Drive-v0", render_mode="human")


def test_a_window_that_sdl_would_draw_into_the_void_names_the_remedy(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    monkeypatch.delenv("SDL_VIDEODRIVER")
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    with pytest.raises(UnsupportedMode, match="SDL_VIDEODRIVER=dummy"):
        make("skydog/Drive-v0", render_mode="human")


def test_an_environment_that_has_drawn_can_be_pickled_and_goes_on_alike():
    env = make("skydog/Herd-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=1)
    before = env.render()
    again = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(again.render(), before)
    np.testing.assert_array_equal(again.step(STILL)[0], env.step(STILL)[0])


def test_an_unknown_render_mode_names_those_there_are():
    with pytest.raises(UnsupportedMode, match="rgb_array"):
        skydog.envs.single.HerdingEnv(render_mode="smell")  # pyright: ignore
