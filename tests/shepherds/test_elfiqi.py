import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds.elfiqi import ElFiqi
from skydog.world import herding, mission
from skydog.world.presets import preset
from skydog.world.state import State

WORLD = preset("elfiqi2020", sheep=4)
F = 0.4 * math.sqrt(8)
FLOCK = jnp.array([[25.5, 20.0], [24.5, 20.0], [25.0, 20.5], [25.0, 19.5]])  # gathered
CENTRE = np.array([25.0, 20.0])
POINT = np.array([25.0, 20.0 - F - 4.0])  # behind the flock, the goal being at (25, 50)
CLEAR = F + 4.0 + 10.0


def velocity(dog, world=WORLD, shepherd=None, sheep=FLOCK):
    state = mission.start(sheep, jnp.array([dog], jnp.float32))
    return np.asarray((shepherd or ElFiqi())(world, state)[0])


def at(bearing, radius):
    return CENTRE + radius * np.array([math.cos(bearing), math.sin(bearing)])


def test_a_dog_far_from_the_flock_flies_straight_to_its_point_at_full_speed():
    dog = np.array([25.0 + 30.0, 20.0])
    way = POINT - dog
    np.testing.assert_allclose(velocity(dog), 2.0 * way / np.linalg.norm(way), atol=1e-5)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_dog_on_the_circle_goes_a_tenth_of_a_radian_along_it_on_the_shorter_side(side):
    bearing = math.pi / 2 + side * 0.8
    there = at(bearing, CLEAR) + velocity(at(bearing, CLEAR)) - CENTRE
    assert math.isclose(np.linalg.norm(there), CLEAR, rel_tol=1e-4)
    turned = math.atan2(there[1], there[0]) - bearing
    assert math.isclose(math.remainder(turned, 2 * math.pi), side * 0.1, rel_tol=1e-3)


def test_a_dog_inside_the_circle_flies_out_first_and_never_faster_than_it_can():
    flown = velocity(at(0.0, 6.0))
    assert flown[0] > 1.0
    assert np.linalg.norm(flown) <= 2.0 + 1e-5


def test_a_dog_that_has_its_points_bearing_flies_straight_at_it():
    for off in (-0.1, 0.1):
        dog = at(-math.pi / 2 + off, CLEAR - 1.0)
        way = POINT - dog
        np.testing.assert_allclose(velocity(dog), 2.0 * way / np.linalg.norm(way), atol=1e-4)


@pytest.mark.parametrize("off", [-0.15, 0.15])
def test_bearings_on_either_side_of_west_are_near_each_other(off):
    # The goal in the east, the point in the west, where bearings jump from π to -π.
    world = replace(WORLD, arena=replace(WORLD.arena, goal_x=50.0, goal_y=20.0))
    dog = at(math.pi + off, CLEAR - 1.0)
    way = np.array([25.0 - F - 4.0, 20.0]) - dog
    np.testing.assert_allclose(velocity(dog, world), 2.0 * way / np.linalg.norm(way), atol=1e-4)


def test_a_reach_of_its_own_makes_the_circle_wider():
    bearing, wide = math.pi / 2 + 0.8, F + 4.0 + 20.0
    there = at(bearing, wide) + velocity(at(bearing, wide), shepherd=ElFiqi(reach=20.0)) - CENTRE
    assert np.linalg.norm(there) > wide - 0.5


def test_a_flock_without_reach_is_disturbed_as_far_as_it_sees(unchecked):
    class Mute(eqx.Module):
        def force(self, state, key):
            return state.force

    paper = preset("paper", 40.0)
    assert ElFiqi()._reach(paper) == paper.flock.sensing
    with pytest.raises(Refusal, match=r"ElFiqi\(reach="):
        velocity((0.0, 0.0), replace(WORLD, flock=Mute()))


@pytest.mark.parametrize("dog", [CENTRE, POINT, (25.0, 20.5), (math.nan, 0.0)])
def test_no_place_of_a_dog_gives_a_velocity_that_is_no_number(dog):
    state = State(FLOCK, jnp.array([dog], jnp.float32), jnp.zeros_like(FLOCK))
    flown = jax.jit(lambda w, s: ElFiqi()(w, s))(WORLD, state)
    assert np.all(np.isfinite(flown))


def test_a_lone_sheep_under_the_dog_and_at_the_goal_gives_a_velocity_too():
    place = jnp.array([[25.0, 50.0]])
    assert np.all(np.isfinite(velocity(place[0], sheep=place)))


def test_several_dogs_fly_each_to_its_own_point():
    dogs = jnp.array([[10.0, 0.0], [40.0, 0.0]])
    state = mission.start(FLOCK, dogs)
    subgoal, _ = herding.gate(WORLD, FLOCK, dogs)
    flown, way = np.asarray(ElFiqi()(WORLD, state)), np.asarray(subgoal - dogs)
    along = np.sum(flown * way, axis=1) / np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(along, 2.0, atol=1e-4)
