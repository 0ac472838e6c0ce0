"""Nobody passes an obstacle, and who touches none moves as if there were none."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from missions import Constant

from skydog.shepherds.strombom import Strombom
from skydog.world import mission, obstacles
from skydog.world.home import StraightHome
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset
from skydog.world.state import start

pytestmark = pytest.mark.usefixtures("unchecked")

SIDE = 10.0
WALLS, WALKERS = 4, 6  # one shape: it compiles once

moved = jax.jit(lambda walls, old, new: obstacles.moved(walls, old, new, 0.0, SIDE))
away = jax.jit(obstacles.away)
clearance = jax.jit(obstacles.clearance)


def nearest(wall, place):
    """The place of a segment nearest to others: the foot of the perpendicular, or an end."""
    first, last = np.asarray(wall, float)
    along = last - first
    if not along.any():
        return np.broadcast_to(first, np.shape(place))
    share = (np.asarray(place) - first) @ along / (along @ along)
    return first + np.clip(share, 0.0, 1.0)[..., None] * along


def off_each(walls, place):
    """How far a place is from the middle of each wall, in metres, and each wall's radius."""
    ends = np.asarray(walls.ends, float)
    off = [np.linalg.norm(place - nearest(wall, place), axis=-1) for wall in ends]
    return np.array(off), np.asarray(walls.radius, float)


def gap(walls, place):
    """How far a place is outside all walls, in metres."""
    off, radius = off_each(walls, place)
    return float(np.min(off - radius))


def depth(walls, before, after):
    """How near a straight way comes to the middle of a wall, in its radii."""
    off, radius = off_each(walls, np.linspace(before, after, 2000))
    return float(np.min(off / radius[:, None]))


def coordinates(low=0.0, high=SIDE):
    """On a lattice of 1/8 m, so that walls cross, touch and end on one another."""
    return st.integers(int(8 * low), int(8 * high)).map(lambda i: i / 8)


def places():
    return st.tuples(coordinates(), coordinates())


@st.composite
def walls(draw):
    """Walls that may cross, meet at sharp corners or be discs; thin ones and thick ones."""
    ends = [draw(st.tuples(places(), places())) for _ in range(WALLS)]
    ends[0] = (ends[0][0], ends[0][0])  # a disc
    ends[1] = (ends[2][0], ends[1][1])  # a corner
    radii = st.sampled_from([0.05, 0.1, 0.5, 1.5])
    radius = draw(st.lists(radii, min_size=WALLS, max_size=WALLS))
    return Obstacles(jnp.asarray(ends, jnp.float32), jnp.asarray(radius, jnp.float32))


@st.composite
def walks(draw):
    """Walls, walkers that are outside of them, and where they want to go: near or far."""
    them = draw(walls())
    before = np.array([draw(places()) for _ in range(WALKERS)])
    before = np.array([place for place in before if gap(them, place) >= 1e-3])
    if len(before) == 0:
        before = np.full((1, 2), 0.0 if gap(them, np.zeros(2)) >= 1e-3 else math.nan)
    before = np.resize(before, (WALKERS, 2))
    far = draw(st.sampled_from([0.02, 0.3, 2.0, 10.0]))
    angles = [draw(st.integers(0, 15)) * math.pi / 8 for _ in range(WALKERS)]
    after = before + far * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return them, before, np.clip(after, 0.0, SIDE)


def f32(array):
    return jnp.asarray(array, jnp.float32)


@given(walls(), st.lists(places(), min_size=WALKERS, max_size=WALKERS))
def test_the_clearance_is_that_of_the_nearest_place_of_the_nearest_wall(them, where):
    where = np.array(where)
    found = np.asarray(clearance(them, f32(where)))
    np.testing.assert_allclose(found, [gap(them, place) for place in where], atol=1e-4)
    _, out = away(them, f32(where))
    for i, place in enumerate(where):
        for k, wall in enumerate(np.asarray(them.ends)):
            off = place - nearest(wall, place)
            if np.linalg.norm(off) > 1e-3:
                np.testing.assert_allclose(out[i, k], off / np.linalg.norm(off), atol=1e-3)


@given(walks())
def test_nobody_ends_inside_an_obstacle_or_passes_one_or_leaves_the_arena(walk):
    them, before, after = walk
    if np.isnan(before).any():
        return
    for _ in range(3):  # on and on in the same direction: against the wall, and along it
        there = np.asarray(moved(them, f32(before), f32(after)), float)
        assert (there >= 0.0).all()
        assert (there <= SIDE).all()
        for old, new in zip(before, there, strict=True):
            assert gap(them, new) >= -1e-5
            if not np.array_equal(np.float32(old), np.float32(new)):
                assert depth(them, old, new) >= 0.499
        before, after = there, np.clip(there + (after - before), 0.0, SIDE)


