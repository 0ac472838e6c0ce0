from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.shepherds import planner
from skydog.shepherds.planner import Config
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.world import mission
from skydog.world.limits import AnyDirection
from skydog.world.presets import preset
from skydog.world.state import start

WORLD = preset("paper", 4.0)
QUICK = Config(candidates=64, kept=16, iterations=10, rounds=4)
FLOCK = jnp.array([[1.8, 1.5], [1.6, 1.9], [2.0, 1.2]])
BESIDE = start(FLOCK, jnp.array([[1.0, 2.6]]))  # the dog has to go around the flock first


def flight(world, state, steps=200):
    """The rule dog's velocities, as far as it flew."""
    trace = mission.rollout(world, Strombom(), state, steps)
    return np.asarray(trace.command)[: int(metrics.steps(trace))]


RULE = flight(WORLD, BESIDE)
HOVER = np.zeros((40, 1, 2))


@pytest.fixture(scope="module")
def planned():
    return planner.plan(WORLD, BESIDE, [RULE], jax.random.key(0), QUICK)


@pytest.fixture(scope="module")
def toy():
    """The plan of two dogs that fly as fast in any direction, for a sheep and a short way."""
    world = replace(WORLD, dog=replace(WORLD.dog, limits=AnyDirection(), speed=0.8))
    # 0.46 m from the goal's disc of 2 m.
    state = start(jnp.array([[1.968, 1.476]]), jnp.array([[2.9, 1.9], [3.9, 3.9]]))
    return planner.plan(world, state, [flight(world, state)], jax.random.key(0), QUICK)


def test_a_sheep_on_a_short_way_comes_home_in_as_few_steps_as_the_bound(toy):
    assert (toy.accomplished, toy.steps) == (True, 10)  # at 0.05 m a step


def test_two_dogs_of_any_direction_stay_within_their_limits(toy):
    velocity = np.asarray(toy.velocity, float)
    assert velocity.shape == (10, 2, 2)
    assert np.all(np.linalg.norm(velocity, axis=-1) <= 0.8 + 1e-6)
    np.testing.assert_allclose(velocity, velocity.round(3), atol=1e-7)


def test_a_plan_is_shorter_than_the_rule_dogs_flight(planned):
    assert planned.accomplished
    assert planned.steps < len(RULE)


@pytest.mark.parametrize("flights", [[RULE], [RULE, HOVER], [HOVER, RULE]])
@pytest.mark.parametrize("iterations", [0, 1])
def test_a_plan_is_never_longer_than_its_best_flight(flights, iterations):
    hasty = replace(QUICK, iterations=iterations, rounds=1)
    found = planner.plan(WORLD, BESIDE, flights, jax.random.key(1), hasty)
    assert found.accomplished
    assert found.steps <= len(RULE)


def test_a_flight_that_fails_leads_to_a_plan_that_does_not():
    assert not planner.flown(WORLD, BESIDE, HOVER).accomplished
    found = planner.plan(WORLD, BESIDE, [HOVER], jax.random.key(0), QUICK)
    assert found.accomplished
    assert found.steps <= len(HOVER)


def test_of_flights_that_fail_the_longest_leaves_the_most_room():
    frozen = replace(QUICK, iterations=0, rounds=0)
    found = planner.plan(WORLD, BESIDE, [HOVER, HOVER[:5], HOVER[:0]], jax.random.key(0), frozen)
    assert (found.accomplished, found.steps) == (False, len(HOVER))


def test_a_plan_that_is_not_accepted_is_not_kept(planned):
    found = planner.plan(
        WORLD, BESIDE, [RULE], jax.random.key(0), QUICK, lambda plan: plan.steps > planned.steps + 1
    )
    assert planned.steps + 1 < found.steps <= len(RULE)


def test_the_same_key_gives_the_same_plan(planned):
    again = planner.plan(WORLD, BESIDE, [RULE], jax.random.key(0), QUICK)
    assert np.array_equal(again.velocity, planned.velocity)


def test_a_plan_is_accomplished_by_its_last_step_and_not_before(planned):
    trace = planner.fly(WORLD, BESIDE, planned.velocity)
    assert int(metrics.steps(trace)) == planned.steps
    assert np.flatnonzero(trace.accomplished).tolist() == [planned.steps]


def test_the_dogs_of_the_preset_use_no_more_than_each_axis_has(planned):
    assert np.all(np.abs(planned.velocity) <= 1.0)
    np.testing.assert_allclose(planned.velocity, np.round(planned.velocity, 3), atol=1e-7)


def test_flown_velocities_have_the_trace_that_their_shepherd_had():
    shepherds = mission.rollout(WORLD, Strombom(), BESIDE, 200)
    velocities = planner.fly(WORLD, BESIDE, jnp.asarray(RULE), steps=200)
    assert velocities.ending is not None
    assert int(velocities.ending.steps) == 200
    for one, other in zip(jax.tree.leaves(velocities), jax.tree.leaves(shepherds), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)


def test_a_mission_that_ends_before_its_velocities_do_is_cut_there():
    longer = np.concatenate([RULE, RULE])
    assert planner.flown(WORLD, BESIDE, longer).steps == len(RULE)


def test_velocities_are_rounded_towards_zero_and_rounded_ones_stay_as_they_are():
    odd = np.array([[[0.9996, -0.9996]], [[0.123, -0.123]]])
    rounded = planner.flown(WORLD, BESIDE, odd).velocity
    expected = np.array([[[0.999, -0.999]], [[0.123, -0.123]]], np.float32)
    assert np.array_equal(rounded, expected)
    assert np.array_equal(planner.flown(WORLD, BESIDE, rounded).velocity, expected)


def test_a_margin_asks_for_more_than_to_arrive():
    here = start(jnp.array([[2.05, 0.0]]), jnp.array([[2.5, 0.0]]))  # 2 m after one step, and no
    stands = np.zeros((1, 1, 2))
    assert planner.flown(WORLD, here, stands).accomplished
    assert not planner.flown(WORLD, here, stands, margin=1e-3).accomplished


def test_a_flock_at_home_needs_no_steps():
    home = start(jnp.array([[0.5, 0.5], [0.6, 0.5]]), jnp.array([[2.0, 2.0]]))
    found = planner.plan(WORLD, home, [HOVER], jax.random.key(0), QUICK)
    assert (found.accomplished, found.steps) == (True, 0)


@pytest.mark.parametrize(
    ("flights", "says"),
    [
        ([], "one flight or more"),
        ([np.zeros((9, 2, 2))], r"\(steps, 1, 2\), got \(9, 2, 2\)"),
        ([np.full((9, 1, 2), np.nan)], "not finite"),
    ],
)
def test_flights_of_nobody_of_other_dogs_or_of_no_numbers_are_refused(flights, says):
    with pytest.raises(Refusal, match=says):
        planner.plan(WORLD, BESIDE, flights, jax.random.key(0), QUICK)
