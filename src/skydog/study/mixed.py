"""Mixed flocks: who herds them, by the share of the sheep that are of another kind."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from skydog.shepherds.rearmost import Rearmost
from skydog.study import evaluate, statistics
from skydog.study.cases import cases
from skydog.study.options import Results, Track
from skydog.world import herding
from skydog.world.laws.varied import VariedFlock
from skydog.world.mission import Fly, Shepherd
from skydog.world.mixing import KINDS
from skydog.world.params import World
from skydog.world.presets import preset
from skydog.world.sight import Sight
from skydog.world.trace import Trace
from skydog.world.vectors import norm

PRESET = "strombom2014"
SHEEP = 20
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
AIM = 0.2  # the share at which every kind is to be herded in 90 % of the missions
CASES = 100
SEED = 0  # the numbers of `Rearmost` were tuned on seeds from 500 on
STEPS = 5_000
SOON = 1_000  # steps of a mission of `skydog test`
OURS, THEIRS = "rearmost", "strombom"
NAMES = (OURS, THEIRS, "h-ddpg-4x4", "arc")
"""Who flies: ours is explained, and compared with the rule of Strömbom et al. 2014."""

LESSER: dict[str, Shepherd] = {
    OURS: Rearmost(),
    "stands f(N)/5 behind": Rearmost(behind=0.2),  # 3 m; strombom has 2 m
    "stands f(N) behind": Rearmost(behind=1.0),
    "stands 2 f(N) behind": Rearmost(behind=2.0),
    "takes the last, however far": Rearmost(nearness=0.0),
}
"""Our dog, and with other numbers, one at a time."""

FLOCKS = (5, 10, 46, 100)
GOALS = {"in the corner": None, "at the edge": (75.0, 0.0), "in the middle": (75.0, 75.0)}
ELSEWHERE = {  # preset, side in metres, sheep
    "paper, 4 m, 3 sheep": ("paper", 4.0, 3),
    "paper, 12 m, 30 sheep": ("paper", 12.0, 30),
    "elfiqi2020, 50 m, 100 sheep": ("elfiqi2020", 50.0, 100),
}
SIGHTS = {
    "all of the flock": Sight(1e6),
    "80 m": Sight(80.0),
    "40 m": Sight(40.0),
    "20 m": Sight(20.0),
    "80 m, a field of 90°": Sight(80.0, np.pi / 2),
    "80 m, a field of 45°": Sight(80.0, np.pi / 4),
    "80 m, sheep of 0.5 m hide others": Sight(80.0, body=0.5),
}
HABITUATION = (0.0, 0.001, 0.003, 0.01, 0.03)  # rates, 1/s
MORE_CASES = 50  # of a row that is not of the sweep


def fly_all(shepherds: Mapping[str, Shepherd], fly: Fly, track: Track) -> Results:
    """Fly shepherds, by name, with every kind and share; and two of them in other ways."""
    two = {name: shepherds[name] for name in (OURS, THEIRS) if name in shepherds}
    mixes = {
        "no others": (),
        f"{100 * AIM:g} % loners": ("loner", AIM),
        "all loners": ("loner", 1.0),
    }
    results: Results = {"shares": {kind: {} for kind in KINDS}, "why": {}, "lesser": {}}
    for share in track("Shares of every kind", SHARES):
        for kind in KINDS:
            if share == 0.0 and results["shares"]["stubborn"].get("0"):
                rows = results["shares"]["stubborn"]["0"]
            else:
                rows = _rows(fly, shepherds, world(kind, share), SHEEP)
            results["shares"][kind][f"{share:g}"] = rows
    for name, mix in track("Why", mixes.items()):
        where = world(*mix)
        results["why"][name] = {
            called: _gathering(where, _flown(fly, where, dog, SHEEP)) for called, dog in two.items()
        }
    parts = mixes | {f"{100 * AIM:g} % short-sighted": ("short-sighted", AIM)}
    for name, mix in track("Parts of rearmost", parts.items()):
        results["lesser"][name] = _rows(fly, LESSER, world(*mix), SHEEP)
    results["flocks"] = {
        f"{sheep} sheep, {name}": _rows(fly, two, world(*mix, sheep=sheep), sheep, MORE_CASES)
        for sheep in track("Flocks of other sizes", FLOCKS)
        for name, mix in tuple(mixes.items())[:2]
    }
    results["goals"] = {
        f"goal {place}, {name}": _rows(fly, two, world(*mix, goal=goal), SHEEP, MORE_CASES)
        for place, goal in track("Goals elsewhere", GOALS.items())
        for name, mix in mixes.items()
    }
    results["elsewhere"] = {
        name: _rows(fly, two, preset(where, size, sheep), sheep, MORE_CASES)
        for name, (where, size, sheep) in track("In other worlds", ELSEWHERE.items())
    }
    results["sight"] = {
        f"{name}, {of}": _rows(fly, two, replace(world(*mix), sight=sight), SHEEP, MORE_CASES)
        for name, sight in track("Limited sight", SIGHTS.items())
        for of, mix in tuple(mixes.items())[:2]
    }
    results["habituation"] = {
        f"{rate:g} a second": _rows(fly, two, replace(world(), habituation=rate), SHEEP, MORE_CASES)
        for rate in track("Sheep that get used to dogs", HABITUATION)
    }
    return results


def world(
    kind: str | None = None,
    share: float = 0.0,
    sheep: int | None = None,
    goal: tuple[float, float] | None = None,
) -> World:
    """The preset's world with a share of one kind, for `SHEEP` sheep if not given.

    Each sheep has its own of all that any kind changes: what is compiled for one serves all.
    """
    sheep = sheep or SHEEP
    mix = {} if kind is None else {kind: share}
    found = preset(PRESET, sheep=sheep, goal=goal, mix=mix)
    flock = VariedFlock(**vars(found.flock))
    changed = {name for each in KINDS.values() for name in (*each.values, *each.shares)}
    own = {name: _each(getattr(flock, name), sheep) for name in sorted(changed - {"speed"})}
    body = replace(found.sheep, speed=_each(found.sheep.speed, sheep))
    return replace(found, flock=replace(flock, **own), sheep=body)


def _each(value: Any, sheep: int) -> np.ndarray:
    return np.broadcast_to(
        np.asarray(value or 0.0 if np.ndim(value) == 0 else value), sheep
    ).astype(np.float32)


def _flown(fly: Fly, where: World, shepherd: Shepherd, sheep: int, count: int = 0) -> Trace:
    starts = cases(where, count or CASES, "random", SEED, sheep)
    return fly(where, shepherd, starts, STEPS, evaluate.noise_key(where, SEED))


def _rows(
    fly: Fly, shepherds: Mapping[str, Shepherd], where: World, sheep: int, count: int = 0
) -> Results:
    """A row of figures for each shepherd, from the same starts."""
    rows: Results = {}
    for name, shepherd in shepherds.items():
        measured = evaluate.measure(_flown(fly, where, shepherd, sheep, count))
        done, steps = measured["success"], measured["steps"]
        successes, total = int(done.sum()), len(done)
        share, interval = statistics.share(successes, total)
        soon, soon_interval = statistics.share(int(np.sum((done > 0) & (steps <= SOON))), total)
        rows[name] = {
            "success": share,
            "success_ci95": interval,
            "cases": total,
            "soon": soon,
            "soon_ci95": soon_interval,
            "steps": statistics.summary(steps),
        }
    return rows


def _gathering(where: World, flown: Trace) -> dict[str, float]:
    """For how long the gate took the flock for gathered, and how many sheep came home."""
    last = np.where(flown.accomplished.any(1), flown.accomplished.argmax(1), STEPS)
    under_way = np.arange(flown.drives.shape[1]) < last[:, None]
    gathered = np.sum(np.asarray(flown.drives)[..., 0] & under_way) / max(np.sum(under_way), 1)
    away = norm(flown.sheep[:, -1] - herding.goal(where.arena))
    home = np.mean(np.sum(np.asarray(away) <= where.arena.goal_radius, axis=1))
    return {"gathered": float(gathered), "home": float(home)}
