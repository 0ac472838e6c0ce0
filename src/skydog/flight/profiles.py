"""Profiles: what a drone or a rover is, and its gains; a file each, every value with its source."""

import math
import tomllib
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from skydog import files
from skydog.errors import Refusal

LARGEST_FILE = 1 << 16  # bytes
LARGEST = 1e4  # of any number; none is negative
MAY_BE_ZERO = {
    "motor_lag",
    "drag",
    "damping",
    "climb_damping",
    "delay",
    "noise",
    "drift",
    "trim",
    "lead",
    "feedforward",
}

Profile = TypeVar("Profile", "UAV", "Rover")


@dataclass(frozen=True)
class UAVBody:
    """A quadrotor. Metres, kilograms, seconds, newtons."""

    mass: float
    inertia: tuple[float, float, float]  # kg m², about x, y and z
    arm: float  # from the centre to a rotor
    radius: float  # of all of it, seen from above
    height: float
    rotor_thrust: float  # at most, of each of the four rotors
    rotor_torque: float  # N m about its axis for each N of thrust
    motor_lag: float  # time constant of the thrust; 0 is none
    drag: float  # N for each m/s


@dataclass(frozen=True)
class Attitude:
    """The attitude loop on board: angular acceleration = gain × error + damping × its rate."""

    gain: float  # 1/s²
    damping: float  # 1/s
    lead: float  # share of the commanded tilt's own rate that damping sees
    yaw_gain: float  # 1/s, of the yaw rate
    largest: float  # rad of tilt that may be commanded
    largest_rate: float  # rad/s at which the commanded tilt may change


@dataclass(frozen=True)
class Velocity:
    """The velocity loop: acceleration = gain × error + damping × its rate."""

    on_board: (
        bool  # the drone is commanded velocities; else tilt, and the base station has the loop
    )
    gain: float  # 1/s
    damping: float
    climb_gain: float  # 1/s
    climb_damping: float
    largest: float  # m/s
    largest_climb: float  # m/s


@dataclass(frozen=True)
class Position:
    """The position loop: SNI, N(s) = Γ / (s + ΓΦ) - Δ, and the trim estimator."""

    feedforward: float  # share of the set-point's own velocity
    gamma: float  # Γ, 1/s
    phi: float  # Φ, s
    delta: float  # Δ, 1/s
    trim: float  # 1/s²
    largest_trim: float  # m/s


@dataclass(frozen=True)
class Link:
    """What happens to a command before it is obeyed.

    Of velocities, in m/s, where the velocity loop is on board; else of tilt, in radians.
    """

    delay: float  # s
    noise: float  # uniform, of each command
    drift: float  # uniform, drawn anew every 5 s
    trim: float  # of tilt, rad: constant, in a direction drawn for each mission


@dataclass(frozen=True)
class UAV:
    """A drone: its body, its loops from the rotors outwards, and its radio link."""

    name: str
    body: UAVBody
    attitude: Attitude
    velocity: Velocity
    position: Position
    link: Link


@dataclass(frozen=True)
class RoverBody:
    """A rover with two driven wheels and casters. Metres, kilograms, newtons."""

    mass: float
    radius: float
    height: float
    wheel_radius: float
    wheel_separation: float
    wheel_torque: float  # N m at most
    wheel_inertia: float  # kg m²: of its motor, behind the gear
    wheel_gain: float  # N m s/rad, of a wheel's speed servo


@dataclass(frozen=True)
class Motion:
    """How fast a rover may be commanded to move."""

    largest_speed: float  # m/s
    largest_turn_rate: float  # rad/s
    acceleration: float  # m/s²
    turn_acceleration: float  # rad/s²


@dataclass(frozen=True)
class Tracking:
    """How a rover follows its set-point: see `skydog.flight.rovers.track`."""

    gain: float  # 1/s
    leash: float  # m
    ahead: float  # m


