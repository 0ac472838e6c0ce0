import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import numbers, states
from hypothesis import given

from skydog.errors import Refusal
from skydog.world import mission, params, serialise
from skydog.world.end import ShareHome
from skydog.world.laws.diffusive import DiffusiveFlock, diffusing
from skydog.world.presets import preset

WORLD = preset("lama2024")


@jax.jit
def pushed(flock, state):
    return flock.force(state, None)


def expected(flock, sheep, dogs):
    """Lama & di Bernardo 2024, Eq. 1, without its noise."""
    force = np.zeros_like(sheep)
    for i, at in enumerate(sheep):
        for dog in dogs:
            distance = math.hypot(*(at - dog))
            if 0.0 < distance < flock.sensing:
                force[i] += flock.strength * (flock.sensing - distance) * (at - dog) / distance
    return force


@given(states(0.0, 4.0))
def test_a_sheep_is_pushed_by_every_dog_in_reach_as_in_the_paper(state):
    sheep, dogs, _ = numbers(state)
    force = pushed(WORLD.flock, state)
    np.testing.assert_allclose(force, expected(WORLD.flock, sheep, dogs), atol=1e-4)


def test_sheep_that_no_dog_is_near_do_not_move_without_noise():
    state = mission.start(jnp.array([[1.0, 1.0], [1.0, 1.0]]), jnp.array([[9.0, 9.0]]))
    np.testing.assert_array_equal(pushed(WORLD.flock, state), 0.0)


def test_each_sheep_may_be_pushed_in_its_own_way():
    state = mission.start(jnp.array([[1.0, 0.0], [0.0, 1.0]]), jnp.zeros((1, 2)))
    flock = DiffusiveFlock(jnp.array([0.5, 2.0]), jnp.array([9.0, 3.0]), 0.0)
    np.testing.assert_allclose(flock.force(state, None), [[0.0, 0.0], [0.0, 3.0]])
    assert not flock.noisy


def test_a_parameter_for_another_number_of_sheep_is_refused():
    state = mission.start(jnp.zeros((3, 2)), jnp.zeros((1, 2)))
    with pytest.raises(Refusal, match="one number per sheep"):
        DiffusiveFlock(jnp.array([0.5, 2.0]), 3.0, 0.0).force(state, None)


def test_the_force_has_finite_gradients_where_dog_and_sheep_meet():
    def reach(sheep):
        return jnp.sum(WORLD.flock.force(mission.start(sheep, jnp.zeros((1, 2))), None) ** 2)

    assert np.isfinite(jax.grad(reach)(jnp.zeros((2, 2)))).all()


def test_sheep_diffuse_by_2_d_t_on_each_axis():
    world = preset("lama2024", 1_000.0, sheep=4_000)
    middle = jnp.full((4_000, 2), 500.0)
    state = mission.start(middle, jnp.zeros((1, 2)))
    for step in range(20):
        state = mission.step(world, state, jnp.zeros((1, 2)), jax.random.key(step))
    spread = np.mean(np.square(state.sheep - middle), axis=0)
    np.testing.assert_allclose(spread, 2.0 * 1.0 * 20 * 0.05, rtol=0.1)
    assert diffusing(2.0, 0.01) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("home", "sheep", "over"), [(99, 100, True), (98, 100, False), (24, 25, False), (25, 25, True)]
)
def test_a_herd_is_captured_from_a_share_on(home, sheep, over):
    places = jnp.where(jnp.arange(sheep)[:, None] < home, 25.0, 40.0) * jnp.ones(2)
    state = mission.start(places, jnp.zeros((1, 2)))
    assert bool(mission.accomplished(WORLD, state)) == over


# Of these, the float32 product of share and sheep is more than the sheep that are home.
@pytest.mark.parametrize(("home", "sheep"), [(122, 173), (213, 303), (451, 644)])
def test_rounding_asks_for_no_sheep_more_than_the_share(home, sheep):
    share = home / sheep
    assert np.float32(share) * np.float32(sheep) > home
    world = replace(WORLD, end=ShareHome(share))
    places = jnp.where(jnp.arange(sheep)[:, None] < home, 25.0, 40.0) * jnp.ones(2)
    state = mission.start(places, jnp.zeros((1, 2)))
    assert world.end.accomplished(params.traced(world), state)


def test_a_file_keeps_the_world_of_lama():
    values = serialise.flatten(WORLD)
    assert serialise.flatten(serialise.unflatten(values)) == values
    assert type(serialise.unflatten(values).flock) is DiffusiveFlock
