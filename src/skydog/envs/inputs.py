"""What an environment is given: actions, seeds and options, checked before anything moves."""

from operator import index
from typing import Any

import numpy as np
from gymnasium.error import InvalidAction

from skydog.envs.tasks import LessonTask, Task
from skydog.errors import Refusal


def action(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """An action as float32. Raises `InvalidAction` for another shape, or what is no number."""
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "fiu":
            raise ValueError
        with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
            numbers = given.astype(np.float32)
    except (TypeError, ValueError):
        raise InvalidAction(
            f"an action is numbers from -1 to 1 of shape {shape}, got {_short(value)}; "
            "try env.action_space.sample()"
        ) from None
    if numbers.shape != shape:
        raise InvalidAction(
            f"an action has the shape {shape}, got {numbers.shape}; try env.action_space.sample()"
        )
    if not np.all(np.isfinite(numbers)):
        raise InvalidAction(f"an action is finite, got {_short(value)}; has the learner diverged?")
    return numbers


def seed(value: Any) -> int:
    """A seed. Raises `Refusal` for what is no whole number from 0 on; it counts modulo 2³²."""
    try:
        number = index(value)
    except TypeError:
        number = -1
    if number < 0:
        raise Refusal(f"a seed is a whole number from 0 on, got {_short(value)}; try seed=0")
    return number


def given(options: Any) -> dict[str, Any]:
    """The options of `reset`, none if it was given none. Raises `Refusal` for what is no dict."""
    if options is not None and not isinstance(options, dict):
        raise Refusal(f"the options of reset are a dict, got {_short(options)}; leave them out")
    return dict(options or {})


def placed(task: Task, options: Any) -> dict[str, np.ndarray]:
    """Where `reset` is to place `sheep` and `dogs`, in metres.

    Raises `Refusal` for an unknown option, another number of them, or a place out of bounds.
    """
    arena, dog = task.world.arena, task.world.dog
    size, beyond = float(arena.size), float(dog.airspace)
    bounds = {"sheep": (task.sheep, 0.0, size), "dogs": (task.dogs, -beyond, size + beyond)}
    if isinstance(task, LessonTask):  # it draws the arena too
        bounds = {}
    where = {}
    for name, value in given(options).items():
        if name not in bounds:
            choices = ", ".join(bounds) or "none: a lesson draws its start"
            raise Refusal(f"reset has no option {name!r}; choose from {choices}")
        count, low, high = bounds[name]
        try:
            where[name] = np.asarray(value, np.float32)
        except (TypeError, ValueError):
            where[name] = np.full((count, 2), np.nan, np.float32)
        inside = (low <= where[name]) & (where[name] <= high)
        if where[name].shape != (count, 2) or not inside.all():
            raise Refusal(
                f"the option {name!r} places {count}, x and y from {low:g} to {high:g} m each, "
                f"got {_short(value)}"
            )
    return where


def _short(value: Any) -> str:
    text = repr(value).replace("\n", " ")
    return text if len(text) <= 60 else text[:57] + "..."
