"""The paper's "Problem Formulation" in plain NumPy: float64, one sheep and one dog at a time.

Written from the equations, to be read beside them. Where the paper is silent it follows the
docstrings of `skydog.world`, and says so. `close_call` tells where rounding may decide, which
no comparison should depend on.
"""

import math
from itertools import combinations, pairwise

import numpy as np

from skydog.world.laws.literal import LiteralFlock
from skydog.world.limits import PerAxis

CLOSE = 1e-3


def length(v):
    return math.hypot(v[0], v[1])


def direction(v):
    return v / length(v) if length(v) > 0 else np.zeros(2)


def own(value, i):
    """A parameter of sheep i: the flock's one number, or its own of one per sheep."""
    return value if np.ndim(value) == 0 else float(value[i])


def escape(world, sheep, dogs, i):
    """Eq. 2."""
    push = np.zeros(2)
    for dog in dogs:
        if length(sheep[i] - dog) <= own(world.flock.sensing, i):
            push += direction(sheep[i] - dog)
    return push


def avoid(world, sheep, i):
    """Eq. 4."""
    push = np.zeros(2)
    for k in range(len(sheep)):
        if k != i and length(sheep[i] - sheep[k]) <= own(world.flock.avoidance, i):
            push += direction(sheep[i] - sheep[k])
    return push


def nearest(world):
    """How many flockmates pull a sheep; None is all of them, as in the paper."""
    return getattr(world.flock, "neighbours", None)


def to_local_centre(world, sheep, i):
    """From sheep i to the centre of mass of its neighbourhood, before Eq. 5 normalises it."""
    others = [sheep[k] for k in range(len(sheep)) if k != i]
    others.sort(key=lambda other: length(other - sheep[i]))
    if nearest(world) is not None:
        others = others[: nearest(world)]
    return sum(others) / len(others) - sheep[i] if others else np.zeros(2)


def group(world, sheep, i):
    """Eq. 5."""
    return direction(to_local_centre(world, sheep, i))


def total(world, sheep, dogs, previous, i):
    """Eq. 6; unless literal, with Strömbom's normalised terms and his idea of who moves at all."""
    flock = world.flock
    flee, crowd, pull = (
        escape(world, sheep, dogs, i),
        avoid(world, sheep, i),
        group(world, sheep, i),
    )
    if isinstance(flock, LiteralFlock):
        return (
            own(flock.inertia, i) * previous[i]
            + own(flock.grouping, i) * pull
            + own(flock.escape, i) * flee
            + own(flock.repulsion, i) * crowd
        )
    sees_a_dog = any(length(sheep[i] - dog) <= own(flock.sensing, i) for dog in dogs)
    pushed = length(crowd) > 0
    if not sees_a_dog and not pushed:
        return np.zeros(2)
    force = own(flock.inertia, i) * previous[i] + own(flock.repulsion, i) * direction(crowd)
    if sees_a_dog:
        force = force + own(flock.grouping, i) * pull + own(flock.escape, i) * direction(flee)
    return force


def force(world, sheep, dogs, previous, i):
    whole = total(world, sheep, dogs, previous, i)
    return whole if isinstance(world.flock, LiteralFlock) else direction(whole)


def goal(world):
    return np.array([world.arena.goal_x, world.arena.goal_y])


def gathering_distance(world, sheep):
    """f(N), Eq. 7, with the preset's own factor."""
    return world.spread.length * len(sheep) ** (2 / 3)


def furthest_distance(sheep):
    return max(length(one - sheep.mean(axis=0)) for one in sheep)


def gathered(world, sheep):
    return furthest_distance(sheep) <= gathering_distance(world, sheep)


def driving_point(world, sheep, angle=0.0):
    """P_σ1: R_ππ √N behind the centre, seen from the goal, turned by `angle` about the centre."""
    centre = sheep.mean(axis=0)
    x, y = direction(centre - goal(world))
    turned = np.array(
        [x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)]
    )
    return centre + world.dog.driving * math.sqrt(len(sheep)) * turned


def collecting_point(world, sheep, i):
    """P_σ2 of sheep i: R_ππ behind it, seen from the centre."""
    return sheep[i] + world.dog.collecting * direction(sheep[i] - sheep.mean(axis=0))


def bearing(world, sheep, dog):
    """The angle at the flock's centre from the driving point to the dog."""
    centre = sheep.mean(axis=0)
    x, y = direction(centre - goal(world))
    to_dog = dog - centre
    return math.atan2(x * to_dog[1] - y * to_dog[0], x * to_dog[0] + y * to_dog[1])


def outside(world, sheep):
    """The sheep outside f(N); if there are none, the furthest."""
    centre = sheep.mean(axis=0)
    away = [length(one - centre) for one in sheep]
    far = [i for i in range(len(sheep)) if away[i] > gathering_distance(world, sheep)]
    return far or [away.index(max(away))]


def rank(world, sheep, i, dogs):
    """How eagerly sheep i is collected, by the nearest of some dogs."""
    strays_by = length(sheep[i] - sheep.mean(axis=0))
    return strays_by - world.dog.nearness * min(length(dog - sheep[i]) for dog in dogs)


