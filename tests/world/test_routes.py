"""Dogs on the ground find the shortest way around obstacles."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate
from skydog.study.scenes import on_the_ground
from skydog.world import obstacles, routes, scenes
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

SIDE = 10.0

waypoint = jax.jit(lambda found, *where: found.waypoint(*where))


def grounded(name, sheep=3):
    """A named scene whose obstacles dogs have to go around too."""
    return on_the_ground(preset("paper", sheep=sheep, scene=name))


@jax.jit
def walked(found, walls, dog, target):
    """Where a dog comes to that goes to its waypoint, step by step, and how far it went."""

    def on(_, carry):
        dog, length = carry
        off = found.waypoint(walls, dog, target) - dog
        stride = jnp.minimum(jnp.linalg.norm(off), 0.05)
        wanted = dog + stride * off / jnp.maximum(jnp.linalg.norm(off), 1e-9)
        after = obstacles.moved(walls, dog, wanted, 0.0, SIDE)
        return after, length + jnp.linalg.norm(after - dog)

    return jax.lax.fori_loop(0, 800, on, (dog, 0.0))


def lines(*walls, radius=0.1):
    ends = jnp.asarray(walls, jnp.float32)
    return Obstacles(ends, jnp.full(len(ends), radius, jnp.float32), tall=True)


def test_a_dog_in_sight_of_its_target_goes_straight_there():
    walls = lines([[5, 0], [5, 6]])
    found = routes.solve(walls, 0.2, 0.0, (SIDE, SIDE))
    dogs = jnp.asarray([[1.0, 9.0], [1.0, 1.0]])
    target = jnp.asarray([[9.0, 9.0], [4.0, 1.0]])
    np.testing.assert_array_equal(waypoint(found, walls, dogs, target), target)


@pytest.mark.parametrize("radius", [0.05, 0.4])
def test_a_dog_behind_a_wall_goes_around_its_nearer_end_in_little_more_than_the_least_metres(
    radius,
):
    walls = lines([[5, 3], [5, 9]], radius=radius)
    found = routes.solve(walls, 0.2, 0.0, (SIDE, SIDE))
    dog, target = jnp.asarray([[3.0, 5.0]]), jnp.asarray([[7.0, 5.0]])
    place, length = walked(found, walls, dog, target)
    np.testing.assert_allclose(place, target, atol=1e-3)
    assert 2 * math.sqrt(4 + 4) < float(length) < 1.12 * (2 * math.sqrt(8) + 2 * radius)


def test_a_dog_gets_out_of_a_trap_of_which_every_way_begins_away_from_its_target():
    trap = [
        [(2, 2), (2, 8)],
        [(2, 8), (8, 8)],
        [(8, 8), (8, 2)],
        [(2, 2), (4, 2)],
        [(6, 2), (8, 2)],
    ]
    walls = lines(*trap)
    found = routes.solve(walls, 0.2, 0.0, (SIDE, SIDE))
    place, length = walked(found, walls, jnp.asarray([[5.0, 7.0]]), jnp.asarray([[5.0, 9.0]]))
    np.testing.assert_allclose(place, [[5.0, 9.0]], atol=1e-3)
    assert 15.0 < float(length) < 19.0


def test_a_target_within_an_obstacle_is_met_at_its_rim_and_one_that_is_walled_in_straight():
    walls = Obstacles(jnp.asarray([[[5.0, 5.0], [5.0, 5.0]]]), jnp.asarray([2.0]), tall=True)
    found = routes.solve(walls, 0.2, 0.0, (SIDE, SIDE))
    place, _ = walked(found, walls, jnp.asarray([[1.0, 5.0]]), jnp.asarray([[6.0, 5.0]]))
    np.testing.assert_allclose(place, [[7.0, 5.0]], atol=0.02)
    box = lines([(4, 4), (6, 4)], [(6, 4), (6, 6)], [(6, 6), (4, 6)], [(4, 6), (4, 4)])
    shut = routes.solve(box, 0.2, 0.0, (SIDE, SIDE))
    target = jnp.asarray([[5.0, 5.0]])
    np.testing.assert_array_equal(waypoint(shut, box, jnp.asarray([[1.0, 5.0]]), target), target)


def test_too_many_corners_are_refused():
    ends = np.random.default_rng(0).uniform(0, 1000, (400, 1, 2)).repeat(2, axis=1)
    many = Obstacles(jnp.asarray(ends, jnp.float32), jnp.full(400, 0.1))
    with pytest.raises(Refusal, match=r"400 obstacles have 3,[0-9]+ corners, too many"):
        routes.solve(many, 0.2, 0.0, (1000.0, 1000.0))


def test_only_dogs_that_go_around_have_routes():
    world = grounded("gate")
    assert world.routes is not None
    assert scenes.with_routes(replace(world, obstacles=None)).routes is None
    assert preset("paper", scene="gate").routes is None


@pytest.mark.parametrize("name", ["gate", "u-trap"])
def test_a_dog_on_the_ground_herds(name):
    world = grounded(name)
    starts = cases.cases(world, 2, "random", 11)
    trace = evaluate.fly(world, Strombom(), starts, 2500)
    assert bool(jnp.all(trace.accomplished[:, -1]))
    assert world.obstacles is not None
    apart = obstacles.clearance(world.obstacles, trace.dogs.reshape(-1, 2))
    assert float(jnp.min(apart)) >= 0.0
