"""A world as plain values by dotted name, for a file that other tools read; and back again."""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from skydog.errors import Refusal, short
from skydog.world.end import AllHome, ShareHome
from skydog.world.home import AroundHome, StraightHome
from skydog.world.laws.diffusive import DiffusiveFlock
from skydog.world.laws.elfiqi import RegulatedFlock
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.paper import PaperFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.laws.varied import VariedFlock
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.obstacles import MOST_OBSTACLES, Obstacles
from skydog.world.params import Arena, Dog, Sheep, World
from skydog.world.scenes import with_home, with_routes
from skydog.world.sight import Sight
from skydog.world.spread import FixedSpread, SquareRootSpread, TwoThirdsSpread
from skydog.world.vectors import PerSheep

LARGEST = 1e9  # of a world's parameters in a file: far from where float32 overflows
MOST_SHEEP = 1_000_000  # numbers of a parameter that each sheep has its own of
MOST_KEPT = 100_000  # numbers of a parameter that a file keeps
LONGEST_NAME = 200  # characters of the name of a law of one's own
POSITIVE = ("arena.size", "arena.height", "arena.dt")
OWN = "own: "  # how the name of a law begins that is none of ours

PARTS: dict[str, Any] = {"sheep": Sheep, "dog": Dog, "arena": Arena}
"""The parts of a world that are always of one kind."""

LAWS: dict[str, dict[str, Any]] = {
    "flock": {
        "paper": PaperFlock,
        "literal": LiteralFlock,
        "strombom2014": StrombomFlock,
        "elfiqi2020": RegulatedFlock,
        "varied": VariedFlock,
        "diffusive": DiffusiveFlock,
    },
    "dog.limits": {"per axis": PerAxis, "any direction": AnyDirection},
    "spread": {
        "N^(2/3)": TwoThirdsSpread,
        "sqrt(2N)": SquareRootSpread,
        "fixed": FixedSpread,
    },
    "home": {"straight line": StraightHome, "around obstacles": AroundHome},
    "end": {"all home and gathered": AllHome, "a share home": ShareHome},
}
"""The laws that a world may carry in each place, by the name that stands in a file."""

Plain = float | int | bool | str | list[float] | None


class UnknownLaw(eqx.Module):
    """A law of somebody's own, read from a file: its name and what is known of it.

    A file is never executed, so that the law itself cannot be had from it.
    """

    name: str = eqx.field(static=True)
    sensing: PerSheep | None = None  # of a flock: how far its sheep see a dog, metres

    def force(self, *_: Any) -> Any:
        """Raise `Refusal`, as every method of a law does here."""
        raise Refusal(
            f"{self.name} is a law that no file can hold; fly it in its own world, "
            "with --world FILE.py:NAME"
        )

    limit = fastest = radius = way = accomplished = force


def flatten(world: World, sheep: int | None = None) -> dict[str, Plain]:
    """The parameters by dotted name, `flock.escape` and so on, and the name of each law.

    Of a law of one's own its name and its numbers stand there; of an own f(N) its value for
    `sheep` sheep, if their number is given.
    """
    values: dict[str, Plain] = {}
    for place in ("flock", "sheep", "dog", "arena", "spread", "home", "end"):
        _flatten(values, place, getattr(world, place))
    if sheep is not None and str(values["spread.law"]).startswith(OWN):
        fixed = FixedSpread(float(world.spread.radius(sheep)))
        values = {name: value for name, value in values.items() if not name.startswith("spread.")}
        _flatten(values, "spread", fixed)
    if world.arena.height is None:
        del values["arena.height"]
    if world.obstacles is not None:
        values["obstacles.ends"] = _plain(jnp.ravel(world.obstacles.ends))
        values["obstacles.radius"] = _plain(world.obstacles.radius)
        values["obstacles.tall"] = world.obstacles.tall
    if world.start is not None:
        values["start"] = _plain(world.start)
    if world.sight is not None:
        _flatten(values, "sight", world.sight)
    if world.habituation is not None:
        values["habituation"] = _plain(world.habituation)
    return values


def unflatten(values: dict[str, Any]) -> World:
    """The inverse of `flatten`. Raises `Refusal` if a name is missing, unknown or no number.

    A law that is none of ours comes back as an `UnknownLaw`; the way around obstacles is computed
    anew. Worlds of files that were written before worlds carried their laws are read too.
    """
    values = _upgraded(values)
    dog = {"limits": _law(values, "dog.limits")}
    around = values.get("home.law") == "around obstacles"
    world = World(
        flock=_law(values, "flock"),
        sheep=_module(values, "sheep", Sheep),
        dog=_module(values, "dog", Dog, dog),
        arena=_module(values, "arena", Arena),
        spread=_law(values, "spread"),
        home=StraightHome() if around else _law(values, "home"),
        end=_law(values, "end"),
        obstacles=_obstacles(values),
        start=_numbers("start", values["start"], 4, 4) if "start" in values else None,
        sight=_module(values, "sight", Sight) if "sight.radius" in values else None,
        habituation=_value("habituation", values["habituation"], PerSheep)
        if "habituation" in values
        else None,
    )
    world = with_routes(world)
    return with_home(world) if around else world


def law_name(place: str, law: object) -> str:
    """The name in files of a law in a place: ours has one of `LAWS`."""
    ours = {kind: name for name, kind in LAWS[place].items()}
    return ours.get(type(law)) or own_name(law)


def own_name(law: object) -> str:
    """The name in files of a law that is none of ours."""
    kind = type(law)
    return f"{OWN}{kind.__module__}.{kind.__qualname__}"[:LONGEST_NAME]


