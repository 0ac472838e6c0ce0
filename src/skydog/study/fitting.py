"""A flock's parameters from tracks: those whose law predicts best where each sheep moves next.

The gradient goes through smoothed radii, which become the harder the nearer the fit is to its end.
"""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy import optimize

from skydog import numerics
from skydog.errors import Refusal
from skydog.study.options import Track
from skydog.study.smoothing import FAR, Surroundings, smoothed_force, surroundings
from skydog.study.tracks import FOLDS, Windows
from skydog.world.laws.varied import VariedFlock
from skydog.world.params import Arena, Sheep, World
from skydog.world.presets import preset
from skydog.world.spread import TwoThirdsSpread
from skydog.world.state import State
from skydog.world.vectors import Scalar

# Of the radii, one after the other. At a constant 0.1 the radii come out up to 12 % too short;
# at 0.01 the weights are still 10 % off, at 0.001 5 %. CMA on the hard radii takes twice as long
# as this and is no better.
SOFTNESS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
WEIGHTS = ("inertia", "grouping", "escape", "repulsion", "alignment")
PARAMETERS = ("avoidance", "sensing", *WEIGHTS, "noise", "graze", "speed")
# Forces are normalised, so that the weights' common scale is free: theirs is that of Strömbom
# 2014, 0.5 + 1.05 + 1 + 2.
SCALE = 4.55
STROMBOM = VariedFlock(2.0, 65.0, 0.5, 1.05, 1.0, 2.0)
STILL = 0.2  # of the fastest: a sheep that is slower stands, and has no heading
FASTEST = 99  # per cent of the speeds are below the fastest; a measurement may jump
HORIZON = 4  # steps ahead that are predicted
RESAMPLES = 100  # of the bootstrap over events
PAIRS = 3e5  # of sheep that a sum looks at, at most: of longer tracks fewer instants


class Moves(eqx.Module):
    """What sheep did in one step, from states stacked along the first axis.

    `states.force` is the heading of the step before. Headings are unit vectors, or zero for a
    sheep that stood.
    """

    states: State
    heading: Float[Array, "moves sheep 2"]
    event: Int[np.ndarray, " moves"]


@dataclass(frozen=True)
class Fitted:
    """A flock with the 95 % intervals of its parameters, and its speed in m/s."""

    flock: VariedFlock
    speed: float
    intervals: dict[str, tuple[float, float]]


@numerics.ours()
def still(windows: Windows, step: float) -> float:
    """The speed in m/s below which a sheep counts as standing."""
    return STILL * float(np.percentile(_speeds(windows, step), FASTEST))


@numerics.ours()
def moves(windows: Windows, step: float) -> Moves:
    """The first two steps of every window, as headings. Raises `Refusal` if no sheep moves."""
    least = still(windows, step)
    if least == 0.0:
        raise Refusal("the sheep of these tracks stand all the time; nothing can be fitted")
    count, sheep = len(windows.sheep), windows.sheep.shape[2]
    every = max(1, round(count * sheep * (sheep + windows.dogs.shape[2]) / PAIRS))
    headings = _headings(windows, step, least)[::every]
    places = windows.sheep[::every, 1], windows.dogs[::every, 1], headings[:, 0], headings[:, 1]
    sheep, dogs, before, after = (jnp.asarray(part, jnp.float32) for part in places)
    return Moves(State(sheep, dogs, before), after, windows.event[::every])


