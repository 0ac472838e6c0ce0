import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.shepherds.rearmost import Rearmost
from skydog.study import cases, evaluate
from skydog.world.presets import preset
from skydog.world.state import State

WORLD = preset("strombom2014", sheep=4)  # f(N) is 5.04 m, the goal's radius 10 m
F = 2.0 * 4 ** (2 / 3)
MOVED = jnp.ones((4, 2))
SHEEP = jnp.array([[60.0, 0.0], [0.0, 90.0], [40.0, 40.0], [3.0, 3.0]])


def velocity(dog, sheep=SHEEP, force=MOVED, shepherd=None):
    state = State(sheep, jnp.array([dog], jnp.float32), force)
    return np.asarray((shepherd or Rearmost())(WORLD, state)[0])


def towards(dog, point):
    return 1.5 * (point - dog) / np.linalg.norm(point - dog)


def plainly(sheep, dog, force, far=1.5 * F):
    """Where the dog flies to, in plain NumPy."""
    away = np.linalg.norm(sheep, axis=1)
    rank = away - 0.5 * np.linalg.norm(sheep - dog, axis=1)
    left = away > 8.0
    taken = np.argmax(np.where(left, rank, -np.inf) if left.any() else rank)
    if not force[taken].any():
        return sheep[taken]
    if away[taken] == 0.0:
        return sheep[taken]
    out = sheep[taken] / away[taken]
    now = (dog - sheep[taken]) @ out
    return sheep[taken] + (min(now, far) if now > 0 else far) * out


places = st.tuples(st.floats(0.0, 150.0, width=16), st.floats(0.0, 150.0, width=16))


@given(
    st.lists(places | st.just((0.0, 0.0)) | st.just((1.0, 2.0)), min_size=4, max_size=4),
    places,
    st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_it_flies_as_its_rule_says(sheep, dog, moves):
    sheep, dog = np.array(sheep), np.array(dog)
    force = np.where(np.array(moves)[:, None], [0.6, 0.8], 0.0)
    flown = velocity(dog, jnp.asarray(sheep, jnp.float32), jnp.asarray(force, jnp.float32))
    point = plainly(sheep, dog, force)
    if np.linalg.norm(point - dog) > 0.01:
        np.testing.assert_allclose(flown, towards(dog, point), atol=0.02)
    assert np.isfinite(flown).all()


def test_the_sheep_with_the_longest_way_is_driven_from_far_behind_it():
    np.testing.assert_allclose(
        velocity([20.0, 70.0]), towards(np.array([20.0, 70.0]), [0.0, 90.0 + 1.5 * F]), atol=1e-3
    )


def test_a_sheep_at_hand_comes_before_one_that_is_a_little_further_from_home():
    dog = np.array([70.0, 10.0])  # 14 m from one sheep and 106 m from the other
    np.testing.assert_allclose(velocity(dog), towards(dog, [60.0 + 1.5 * F, 0.0]), atol=0.3)
    last = velocity(dog, shepherd=Rearmost(nearness=0.0))
    np.testing.assert_allclose(last, towards(dog, [0.0, 90.0 + 1.5 * F]), atol=1e-3)


def test_a_sheep_that_stands_is_flown_to_and_one_that_moves_is_not_left():
    dog = np.array([0.0, 93.0])
    still = jnp.zeros((4, 2))
    np.testing.assert_allclose(velocity(dog, force=still), [0.0, -1.5], atol=1e-5)
    np.testing.assert_allclose(velocity(dog), [0.0, 0.0], atol=1e-5)


def test_no_sheep_that_is_home_is_taken_while_another_is_not():
    sheep = jnp.array([[0.0, 9.0], [7.9, 0.0], [7.0, 0.0], [0.0, 7.0]])
    dog = np.array([12.0, 0.0])
    assert velocity(dog, sheep)[1] > 0.0


@pytest.mark.parametrize("kind", ["loner", "short-sighted"])
def test_it_brings_a_small_flock_home_of_which_half_is_of_another_kind(unchecked, kind):
    world = preset("strombom2014", 60.0, 4, mix={kind: 0.5})
    starts = cases.cases(world, 2, "random", 4, 4)
    flown = evaluate.fly(world, Rearmost(), starts, 2000, evaluate.noise_key(world, 4), None)
    assert np.asarray(flown.accomplished[:, -1]).all()
