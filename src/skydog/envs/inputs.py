"""What an environment is given, checked before anything moves: options, actions and seeds."""

from collections.abc import Collection
from operator import index
from typing import Any

import numpy as np
from gymnasium.error import InvalidAction

from skydog.errors import Refusal, short


def count(value: Any, what: str, most: int) -> int:
    """A number of things, if it is a whole one from 1 to `most`. Raises `Refusal`."""
    number = _whole(value)
    if number is None or not 1 <= number <= most:
        raise Refusal(f"{what} must be a whole number from 1 to {most:,}, got {short(value)}")
    return number


def choice(value: Any, words: Collection[str], what: str) -> Any:
    """A word, if it is one of those. Raises `Refusal`, which lists them."""
    if not isinstance(value, str) or value not in words:
        raise Refusal(f"no {what} is called {short(value)}; choose from {', '.join(words)}")
    return value


def action(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """An action as float32. Raises `InvalidAction` for another shape, or what is no number."""
    given = numbers(value)
    if given is None:
        raise InvalidAction(
            f"an action is numbers from -1 to 1 of shape {shape}, got {short(value)}; "
            "try env.action_space.sample()"
        )
    if given.shape != shape:
        raise InvalidAction(
            f"an action has the shape {shape}, got {given.shape}; try env.action_space.sample()"
        )
    if not np.all(np.isfinite(given)):
        raise InvalidAction(f"an action is finite, got {short(value)}; has the learner diverged?")
    return given


def seed(value: Any) -> int:
    """A seed. Raises `Refusal` for what is no whole number from 0 on; it counts modulo 2³²."""
    number = _whole(value)
    if number is None or number < 0:
        raise Refusal(f"a seed is a whole number from 0 on, got {short(value)}; try seed=0")
    return number


def seeds(value: Any, worlds: int) -> list[int | None]:
    """A seed for each world: those of a list, or from a number on. Raises `Refusal`."""
    if value is None:
        return [None] * worlds
    given = _array(value)
    if not isinstance(value, list | tuple) and (given is None or given.ndim != 1):
        first = seed(value)
        return [first + world for world in range(worlds)]
    if len(value) != worlds:
        raise Refusal(f"{worlds} worlds take as many seeds, got {len(value)}; try seed=0")
    return [None if one is None else seed(one) for one in value]


def options(value: Any) -> dict[str, Any]:
    """The options of `reset`, none if it was given none. Raises `Refusal` for what is no dict."""
    if value is not None and not isinstance(value, dict):
        raise Refusal(f"the options of reset are a dict, got {short(value)}; leave them out")
    return dict(value or {})


def places(value: Any, name: str, count: int, low: float, high: tuple[float, float]) -> np.ndarray:
    """Where `count` of them are, x and y in metres, as float32. Raises `Refusal`."""
    given = numbers(value)
    if given is None or given.shape != (count, 2) or not np.all((low <= given) & (given <= high)):
        wide, tall = high
        most = f"{wide:g} m each" if wide == tall else f"{wide:g} m and {tall:g} m"
        raise Refusal(
            f"the option {name!r} places {count}, x and y from {low:g} to {most}, "
            f"got {short(value)}"
        )
    return given


def mask(value: Any, worlds: int) -> np.ndarray:
    """Which worlds to reset, one at least. Raises `Refusal`."""
    if not isinstance(value, np.ndarray) or value.dtype != np.bool_:
        raise Refusal(
            f"options['reset_mask'] is an array of bool, got {short(value)}; "
            "try terminated | truncated"
        )
    if value.shape != (worlds,) or not value.any():
        raise Refusal(
            f"options['reset_mask'] has the shape ({worlds},) and names one world at "
            f"least, got the shape {value.shape} and {int(value.sum())} of them"
        )
    return value


def numbers(value: Any) -> np.ndarray | None:
    """An array of float32, infinite where it overflows; None for what is no array of numbers."""
    given = _array(value)
    if given is None or given.dtype.kind not in "fiu":
        return None
    with np.errstate(over="ignore"):
        return given.astype(np.float32)


def _whole(value: Any) -> int | None:
    """A whole number; None for what is none, as `True` is, though Python counts with it."""
    try:
        return None if isinstance(value, bool) else index(value)
    except Exception:  # whatever another library's numbers raise
        return None


def _array(value: Any) -> np.ndarray | None:
    try:
        return np.asarray(value)
    except Exception:  # ragged lists; and whatever another library's arrays raise
        return None