@dataclass(frozen=True)
class Yaw:
    """The SNI loop of a rover's yaw, N(s) = Γ / (s + ΓΦ) - Δ, whose Γ a fuzzy rule base scales."""

    gamma: float  # 1/s
    phi: float  # s
    delta: float  # 1/s
    moves_within: float  # rad


@dataclass(frozen=True)
class Rover:
    """A rover: its body, its limits and its two controllers."""

    name: str
    body: RoverBody
    motion: Motion
    tracking: Tracking
    yaw: Yaw


def uav(name: str) -> UAV:
    """The profile of a drone: one that ships, by its name, or a TOML file. Raises `Refusal`."""
    found = _read(name, "uav", UAV)
    return _stable(name, found, found.position)


def rover(name: str) -> Rover:
    """The profile of a rover: one that ships, by its name, or a TOML file. Raises `Refusal`."""
    found = _read(name, "rover", Rover)
    return _stable(name, found, found.yaw)


@cache
def ship(kind: str) -> tuple[str, ...]:
    """The profiles of a kind that ship: "uav" or "rover"."""
    folder = resources.files("skydog.flight").joinpath("profiles")
    files = sorted(Path(str(file)) for file in folder.iterdir() if file.name.endswith(".toml"))
    return tuple(file.stem for file in files if tomllib.loads(file.read_text())["kind"] == kind)


def _stable(name: str, profile: Profile, loop: Position | Yaw) -> Profile:
    """The profile, if its SNI loop meets the DC condition N(0) < 0 (Mabrok et al. 2014)."""
    if loop.delta * loop.phi <= 1.0:
        raise Refusal(
            f"{name} has delta = {loop.delta:g} and phi = {loop.phi:g}, which lets its loop "
            f"diverge: delta must be larger than 1 / phi; try delta = {2 / loop.phi:g}"
        )
    return profile


def _read(name: str, kind: str, form: type[Profile]) -> Profile:
    path = Path(name)
    if name in ship(kind):
        path = Path(str(resources.files("skydog.flight"))) / "profiles" / f"{name}.toml"
    elif path.suffix != ".toml":
        flag = "--profile" if kind == "uav" else "--rovers"
        raise Refusal(
            f"no {kind} profile is called {name!r:.60}; choose from {', '.join(ship(kind))}, or "
            f"name a file, {flag} my.toml"
        )
    table = files.read_toml(path, "profile", LARGEST_FILE)
    if table.pop("kind", None) != kind:
        raise Refusal(f"{path} is no profile of a {kind}; it must say kind = {kind!r}")
    return _filled(str(path), form, {"name": path.stem, **table}, "")


def _filled(path: str, form: Any, table: dict[str, Any], place: str) -> Any:
    """A dataclass from a table that has its fields and no other."""
    named, hints = {field.name for field in fields(form)}, get_type_hints(form)
    for name in sorted(named ^ set(table)):
        does = "does not know" if name in table else "lacks"
        raise Refusal(f"{path} {does} {place + name!r:.80}; see those that ship, such as kobuki")
    values = {name: _value(path, hints[name], value, place + name) for name, value in table.items()}
    for name, value in values.items():
        parts = value if isinstance(value, tuple) else (value,)
        if name not in MAY_BE_ZERO and any(type(part) is float and part == 0.0 for part in parts):
            raise Refusal(f"{path} has {place}{name} = {value!r}; it must be larger than 0")
    return form(**values)


def _value(path: str, kind: Any, value: Any, place: str) -> Any:
    if kind in (str, bool) and type(value) is kind:
        return value
    if is_dataclass(kind) and isinstance(value, dict):
        return _filled(path, kind, value, f"{place}.")
    if kind is float and _is_number(value):
        return float(value)
    three = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if three and kind == tuple[float, float, float]:
        return tuple(map(float, value))
    raise Refusal(
        f"{path} has {place} = {value!r:.60}; numbers are from 0 to {LARGEST:g}, and a profile "
        "that ships shows the kind"
    )


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and 0.0 <= value <= LARGEST