@given(walks())
def test_who_touches_no_obstacle_moves_as_if_there_were_none(walk):
    them, before, after = walk
    there = np.asarray(moved(them, f32(before), f32(after)))
    for old, new, wanted in zip(before, there, np.asarray(f32(after)), strict=True):
        if not np.isnan(old).any() and gap(them, wanted) > 1e-3 and depth(them, old, wanted) > 1.02:
            np.testing.assert_array_equal(new, wanted)


def test_a_walker_slides_along_a_wall_into_a_corner_and_stays_there():
    wall = Obstacles(f32([[[0, 5], [10, 5]], [[8, 0], [8, 10]]]), f32([0.1, 0.1]))
    place = f32([[2.0, 4.0]])
    for _ in range(200):
        place = moved(wall, place, place + f32([[0.05, 0.05]]))
    np.testing.assert_allclose(place, [[7.9, 4.9]], atol=0.06)


def test_the_thinnest_wall_holds_far_from_the_origin():
    wall = Obstacles(f32([[[900, 990], [990, 990]]]), f32([0.05]))
    place = f32([[930.0, 989.0]])
    far = jax.jit(lambda walls, old, new: obstacles.moved(walls, old, new, 0.0, 1000.0))
    for _ in range(100):
        place = far(wall, place, place + f32([[0.04, 0.03]]))
    assert float(place[0, 1]) < 989.95
    assert float(place[0, 0]) > 933.0  # and it slides: rounding does not hold it


def test_gradients_are_finite_wherever_somebody_stands():
    wall = Obstacles(f32([[[2, 5], [8, 5]], [[5, 5], [5, 5]]]), f32([0.2, 1.0]))
    before = f32([[3.0, 4.0], [5.0, 5.0], [5.0, 3.9], [2.0, 5.0], [9.0, 5.0]])

    def far(after):
        return jnp.sum(obstacles.moved(wall, before, after, 0.0, SIDE) ** 2)

    slope = jax.jit(jax.grad(far))
    for step in (0.0, 0.3, 2.0):
        assert bool(jnp.all(jnp.isfinite(slope(before + step))))


def in_a_gate(sheep=5, **changes):
    world = preset("paper", sheep=sheep, scene="gate")
    assert world.obstacles is not None
    return replace(world, obstacles=replace(world.obstacles, **changes))


def test_sheep_and_a_flying_dog_away_from_the_walls_move_exactly_as_in_the_open():
    world = replace(in_a_gate(), home=StraightHome())
    bare = replace(world, obstacles=None)
    begin = mission.reset(world, jax.random.key(1), 5)
    with_walls, without = (mission.rollout(w, Strombom(), begin, 60) for w in (world, bare))
    assert float(jnp.min(clearance(world.obstacles, with_walls.sheep.reshape(-1, 2)))) > 0.0
    np.testing.assert_array_equal(with_walls.sheep, without.sheep)
    np.testing.assert_array_equal(with_walls.dogs, without.dogs)


def test_a_whole_mission_leaves_no_sheep_inside_a_wall():
    world = preset("paper", sheep=5, scene="clutter")
    begin = mission.reset(world, jax.random.key(4), 5)
    trace = mission.rollout(world, Strombom(), begin, 600)
    assert float(jnp.min(clearance(world.obstacles, trace.sheep.reshape(-1, 2)))) >= 0.0


@pytest.mark.parametrize("tall", [False, True])
def test_only_tall_obstacles_hold_a_dog(tall):
    world = in_a_gate(1, tall=tall)
    begin = start(f32([[11.0, 11.0]]), f32([[3.0, 7.0]]))
    dogs = mission.rollout(world, Constant(f32([0.0, -0.5])), begin, 60).dogs[:, 0]
    assert (float(dogs[-1, 1]) > 6.0) == tall


def test_obstacles_that_there_are_none_of_change_nothing():
    none = Obstacles(jnp.zeros((0, 2, 2)), jnp.zeros(0))
    place = f32([[1.0, 2.0]])
    np.testing.assert_array_equal(obstacles.moved(none, place, place + 1.0, 0.0, SIDE), place + 1.0)
    assert float(obstacles.clearance(none, place)[0]) == math.inf
