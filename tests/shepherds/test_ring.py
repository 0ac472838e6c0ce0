import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.shepherds import finding
from skydog.shepherds.ring import Ring
from skydog.shepherds.rules import RULES
from skydog.world import mission
from skydog.world.presets import preset

WORLD = preset("lama2024")
RING = Ring()


def drawn(seed, sheep, dogs, within=20.0):
    draw = np.random.default_rng(seed)
    return (25.0 + draw.uniform(-within, within, (many, 2)) for many in (sheep, dogs))


def velocity(sheep, dogs):
    return np.asarray(RING(WORLD, mission.start(jnp.asarray(sheep), jnp.asarray(dogs))))


@given(st.integers(0, 2**31))
def test_no_dog_and_no_sheep_has_a_part_of_its_own(seed):
    sheep, dogs = drawn(seed, 7, 4)
    draw = np.random.default_rng(seed)
    of_sheep, of_dogs = draw.permutation(7), draw.permutation(4)
    swapped = velocity(sheep[of_sheep], dogs[of_dogs])
    np.testing.assert_allclose(swapped, velocity(sheep, dogs)[of_dogs], atol=1e-3)


@given(st.integers(0, 2**31), st.sampled_from([1, 2, 3]))
def test_a_quarter_turn_of_the_world_turns_every_velocity(seed, quarters):
    sheep, dogs = drawn(seed, 7, 4)
    turn = np.linalg.matrix_power([[0.0, -1.0], [1.0, 0.0]], quarters)
    turned = velocity(25.0 + (sheep - 25.0) @ turn.T, 25.0 + (dogs - 25.0) @ turn.T)
    np.testing.assert_allclose(turned, velocity(sheep, dogs) @ turn.T, atol=1e-2)


def test_a_dog_right_behind_its_sheep_pushes_it_home():
    out = np.array([0.6, 0.8])
    sheep = 25.0 + 12.0 * out
    dog = sheep + (RING.offset + 0.1) * out
    moved = velocity([sheep], [dog])[0]
    np.testing.assert_allclose(moved / np.linalg.norm(moved), -out, atol=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_dog_on_the_goals_side_of_its_sheep_swings_around_it(side):
    sheep = np.array([37.0, 25.0])
    moved = velocity([sheep], [sheep + np.array([-2.0, 0.3 * side])])[0]
    assert np.sign(moved[1]) == side


def test_dogs_with_nothing_to_fetch_even_out_on_their_circle():
    state = mission.start(jnp.array([[25.0, 25.0]]), 25.0 + jnp.array([[4.0, 0.0], [4.0, 1.0]]))
    for _ in range(400):
        state = mission.State(state.sheep, state.dogs + 0.05 * RING(WORLD, state), state.force)
    dogs = np.asarray(state.dogs) - 25.0
    np.testing.assert_allclose(np.linalg.norm(dogs, axis=1), RING.guard, rtol=0.05)
    np.testing.assert_allclose(dogs[0], -dogs[1], atol=0.2)


def test_agents_at_one_point_are_no_error():
    middle = np.full((3, 2), 25.0)
    assert np.isfinite(velocity(middle, middle)).all()
    assert np.isfinite(velocity(middle + 10.0, middle + 10.0)).all()


def test_the_names_that_a_command_checks_are_those_of_the_rules():
    assert tuple(RULES) == finding.RULES