def _flatten(values: dict[str, Plain], place: str, part: Any) -> None:
    if place in LAWS:
        if isinstance(part, UnknownLaw):
            values[f"{place}.law"] = part.name
            if part.sensing is not None:
                values[f"{place}.sensing"] = _plain(part.sensing)
            return
        values[f"{place}.law"] = law_name(place, part)
    for field in fields(part):
        name, value = f"{place}.{field.name}", getattr(part, field.name)
        if name in LAWS:
            _flatten(values, name, value)
        elif value is None or isinstance(value, bool | int | float):
            values[name] = value if value is None or not isinstance(value, float) else float(value)
        elif _keeps(value):
            values[name] = _plain(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise Refusal(
                f"a file holds finite numbers, {name} is {value}; give a large one instead"
            )


def _keeps(value: Any) -> bool:
    """Whether a file keeps an array: numbers of one sheep or of each, no tables and no keys."""
    if not isinstance(value, jax.Array | np.ndarray) or value.ndim > 1:
        return False
    return jnp.issubdtype(value.dtype, jnp.number) and value.size <= MOST_KEPT


def _plain(value: Any) -> Plain:
    return np.asarray(value, np.float64).tolist()


def _law(values: dict[str, Any], place: str) -> Any:
    name = values.get(f"{place}.law")
    if isinstance(name, str) and name in LAWS[place]:
        return _module(values, place, LAWS[place][name], named="law")
    if not isinstance(name, str) or not name.startswith(OWN) or len(name) > LONGEST_NAME:
        raise Refusal(
            f"{name!r:.60} is no value for {place}.law; "
            f"this version of skydog knows {', '.join(LAWS[place])}"
        )
    printable = "".join(letter for letter in name if letter.isprintable())
    sensing = values.get(f"{place}.sensing")
    known = None if sensing is None else _value(f"{place}.sensing", sensing, PerSheep)
    return UnknownLaw(printable, known)


def _obstacles(values: dict[str, Any]) -> Obstacles | None:
    if not any(name.startswith("obstacles.") for name in values):
        return None
    ends, radius, tall = (values.get(f"obstacles.{name}") for name in ("ends", "radius", "tall"))
    each = _numbers("obstacles.radius", radius, 0, MOST_OBSTACLES)
    places = _numbers("obstacles.ends", ends, 4 * len(each), 4 * len(each))
    if type(tall) is not bool or not np.all(each > 0.0):
        raise Refusal(f"{short((radius, tall))} are no radii of obstacles")
    return Obstacles(jnp.asarray(places.reshape(-1, 2, 2)), jnp.asarray(each), tall)


def _numbers(name: str, values: Any, least: int, most: int) -> np.ndarray:
    if not isinstance(values, list) or not least <= len(values) <= most:
        raise Refusal(f"{short(values)} is no value for the world parameter {name}")
    if not all(_number(one) for one in values):
        raise Refusal(f"the world parameter {name} holds what is no number: {short(values)}")
    return np.asarray(values, np.float32)


def _module(
    values: dict[str, Any],
    place: str,
    kind: Callable[..., Any],
    made: dict[str, Any] | None = None,
    named: str | None = None,
) -> Any:
    """The part of a world in a place: `made` holds what is made already."""
    made = made or {}
    known = {field.name: field.type for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    there = {
        name.removeprefix(f"{place}.")
        for name in values
        if name.startswith(f"{place}.") and name.removeprefix(f"{place}.").split(".")[0] not in made
    } - {named}
    if there != set(known) - set(made):
        odd = ", ".join(f"{place}.{name}" for name in sorted(there ^ (set(known) - set(made))))
        raise Refusal(f"world parameters missing, or unknown to this version of skydog: {odd}")
    return kind(
        **made,
        **{
            name: _value(f"{place}.{name}", values[f"{place}.{name}"], known[name])
            for name in there
        },
    )


def _value(name: str, value: Any, kind: Any) -> Any:
    """The value of a parameter, checked. Raises `Refusal`."""
    if kind == PerSheep | None:
        return None if value is None else _value(name, value, PerSheep)
    if isinstance(value, list) and kind == PerSheep and 1 <= len(value) <= MOST_SHEEP:
        if all(_number(one) for one in value):
            return np.asarray(value, np.float32)
    elif name == "arena.height" and value is None:
        return None
    elif name == "flock.neighbours":
        if value is None or (type(value) is int and 1 <= value <= MOST_SHEEP):
            return value
    elif isinstance(value, int | float) and _number(value) and (name not in POSITIVE or value > 0):
        return value
    raise Refusal(f"{short(value)} is no value for the world parameter {name}")


def _number(value: Any) -> bool:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= LARGEST  # which no number that is not finite is


def _upgraded(values: dict[str, Any]) -> dict[str, Any]:
    """The values as they are written today.

    A square arena has no height. Before, the furthest stray was always the one to collect; and
    still before, the flock held what is now a law's choice.
    """
    if "dog.speed" in values:
        values = {"dog.nearness": 0.0, "arena.height": None, **values}
    if "flock.literal_forces" not in values:
        return values
    values = dict(values)
    literal, per_axis = values.pop("flock.literal_forces"), values.pop("dog.per_axis", None)
    for name, value in (("flock.literal_forces", literal), ("dog.per_axis", per_axis)):
        if not isinstance(value, bool):
            raise Refusal(f"{value!r:.60} is no value for the world parameter {name}")
    values["flock.law"] = "literal" if literal else "strombom2014"
    if literal:
        for name in ("flock.graze", "flock.neighbours"):
            values.pop(name, None)
    values["dog.limits.law"] = "per axis" if per_axis else "any direction"
    for old, new in (("flock.speed", "sheep.speed"), ("flock.spread", "spread.length")):
        if old in values:
            values[new] = values.pop(old)
    return values | {
        "spread.law": "N^(2/3)",
        "home.law": "straight line",
        "end.law": "all home and gathered",
    }