def strays(world, sheep, dogs):
    """Which sheep each dog collects, or None (docstring of `collecting_points`)."""
    left = outside(world, sheep)
    chosen: dict[int, int] = {}
    while left and len(chosen) < len(dogs):
        free = [j for j in range(len(dogs)) if j not in chosen]
        i = max(left, key=lambda i: rank(world, sheep, i, [dogs[j] for j in free]))
        point = collecting_point(world, sheep, i)
        chosen[min(free, key=lambda j: length(dogs[j] - point))] = i
        left.remove(i)
    return [chosen.get(j) for j in range(len(dogs))]


def gate(world, sheep, dogs):
    """The subgoal of each dog and whether it drives."""
    spread = math.pi / 5
    around = sorted(range(len(dogs)), key=lambda j: bearing(world, sheep, dogs[j]))
    subgoals, drives = [], []
    for j, stray in enumerate(strays(world, sheep, dogs)):
        driving = gathered(world, sheep) or stray is None
        if driving:
            angle = (around.index(j) - (len(dogs) - 1) / 2) * spread
            point = driving_point(world, sheep, angle)
        else:
            point = collecting_point(world, sheep, stray)
        subgoals.append(np.clip(point, -world.dog.airspace, world.arena.size + world.dog.airspace))
        drives.append(driving)
    return np.array(subgoals), np.array(drives)


def step(world, sheep, dogs, previous, velocity):
    """Eqs 10 and 11, with speeds in m/s, speed limits and walls."""
    forces = np.array([force(world, sheep, dogs, previous, i) for i in range(len(sheep))])
    speeds = np.array([[own(world.sheep.speed, i)] for i in range(len(sheep))])
    moved = sheep + speeds * world.arena.dt * forces
    flown = np.empty_like(dogs)
    for j in range(len(dogs)):
        told = velocity[j]
        if not np.all(np.isfinite(told)):
            told = np.zeros(2)
        if isinstance(world.dog.limits, PerAxis):
            told = np.clip(told, -world.dog.speed, world.dog.speed)
        elif length(told) > world.dog.speed:
            told = world.dog.speed * direction(told)
        flown[j] = dogs[j] + world.arena.dt * told
    edge = world.dog.airspace
    return (
        np.clip(moved, 0.0, world.arena.size),
        np.clip(flown, -edge, world.arena.size + edge),
        forces,
    )


def accomplished(world, sheep):
    """Eq. 12."""
    home = all(length(one - goal(world)) <= world.arena.goal_radius for one in sheep)
    return home and gathered(world, sheep)


def _nearly_equal(values):
    ordered = sorted(values)
    return any(b - a < CLOSE for a, b in pairwise(ordered))


def _nearly_cancels(v):
    return 0 < length(v) < CLOSE


def force_is_close_call(world, sheep, dogs, previous):
    """Whether rounding may decide a force: a sum that nearly cancels, or a tie of neighbours."""
    for i in range(len(sheep)):
        vectors = [
            escape(world, sheep, dogs, i),
            avoid(world, sheep, i),
            to_local_centre(world, sheep, i),
            total(world, sheep, dogs, previous, i),
        ]
        if any(_nearly_cancels(v) for v in vectors):
            return True
        if (nearest(world) or len(sheep)) < len(sheep) - 1:
            apart = [length(sheep[k] - sheep[i]) for k in range(len(sheep)) if k != i]
            if _nearly_equal(apart):
                return True
    return False


def range_is_close_call(world, sheep, dogs):
    """Whether rounding may decide who is in range of whom."""
    pairs = [(length(a - b), world.flock.sensing) for a in sheep for b in dogs]
    pairs += [(length(a - b), world.flock.avoidance) for a in sheep for b in sheep]
    return any(abs(distance - reach) < CLOSE for distance, reach in pairs)


def gathered_is_close_call(world, sheep):
    """Whether rounding may decide the gate."""
    return abs(furthest_distance(sheep) - gathering_distance(world, sheep)) < CLOSE


def gate_is_close_call(world, sheep, dogs):
    """Whether rounding may decide the gate, a stray, or which dog flies where."""
    centre = sheep.mean(axis=0)
    distances = [length(one - centre) for one in sheep]
    if gathered_is_close_call(world, sheep) or _nearly_equal(sorted(distances)[-len(dogs) - 1 :]):
        return True
    # Which dogs are free decides a rank: of several dogs any subset may be.
    free = [some for n in range(1, len(dogs) + 1) for some in combinations(dogs, n)]
    far = outside(world, sheep)
    if any(_nearly_equal([rank(world, sheep, i, some) for i in far]) for some in free):
        return True
    if any(abs(d - gathering_distance(world, sheep)) < CLOSE for d in distances):
        return True
    if 0 < length(centre - goal(world)) < CLOSE:
        return True
    if len(dogs) == 1:
        return False
    bearings = [bearing(world, sheep, dog) for dog in dogs]
    ahead = any(math.pi - abs(b) < CLOSE for b in bearings)
    lost = any(length(dog - centre) < CLOSE for dog in dogs) or length(centre - goal(world)) == 0
    choices = [
        _nearly_equal([length(dog - collecting_point(world, sheep, i)) for dog in dogs])
        for i in range(len(sheep))
    ]
    return ahead or lost or _nearly_equal(bearings) or any(choices)