@numerics.ours()
def fit(
    moves: Moves,
    aligned: bool = True,
    events: Float[np.ndarray, " events"] | None = None,
    begin: VariedFlock | None = None,
) -> VariedFlock:
    """The flock whose forces are the nearest to the headings, in the mean square.

    `events` weighs the events; None is all alike. `begin` is a flock near the one sought, from
    where fewer of `SOFTNESS` are needed. Weights have the sum `SCALE`.
    """
    weights = np.ones(int(moves.event.max()) + 1) if events is None else events
    weighs = jnp.asarray(weights[moves.event], jnp.float32)
    around = surroundings(moves.states)
    away, from_dogs = np.asarray(around.distance), np.asarray(around.dog_distance)
    free = [(None, None)] * (5 if aligned else 4)
    bounds = [_logs(away[away < FAR]), _logs(from_dogs), *free]
    heading = jnp.moveaxis(moves.heading, 0, -1).swapaxes(0, 1)

    def descend(vector: np.ndarray, softness: float, steps: int) -> Any:
        def loss(at: np.ndarray) -> tuple[float, np.ndarray]:
            here = jnp.asarray(at, jnp.float32)
            value, slope = _loss(here, around, heading, weighs, softness)
            return float(value), np.asarray(slope, float)

        options = {"maxiter": steps}
        found = optimize.minimize(
            loss, vector, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        found.x[2:] *= SCALE / np.abs(found.x[2:]).sum()
        return found

    if begin is not None:
        vector, rest, steps = _vector(begin, aligned), SOFTNESS[-3:], 40
    else:
        # A sheep keeps its distance to the nearest; how far it sees may be anything.
        nearest = float(np.median(away.min(axis=0))) if len(away) > 1 else STROMBOM.avoidance
        begins = [
            replace(STROMBOM, avoidance=nearest, sensing=far)
            for far in np.percentile(from_dogs, (25, 50, 75)).tolist()
        ]
        tries = [descend(_vector(flock, aligned), SOFTNESS[0], 30) for flock in begins]
        vector, rest, steps = min(tries, key=lambda one: one.fun).x, SOFTNESS[1:], 60
    for softness in rest:
        vector = descend(vector, softness, steps).x
    return jax.tree.map(float, _flock(jnp.asarray(vector, jnp.float32)))


@numerics.ours()
def fit_all(windows: Windows, step: float, track: Track, seed: int = 0) -> Fitted:
    """The flock of tracks, with its noise, grazing and speed.

    The intervals are those of a bootstrap that draws whole events, by `seed`.
    """
    moved = moves(windows, step)
    count = int(moved.event.max()) + 1
    best = fit(moved)
    heading, rng = np.asarray(moved.heading), np.random.default_rng(seed)
    draws = [
        np.bincount(rng.integers(count, size=count), minlength=count) for _ in range(RESAMPLES)
    ]
    drawn = [
        _as_row(_with_chance(fit(moved, events=draw.astype(float), begin=best), moved, draw))
        | {"speed": _speed(windows, step, draw)}
        for draw in track("Bootstrap", draws)
        if np.any(heading[draw[moved.event] > 0])
    ]
    intervals = {
        name: tuple(np.percentile([row[name] for row in drawn], (2.5, 97.5)).tolist())
        for name in drawn[0]
    }
    every = np.ones(count, int)
    return Fitted(_with_chance(best, moved, every), _speed(windows, step, every), intervals)


@numerics.ours()
def held_out(windows: Windows, step: float, track: Track) -> dict[str, list[list[float]]]:
    """The heading error, 1 - cos, of each way to predict: a row a fold, a column a step ahead.

    The events are dealt into `FOLDS` folds; what predicts one was fitted to the others. The sheep
    move from measured positions by the law, while the dogs go where they went. Every way is
    judged by the same sheep: those that moved in the step before, and in the one predicted. A
    sheep that is predicted to stand has an error of 1.
    """
    moved = moves(windows, step)
    count = int(moved.event.max()) + 1
    fold = np.arange(count) % FOLDS
    errors: dict[str, list[list[float]]] = {}
    for number in track("Held-out events", range(FOLDS)):
        others = (fold != number).astype(float)
        own = fold[windows.event] == number
        part = Windows(windows.sheep[own], windows.dogs[own], windows.event[own])
        flocks = {
            "persistence": None,
            "Strömbom's weights": STROMBOM,
            "fitted without alignment": fit(moved, False, others),
            "fitted with alignment": fit(moved, True, others),
        }
        for name, flock in flocks.items():
            errors.setdefault(name, []).append(_errors(part, step, flock, still(windows, step)))
    return errors


def world(fitted: Fitted, windows: Windows, step: float) -> World:
    """A world for the flock of tracks: that of Strömbom 2014, scaled to its R_ππ.

    A step of the law takes `step` seconds. The dog is as fast as those of the tracks; the arena
    is as wide as the tracks, or wider where the goal needs it.
    """
    sheep, reach = windows.sheep.shape[2], float(fitted.flock.avoidance)
    spread = TwoThirdsSpread(length=reach)  # f(N) = r_a N^(2/3)
    goal_radius = max(5.0 * reach, float(spread.radius(sheep)))
    places = np.concatenate([windows.sheep.reshape(-1, 2), windows.dogs.reshape(-1, 2)])
    size = float(np.ceil(max(np.ptp(places, axis=0).max(), 4.0 * goal_radius)))
    flown = np.linalg.norm(np.diff(windows.dogs, axis=1), axis=-1) / step
    usual = preset("strombom2014", sheep=sheep)
    dog = replace(
        usual.dog,
        speed=float(np.percentile(flown, FASTEST)) or usual.dog.speed,
        driving=reach,
        collecting=reach,
        stall=3.0 * reach,
        airspace=size,
    )
    return replace(
        usual,
        flock=fitted.flock,
        sheep=Sheep(speed=fitted.speed),
        dog=dog,
        arena=Arena(size=size, goal_radius=goal_radius, dt=step),
        spread=spread,
    )


def _errors(windows: Windows, step: float, flock: VariedFlock | None, least: float) -> list[float]:
    """The mean heading error at each step ahead; of None the sheep go on as before."""
    headings = _headings(windows, step, least)
    moving = np.any(headings[:, :1] != 0.0, axis=-1) & np.any(headings[:, 1:] != 0.0, axis=-1)
    if not moving.any(axis=(0, 2)).all():
        return [float("nan")] * HORIZON
    before = jnp.asarray(headings[:, 0], jnp.float32)
    predicted = np.repeat(headings[:, :1], HORIZON, axis=1)
    if flock is not None:
        speed = _speed(windows, step, np.ones(int(windows.event.max()) + 1, int))
        places = jnp.asarray(windows.sheep[:, 1], jnp.float32)
        dogs = jnp.asarray(windows.dogs[:, 1:-1], jnp.float32)
        predicted = np.asarray(_predicted(flock, places, dogs, before, speed * step))
    cosine = np.sum(predicted * headings[:, 1:], axis=-1)
    return [float(1.0 - cosine[:, at][moving[:, at]].mean()) for at in range(HORIZON)]


@eqx.filter_jit
def _predicted(
    flock: VariedFlock, sheep: Array, dogs: Array, before: Array, stride: float
) -> Array:
    """The headings of the steps ahead, by the law: shape (windows, HORIZON, sheep, 2)."""

    def one(sheep: Array, dogs: Array, before: Array) -> Array:
        def ahead(carry: tuple[Array, Array], dogs: Array) -> tuple[tuple[Array, Array], Array]:
            sheep, before = carry
            force = flock.force(State(sheep, dogs, before), None)
            return (sheep + stride * force, force), force

        return jax.lax.scan(ahead, (sheep, before), dogs)[1]

    return jax.vmap(one)(sheep, dogs, before)


def _flock(vector: Array) -> VariedFlock:
    """The flock of a vector: the logarithms of both radii, and weights of any common scale."""
    radii, weights = jnp.exp(vector[:2]), vector[2:]
    weights = SCALE * weights / jnp.sum(jnp.abs(weights))
    return VariedFlock(*radii, **dict(zip(WEIGHTS, weights, strict=False)))


def _vector(flock: VariedFlock, aligned: bool) -> np.ndarray:
    weights = [getattr(flock, name) for name in WEIGHTS[: 5 if aligned else 4]]
    weights = [0.5 if weight is None else weight for weight in weights]
    return np.array([np.log(flock.avoidance), np.log(flock.sensing), *weights], float)


@jax.jit
@jax.value_and_grad
def _loss(
    vector: Array, around: Surroundings, heading: Array, weights: Array, softness: Scalar
) -> Array:
    missed = smoothed_force(_flock(vector), around, softness) - heading
    each = jnp.mean(jnp.sum(missed * missed, axis=0), axis=0)
    return 0.5 * jnp.sum(weights * each) / jnp.sum(weights)


def _with_chance(flock: VariedFlock, moves: Moves, draw: Int[np.ndarray, " events"]) -> VariedFlock:
    """The flock with the noise and the grazing that explain what it leaves unexplained."""
    total, disturbed = (np.asarray(part) for part in _totals(flock, moves))
    after, lengths = np.asarray(moves.heading), np.linalg.norm(total, axis=-1)
    weights = np.broadcast_to(draw[moves.event][:, None], lengths.shape)
    moving, disturbed = np.any(after != 0.0, axis=-1), disturbed[..., 0]
    idle = np.sum(weights * ~disturbed)
    graze = np.sum(weights * (~disturbed & moving)) / idle if idle else 0.0
    judged = disturbed & moving & (lengths > 0.0) & (weights > 0)
    if not judged.any():
        return replace(flock, graze=float(graze))
    weights, lengths = weights[judged], lengths[judged]
    cosine = np.sum(total * after, axis=-1)[judged] / lengths
    noise = _noise(lengths, weights, float(np.average(cosine, weights=weights)))
    return replace(flock, noise=noise, graze=float(graze))


def _noise(lengths: np.ndarray, weights: np.ndarray, cosine: float) -> float:
    """The weight of a random unit vector that leaves the mean cosine between sums and headings."""
    angles = (np.arange(16) + 0.5) * np.pi / 16

    def left(noise: float) -> float:
        along = lengths[:, None] + noise * np.cos(angles)
        turned = np.mean(along / np.hypot(along, noise * np.sin(angles)), axis=1)
        return float(np.average(turned, weights=weights)) - cosine

    most = 10.0 * float(lengths.max())
    if left(0.0) <= 0.0 or left(most) >= 0.0:
        return 0.0 if left(0.0) <= 0.0 else most
    return float(optimize.brentq(left, 0.0, most, xtol=1e-4))  # pyright: ignore[reportArgumentType]


def _as_row(flock: VariedFlock) -> dict[str, float]:
    return {name: getattr(flock, name) for name in PARAMETERS if name != "speed"}


@jax.jit
def _totals(flock: VariedFlock, moves: Moves) -> tuple[Array, Array]:
    """The sums of the terms on each sheep, and whether anything disturbs it."""
    return jax.vmap(flock.total)(moves.states)


def _logs(distances: np.ndarray) -> tuple[float, float]:
    """Within what a radius is sought: beyond the distances that occur it changes nothing."""
    if len(distances) == 0:
        return 0.0, 0.0
    return float(np.log(0.9 * distances.min() + 1e-3)), float(np.log(1.1 * distances.max()))


def _headings(windows: Windows, step: float, least: float) -> np.ndarray:
    """The heading of each sheep in each step, zero where it is slower than `least` m/s."""
    moved = np.diff(windows.sheep, axis=1)
    lengths = np.linalg.norm(moved, axis=-1, keepdims=True)
    return np.where(lengths > least * step, moved / np.where(lengths > 0.0, lengths, 1.0), 0.0)


def _speeds(windows: Windows, step: float) -> np.ndarray:
    """The speed of each sheep in the second step of each window, in m/s."""
    return np.linalg.norm(windows.sheep[:, 2] - windows.sheep[:, 1], axis=-1) / step


def _speed(windows: Windows, step: float, draw: Int[np.ndarray, " events"]) -> float:
    """The median speed in m/s of the sheep that move."""
    speeds = np.repeat(_speeds(windows, step), draw[windows.event], axis=0)
    return float(np.median(speeds[speeds > still(windows, step)]))
