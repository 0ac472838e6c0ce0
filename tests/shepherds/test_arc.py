import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds.arc import Arc
from skydog.world import mission
from skydog.world.presets import preset
from skydog.world.state import State

WORLD = preset("elfiqi2020", sheep=4)  # f(N) is 1.13 m
F = 0.4 * math.sqrt(8)
FLOCK = jnp.array([[25.5, 20.0], [24.5, 20.0], [25.0, 20.5], [25.0, 19.5]])  # 0.5 m from its centre
CENTRE = np.array([25.0, 20.0])
RING = 0.5 + F / 4
STRAYED = FLOCK.at[0, 0].add(4.0)


def velocity(dog, sheep=FLOCK, shepherd=None, world=WORLD):
    state = mission.start(sheep, jnp.array([dog], jnp.float32))
    return np.asarray((shepherd or Arc())(world, state)[0])


def towards(dog, point):
    return 2.0 * (point - dog) / np.linalg.norm(point - dog)


def test_a_dog_behind_the_flock_flies_straight_to_half_f_behind_its_centre():
    dog = CENTRE - np.array([1.0, 12.0])
    np.testing.assert_allclose(velocity(dog), towards(dog, CENTRE - [0.0, F / 2]), atol=1e-4)


def test_a_dog_collects_from_two_thirds_of_f_on_two_thirds_behind_the_stray():
    centre = np.asarray(STRAYED).mean(axis=0)
    for beyond, collects in ((0.05, True), (-0.05, False)):
        far = 4 / 3 * (2 / 3 * F + beyond)  # of one sheep of four from the other three's centre
        sheep = jnp.array([[25.0, 20.0]] * 3 + [[25.0 - far, 20.0]])
        centre = np.asarray(sheep).mean(axis=0)
        dog = centre - np.array([9.0, 3.0])
        stray = np.array([25.0 - far - 2 / 3 * F, 20.0])
        home = (np.array([25.0, 50.0]) - centre) / np.linalg.norm([25.0, 50.0] - centre)
        point = stray if collects else centre - F / 2 * home
        np.testing.assert_allclose(velocity(dog, sheep), towards(dog, point), atol=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_dog_before_the_flock_flies_around_it_on_the_shorter_side_at_full_speed(side):
    # Slow enough to see the circle: a tenth of a second in a step.
    world = replace(WORLD, arena=replace(WORLD.arena, dt=0.1))
    place = CENTRE + RING * np.array([math.sin(side * 0.5), math.cos(0.5)])
    least, angle = RING, []
    for _ in range(40):
        flown = velocity(place, world=world)
        place = place + 0.1 * flown
        if np.linalg.norm(place - CENTRE) < RING - 0.1:
            break
        assert math.isclose(np.linalg.norm(flown), 2.0, rel_tol=1e-4)
        least = min(least, np.linalg.norm(place - CENTRE))
        angle.append(side * math.atan2(*(place - CENTRE)))
    assert least > RING - 0.1
    # It leaves the circle half a radian before the bearing of its point.
    assert math.pi - 0.5 - 0.4 < angle[-1] < math.pi
    assert angle == sorted(angle)


def test_a_dog_that_is_told_to_flies_straight_through_the_flock():
    dog = CENTRE + np.array([0.1, 3.0])
    through = velocity(dog, shepherd=Arc(aligned=math.pi))
    np.testing.assert_allclose(through, towards(dog, CENTRE - [0.0, F / 2]), atol=1e-4)


def test_a_flock_and_an_arena_of_another_size_are_herded_alike():
    # Everything in twice the metres, speeds too: twice the velocity.
    twice = replace(
        WORLD,
        dog=replace(WORLD.dog, speed=4.0),
        spread=replace(WORLD.spread, length=0.8),
        arena=replace(WORLD.arena, size=100.0, goal_x=50.0, goal_y=100.0, goal_radius=20.0),
    )
    for sheep in (FLOCK, STRAYED):
        for dog in ((25.0, 22.0), (30.0, 10.0), (10.0, 20.0)):
            small = velocity(dog, sheep)
            large = velocity(np.multiply(2.0, dog), 2.0 * sheep, world=twice)
            np.testing.assert_allclose(large, 2.0 * small, atol=1e-3)


@pytest.mark.parametrize("dog", [CENTRE, CENTRE - [0.0, F / 2], (25.0, 20.5), (math.nan, 0.0)])
def test_no_place_of_a_dog_gives_a_velocity_that_is_no_number(dog):
    state = State(FLOCK, jnp.array([dog], jnp.float32), jnp.zeros_like(FLOCK))
    assert np.all(np.isfinite(jax.jit(lambda s: Arc()(WORLD, s))(state)))


def test_a_lone_sheep_under_the_dog_and_at_the_goal_gives_a_velocity_too():
    place = jnp.array([[25.0, 50.0]])
    assert np.all(np.isfinite(velocity(place[0], sheep=place)))
