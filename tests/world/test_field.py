"""The field of shortest ways, beside ways that a ruler measures."""

import math
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.world import field, obstacles
from skydog.world.obstacles import Obstacles

pytestmark = pytest.mark.usefixtures("unchecked")

SIDE, NODES = 10.0, 81
CELL = SIDE / (NODES - 1)


def walled(*walls, radius=0.05):
    ends = jnp.asarray(walls, jnp.float32).reshape(-1, 2, 2)
    return Obstacles(ends, jnp.full(len(ends), radius, jnp.float32))


def solved(walls, goal=(0.0, 0.0), radius=1.0, sides=(SIDE, SIDE), clearance=0.1):
    return field.solve(walls, goal, radius, sides, NODES, clearance, ahead=0.5)


def at(found, *places):
    distance, direction = found.at(jnp.asarray(places, jnp.float32))
    return np.asarray(distance), np.asarray(direction)


@pytest.mark.parametrize("goal", [(0.0, 0.0), (5.0, 5.0), (10.0, 3.0)])
@pytest.mark.parametrize("sides", [(10.0, 10.0), (10.0, 4.0), (3.0, 10.0)])
def test_in_the_open_it_is_the_straight_line(goal, sides):
    goal = tuple(min(at, side) for at, side in zip(goal, sides, strict=True))
    found = solved(walled(), goal, sides=sides)
    places = np.random.default_rng(0).uniform(0, sides, (400, 2))
    distance, direction = at(found, *places)
    straight = np.linalg.norm(places - goal, axis=1)
    far = straight > 1.0
    np.testing.assert_allclose(distance[far], straight[far], rtol=0.04, atol=CELL)
    home = (np.array(goal) - places)[far] / straight[far][:, None]
    assert np.sum(direction[far] * home, axis=1).min() > 0.97  # to 14°
    assert np.asarray(found.reached).all()


def test_around_one_wall_it_is_the_shortest_way_by_the_walls_end():
    # From the left wall to (6, 5): whoever is above goes by its end, a clearance off.
    found = solved(walled([(0, 5), (6, 5)]), goal=(1.0, 1.0), clearance=0.25)
    for x, y in ((1.0, 8.0), (3.0, 7.0), (0.5, 5.5), (4.0, 9.5)):
        corner = np.array([6.0, 5.0])
        around = math.dist((x, y), corner) + math.dist(corner, (1.0, 1.0))
        # Off the end by the wall's radius and the clearance, along an arc.
        distance = float(at(found, (x, y))[0][0])
        assert around * 0.99 < distance < (around + 0.3 * math.pi) * 1.04


def test_directions_lead_around_the_end_of_a_wall_and_then_home():
    found = solved(walled([(0, 5), (6, 5)]), goal=(1.0, 1.0))
    _, (above, below) = at(found, (2.0, 6.0), (6.0, 3.0))
    assert above[0] > 0.8
    assert below[0] < -0.8


@jax.jit
def followed(found, walls, places):
    """Where those come to who follow the field to 1 m from home, and how near to a wall."""

    def on(_, carry):
        places, closest = carry
        distance, direction = found.at(places)
        places = places + jnp.where((distance > 1.0)[:, None], CELL / 2 * direction, 0.0)
        return places, jnp.minimum(closest, jnp.min(obstacles.clearance(walls, places)))

    return jax.lax.fori_loop(0, int(8 * SIDE / (CELL / 2)), on, (places, jnp.inf))


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_who_follows_it_always_arrives_and_never_meets_a_wall(seed):
    draw = np.random.default_rng(seed)
    corners = draw.uniform(0, SIDE, (4, 2))
    ends = [(a, a + draw.uniform(-4, 4, 2)) for a in corners]
    walls = walled(*ends, radius=0.1)
    try:
        found = solved(walls, goal=(5.0, 5.0), clearance=0.2)
    except Refusal:
        return
    grid = np.argwhere(np.asarray(found.reached))
    places = jnp.asarray(draw.permutation(grid)[:60] * CELL, jnp.float32)
    places, closest = followed(found, walls, places)
    assert np.asarray(found.at(places)[0]).max() <= 1.0
    assert float(closest) > 0.0


def test_nodes_that_are_walled_in_have_no_way_home_but_a_way_out():
    box = [(6, 6), (9, 6), (9, 9), (6, 9), (6, 6)]
    found = solved(walled(*pairwise(box)))
    inside, outside = jnp.asarray([[7.5, 7.5]]), jnp.asarray([[3.0, 3.0]])
    assert not bool(found.reaches(inside)[0])
    assert bool(found.reaches(outside)[0])
    distance, direction = at(found, (7.5, 7.5))
    assert np.isfinite(distance).all()
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-5)


def test_a_wall_thinner_than_a_cell_does_not_leak():
    found = solved(walled([(0, 5.06), (10, 5.06)], radius=0.001), clearance=0.0)
    reached = np.asarray(found.reached)
    assert reached[:, :38].all()
    assert not reached[:, 43:].any()


def test_a_goal_within_an_obstacle_is_refused():
    with pytest.raises(Refusal, match="the goal at 5,5 lies within an obstacle; move it"):
        solved(walled([(5, 5), (5, 5)], radius=2.0), goal=(5.0, 5.0))
