"""What an environment shows: pictures as arrays, or a window."""

import os
from collections import deque
from typing import Any, ClassVar

import jax
import numpy as np
from gymnasium.error import DependencyNotInstalled, UnsupportedMode

from skydog.envs.tasks import EnvState, Task
from skydog.errors import short

PIXELS = 480  # the side of a picture
TRAIL = 200  # instants that a trail shows, so that a frame of a long episode costs no more


class Renderer:
    """Remembers the trails of an episode, and draws it; without a render mode does nothing."""

    def __init__(self, task: Task, mode: str | None, metadata: dict[str, Any]):
        """Raises `UnsupportedMode` for a mode that there is not, or a window without a display."""
        modes = metadata["render_modes"]
        if mode is not None and not (isinstance(mode, str) and mode in modes):
            given = short(mode)
            raise UnsupportedMode(f"no render_mode is called {given}; choose from {modes}, None")
        self._task, self._mode, self._rate = task, mode, metadata["render_fps"]
        self._window = _Window(PIXELS) if mode == "human" else None
        self._env: Any = None  # the latest instant, an `EnvState`
        self._trail: deque[Any] = deque(maxlen=TRAIL)  # where sheep and dogs were, and are
        self._draw: Any = None

    def reset(self, env: EnvState) -> None:
        """Forget the episode before."""
        self._trail.clear()
        self._draw = None
        self.add(env)

    def add(self, env: EnvState) -> None:
        """Remember an instant, and show it if there is a window."""
        if self._mode is None:
            return
        self._env = env
        self._trail.append(jax.device_get((env.episode.state.sheep, env.episode.state.dogs)))
        if self._window is not None:
            self._window.show(self._drawn(), self._rate)

    def frame(self) -> np.ndarray | None:
        """The latest instant, 480 pixels a side; None where a window shows it, or nothing does."""
        return self._drawn() if self._mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def __getstate__(self) -> dict[str, Any]:
        # What draws is made anew where it is needed; a window stays where it is.
        return self.__dict__ | {"_draw": None, "_window": None}

    def _drawn(self) -> np.ndarray:
        from skydog.view.animation import stage

        world, state, subgoal, drives, success = _scene(self._task, self._env)
        if self._draw is None:
            self._draw = stage(world, len(state.sheep), len(state.dogs), PIXELS)
        sheep, dogs = (np.stack(places) for places in zip(*self._trail, strict=True))
        title, step = "accomplished" if success else "", int(self._env.episode.step)
        return self._draw(sheep, dogs, np.asarray(subgoal), np.asarray(drives), title, step)


class _Window:
    """A window of pygame's, which is what Gymnasium's own environments open.

    pygame has one: a second environment's takes the place of the first's.
    """

    latest: ClassVar["_Window | None"] = None

    def __init__(self, pixels: int):
        try:
            import pygame
        except ModuleNotFoundError:
            raise DependencyNotInstalled(
                "render_mode=\"human\" needs pygame; run: pip install 'skydog[window]'"
            ) from None
        self._pygame = pygame
        try:
            pygame.display.init()
            # Where SDL finds no display it draws into the void, unless it was asked to.
            if pygame.display.get_driver() == "offscreen" and not os.environ.get("SDL_VIDEODRIVER"):
                pygame.display.quit()
                raise pygame.error("there is none")
            self._screen = pygame.display.set_mode((pixels, pixels))
        except pygame.error as problem:
            raise UnsupportedMode(
                f'render_mode="human" needs a display ({problem}); '
                'try render_mode="rgb_array", or set SDL_VIDEODRIVER=dummy'
            ) from None
        pygame.display.set_caption("skydog")
        _Window.latest = self
        self._clock = pygame.time.Clock()

    def show(self, picture: np.ndarray, rate: int) -> None:
        """Put a picture on the screen, no sooner than its time has come."""
        pygame = self._pygame
        if not self._open():
            return
        surface = pygame.surfarray.make_surface(picture.swapaxes(0, 1))
        self._screen.blit(surface, (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(rate)

    def close(self) -> None:
        """Close it; twice does no harm, nor if another window has taken its place."""
        if self._open():
            self._pygame.display.quit()

    def _open(self) -> bool:
        return _Window.latest is self and self._pygame.display.get_init()


@jax.jit
def _scene(task, env):
    return task.scene(env.episode)
