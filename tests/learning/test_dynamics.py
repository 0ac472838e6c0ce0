"""Bodies that obey late, as lessons of `--bodies physical` have them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.learning import dynamics
from skydog.learning.curriculum import Curriculum
from skydog.learning.lessons import Lesson
from skydog.world.presets import preset

DT = 0.1


def body(lag, delay=0.0, drift=(0.0, 0.0)):
    drawn = dynamics.draw(jax.random.key(0))
    values = jnp.asarray(lag), jnp.asarray(delay), jnp.asarray(drift)
    return eqx.tree_at(lambda b: (b.lag, b.delay, b.drift), drawn, values)


def flights(of, command, steps):
    flown = []
    for _ in range(steps):
        of, velocity = dynamics.obey(of, jnp.asarray(command), 1.0, DT)
        flown.append(np.asarray(velocity))
    return of, np.array(flown)


def test_a_dog_without_lag_delay_or_drift_flies_as_commanded():
    _, flown = flights(body(1e-4), (0.6, -0.8), 3)
    np.testing.assert_allclose(flown[1:], [(0.6, -0.8)] * 2, atol=2e-3)


@given(lag=st.floats(0.05, 0.8), steps=st.integers(1, 20))
def test_what_a_lagging_dog_flies_is_the_integral_of_its_velocity(lag, steps):
    after, flown = flights(body(lag), (1.0, 0.0), steps)
    time = steps * DT
    np.testing.assert_allclose(after.velocity[0], 1 - np.exp(-time / lag), atol=1e-5)
    metres = time - lag * (1 - np.exp(-time / lag))
    np.testing.assert_allclose(flown[:, 0].sum() * DT, metres, atol=1e-4)


def test_a_delay_of_a_step_flies_the_command_before():
    _, flown = flights(body(1e-4, delay=DT), (1.0, 0.0), 3)
    np.testing.assert_allclose(flown[:, 0], [0.0, 1.0, 1.0], atol=2e-3)


def test_a_dog_drifts_by_a_share_of_its_speed():
    after, _ = flights(body(0.2, drift=(0.1, -0.05)), (0.0, 0.0), 40)
    np.testing.assert_allclose(after.velocity, (0.1, -0.05), atol=1e-4)


def test_bodies_are_drawn_within_their_ranges():
    drawn = jax.vmap(dynamics.draw)(jax.random.split(jax.random.key(1), 500))
    for values, (least, most) in (
        (drawn.lag, dynamics.LAG),
        (drawn.delay, dynamics.DELAY),
        (drawn.sheep_share, dynamics.SHEEP_SHARE),
    ):
        assert least <= float(values.min()) < float(values.max()) <= most
        assert float(np.ptp(values)) > 0.8 * (most - least)


@pytest.mark.parametrize("skill", ["collect", "drive"])
def test_in_a_lesson_of_late_bodies_the_dog_comes_less_far_at_first(skill):
    world = preset("paper", 4.0)
    lessons = {how: Lesson(world, skill, bodies=how) for how in ("ideal", "physical")}
    moved = {}
    for how, lesson in lessons.items():
        episode = lesson.start(jax.random.key(3))
        after, _ = lesson.step(episode, jnp.asarray((0.5, 0.5)))
        moved[how] = float(np.linalg.norm(after.state.dogs - episode.state.dogs))
    assert 0.0 < moved["physical"] < 0.8 * moved["ideal"]


def test_a_curriculum_of_late_bodies_has_a_name_and_a_card_of_its_own():
    ideal, physical = Curriculum(arena=4.0), Curriculum(arena=4.0, bodies="physical")
    assert physical.dog == f"{ideal.dog}-physical"
    assert physical.card() == {**ideal.card(), "bodies": "physical"}
