import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.world import herding, mission
from skydog.world.limits import AnyDirection
from skydog.world.presets import preset

WIDE = preset("paper", 40.0)  # its walls are out of reach of a flock in the middle
FLOCK = jnp.array([[20.0, 20.0], [20.5, 20.0], [20.0, 20.5]])
CENTRE = np.mean(np.asarray(FLOCK), axis=0)
POINT = CENTRE + math.sqrt(3) * CENTRE / np.linalg.norm(CENTRE)  # to be driven to (0, 0)


def per_length(world, speed=1.0):
    return replace(world, dog=replace(world.dog, limits=AnyDirection(), speed=speed))


def velocity(shepherd, world, dog):
    return np.asarray(shepherd(world, mission.start(FLOCK, jnp.array([dog], jnp.float32)))[0])


def after_one_step(shepherd, world, dog):
    state = mission.start(FLOCK, jnp.array([dog], jnp.float32))
    return np.asarray(mission.step(world, state, shepherd(world, state)).dogs[0])


@pytest.mark.parametrize("world", [WIDE, per_length(WIDE)])
def test_a_dog_far_from_its_point_flies_straight_to_it_at_full_speed(world):
    dog = POINT + np.array([3.0, -4.0])
    flown = velocity(Strombom(), world, dog)
    full = 1.0 if world.dog.limits == AnyDirection() else 5 / 4
    np.testing.assert_allclose(flown, full * np.array([-0.6, 0.8]), atol=1e-5)


@pytest.mark.parametrize("world", [WIDE, per_length(WIDE)])
def test_a_dog_that_arrives_stops_exactly_on_its_point(world):
    dog = POINT + np.array([0.03, -0.04])
    there = after_one_step(Strombom(at_point="arrive"), world, dog)
    np.testing.assert_allclose(there, POINT, atol=1e-5)


@pytest.mark.parametrize("world", [WIDE, per_length(WIDE)])
def test_a_dog_of_constant_speed_overshoots_its_point(world):
    dog = POINT + np.array([0.03, -0.04])
    beyond = after_one_step(Strombom(at_point="constant"), world, dog) - POINT
    assert np.linalg.norm(velocity(Strombom(at_point="constant"), world, dog)) >= 1.0 - 1e-5
    np.testing.assert_allclose(beyond / np.linalg.norm(beyond), [-0.6, 0.8], atol=1e-3)


@pytest.mark.parametrize("at_point", ["arrive", "constant"])
def test_a_dog_stands_while_a_sheep_is_nearer_than_the_stall_distance(at_point):
    stalling = replace(WIDE, dog=replace(WIDE.dog, stall=1.0))
    shepherd = Strombom(at_point=at_point)
    assert np.array_equal(velocity(shepherd, stalling, (19.01, 20.0)), [0.0, 0.0])
    assert not np.array_equal(velocity(shepherd, stalling, (18.99, 20.0)), [0.0, 0.0])
    assert not np.array_equal(velocity(shepherd, WIDE, (19.01, 20.0)), [0.0, 0.0])


@pytest.mark.parametrize("world", [WIDE, per_length(WIDE)])
@pytest.mark.parametrize("speed", [0.3, 0.9])
def test_an_extra_speed_bounds_the_length_and_keeps_the_direction(world, speed):
    flown = velocity(Strombom(speed=speed), world, POINT + np.array([3.0, -4.0]))
    np.testing.assert_allclose(flown, speed * np.array([-0.6, 0.8]), atol=1e-5)


def test_an_extra_speed_cannot_exceed_the_worlds_limit():
    flown = velocity(Strombom(speed=100.0), per_length(WIDE), POINT + np.array([3.0, -4.0]))
    assert math.isclose(np.linalg.norm(flown), 1.0, rel_tol=1e-5)


def test_a_dog_on_its_point_hovers():
    world = preset("paper")
    corner = mission.start(jnp.zeros((3, 2)), jnp.zeros((1, 2)))
    subgoal, _ = herding.gate(world, corner.sheep, corner.dogs)
    assert np.array_equal(subgoal, corner.dogs)
    for at_point in ("arrive", "constant"):
        assert np.array_equal(Strombom(at_point=at_point)(world, corner), [[0.0, 0.0]])


@partial(jax.jit, static_argnames=("sheep", "dogs", "missions", "steps"))
def flown(world, shepherd, sheep=3, dogs=1, missions=20, steps=1000, key=None):
    """Which of `missions` random starts are accomplished, and after how many steps."""

    def one(start):
        trace = mission.rollout(
            world, shepherd, mission.reset(world, start, sheep, dogs), steps, key
        )
        return metrics.success(trace), metrics.steps(trace)

    return jax.vmap(one)(jax.random.split(jax.random.key(0), missions))


@pytest.fixture(scope="module")
def alone():
    return flown(preset("paper"), Strombom())


def test_the_rule_dog_accomplishes_the_papers_mission_from_twenty_random_starts(alone):
    assert np.all(alone[0])


def test_a_dog_that_does_not_move_accomplishes_nothing():
    assert not np.any(flown(preset("paper"), Strombom(speed=0.0))[0])


@pytest.mark.parametrize("dogs", [2, 3])
def test_several_dogs_accomplish_the_papers_mission_no_slower_than_one(alone, dogs):
    accomplished, steps = flown(preset("paper"), Strombom(), dogs=dogs)
    assert np.all(accomplished)
    assert np.mean(steps) <= np.mean(alone[1])


def test_the_rule_dog_herds_the_46_sheep_of_strombom_2014_within_their_noise():
    world = preset("strombom2014", sheep=46)
    accomplished, _ = flown(
        world, Strombom(), sheep=46, missions=3, steps=600, key=jax.random.key(1)
    )
    assert np.all(accomplished)
