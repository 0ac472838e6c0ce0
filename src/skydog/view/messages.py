"""The messages of a page of the live view, each value checked and within bounds."""

import json
from collections.abc import Callable, Sequence
from typing import Any

from skydog.errors import Refusal
from skydog.view.session import ALONG, HOVER, SPEEDS, TOWARD

MOST_SHEEP, MOST_DOGS = 200, 8
LONGEST_ARENA = 1000.0  # metres
CASES = 2**31 - 1
LONGEST = 4096  # characters of a message that are read

Check = Callable[[Any], Any]


def parse(
    message: str | bytes, policies: list[str], worlds: list[str], scenes: Sequence[str] = ()
) -> dict[str, Any]:
    """A message of a page, its values checked. Raises `Refusal` for anything else."""
    if isinstance(message, bytes):
        raise Refusal("a message is text; send JSON, not bytes")
    if len(message) > LONGEST:
        raise Refusal(f"a message has at most {LONGEST} characters, got {len(message)}")
    try:
        said = json.loads(message)
    except (ValueError, RecursionError):
        raise Refusal(f"a message is JSON, got {short(message)}") from None
    if not isinstance(said, dict):
        raise Refusal(f'a message is an object such as {{"sheep": 5}}, got {short(message)}')
    checks = _CHECKS | {
        "policy": _choice("policy", policies),
        "preset": _choice("preset", worlds),
        "scene": _choice("scene", [None, *scenes]),
    }
    unknown = sorted(set(said) - set(checks))
    if unknown:
        raise Refusal(f"no message is called {short(unknown[0])}; choose from {', '.join(checks)}")
    return {name: checks[name](value) for name, value in said.items()}


def short(value: object) -> str:
    """The value as Python writes it, in 40 characters at most."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _number(name: str, low: float, high: float) -> Check:
    def check(value: Any) -> float:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not low <= value <= high:
            raise Refusal(f"{name} is a number from {low:g} to {high:g}, got {short(value)}")
        return float(value)

    return check


def _whole(name: str, low: int, high: int) -> Check:
    def check(value: Any) -> int:
        if type(value) is not int or not low <= value <= high:
            raise Refusal(f"{name} is a whole number from {low} to {high}, got {short(value)}")
        return value

    return check


def _choice(name: str, choices: list[Any]) -> Check:
    def check(value: Any) -> Any:
        if value not in choices or isinstance(value, bool) != (choices[0] in (True, False)):
            listed = ", ".join(map(str, choices))
            raise Refusal(f"{name} is one of {listed}, got {short(value)}")
        return value

    return check


def _fields(name: str, value: Any, known: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict) or set(value) != known:
        raise Refusal(f"{name} has {', '.join(sorted(known))}, or is null; got {short(value)}")
    return value


def _pair(name: str, value: Any, most: float) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise Refusal(f"{name} is a pair of numbers, got {short(value)}")
    x, y = map(_number(name, -most, most), value)
    return x, y


def _hold(value: Any) -> tuple[str, int, tuple[float, float]] | None:
    if value is None:
        return None
    held = _fields("hold", value, {"who", "number", "at"})
    return (
        _choice("who", ["dog", "sheep", "goal"])(held["who"]),
        _whole("number", 0, MOST_SHEEP)(held["number"]),
        _pair("at", held["at"], 1e6),
    )


def _steering(value: Any) -> tuple[int, tuple[float, float]]:
    if value is None:
        return HOVER, (0.0, 0.0)
    if isinstance(value, dict) and "along" in value:
        return ALONG, _pair("along", _fields("fly", value, {"along"})["along"], 1.0)
    return TOWARD, _pair("toward", _fields("fly", value, {"toward"})["toward"], 1e6)


_CHECKS: dict[str, Check] = {
    "arena": _number("arena", 1.0, LONGEST_ARENA),
    "goal": lambda value: None if value is None else _pair("goal", value, LONGEST_ARENA),
    "goal_radius": lambda value: (
        None if value is None else _number("goal_radius", 0.01, LONGEST_ARENA / 2)(value)
    ),
    "sheep": _whole("sheep", 1, MOST_SHEEP),
    "dogs": _whole("dogs", 1, MOST_DOGS),
    "mode": _choice("mode", ["watch", "fly", "race"]),
    "case": _whole("case", 0, CASES),
    "speed": _number("speed", SPEEDS[0], SPEEDS[-1]),
    "noise": _number("noise", 0.0, 2.0),
    "perception": _number("perception", 0.0, 2.0),
    "actuation": _number("actuation", 0.0, 2.0),
    "paused": _choice("paused", [True, False]),
    "step": _choice("step", [True]),
    "reset": _choice("reset", [True]),
    "hold": _hold,
    "fly": _steering,
    "seen": _whole("seen", 0, 2**53),
}
