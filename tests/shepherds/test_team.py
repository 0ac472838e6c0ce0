"""Teams of dogs: their sectors, who leads, and that they keep apart."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skydog
from skydog.shepherds import rules, store
from skydog.shepherds.team import Team, separated
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world.state import start

WORLD = skydog.preset("strombom2014", sheep=12)


def drawn(seed: int, dogs: int, sheep: int = 12) -> skydog.State:
    return skydog.reset(WORLD, jax.random.key(seed), sheep, dogs)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), dogs=st.sampled_from([2, 3, 5]))
def test_dogs_that_change_places_change_their_velocities(seed, dogs):
    state = drawn(seed, dogs)
    shuffle = np.random.default_rng(seed).permutation(dogs)
    there = Team()(WORLD, start(state.sheep, state.dogs[shuffle]))
    np.testing.assert_allclose(there, Team()(WORLD, state)[shuffle], atol=1e-4)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), dogs=st.sampled_from([1, 2, 4]))
def test_it_does_not_matter_which_sheep_is_which(seed, dogs):
    state = drawn(seed, dogs)
    there = Team()(WORLD, start(state.sheep[::-1], state.dogs))
    np.testing.assert_allclose(there, Team()(WORLD, state), atol=1e-3)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), dogs=st.sampled_from([2, 3, 8]), apart=st.floats(0.5, 10.0))
def test_dogs_never_come_nearer_than_they_may(seed, dogs, apart):
    draw = np.random.default_rng(seed)
    # A crowd: pairs that are too near already, and pairs with little room.
    before = jnp.asarray(draw.uniform(-3.0, 12.0, (dogs, 2)), jnp.float32)
    wanted = jnp.asarray(draw.uniform(-3.0, 3.0, (dogs, 2)), jnp.float32)
    world = replace(WORLD, dog=replace(WORLD.dog, airspace=2.0))
    before = jnp.clip(before, -2.0, None)
    velocity = separated(world, before, wanted, apart)
    after = jnp.clip(before + world.arena.dt * velocity, -2.0, world.arena.size + 2.0)
    was, became = gaps(before), gaps(after)
    assert np.all(became >= np.minimum(was, apart) - 1e-4)
    assert np.all(np.linalg.norm(velocity, axis=1) <= world.dog.speed * (1 + 1e-5))


def gaps(places):
    away = np.linalg.norm(np.asarray(places[:, None] - places[None, :]), axis=-1)
    return away[np.triu_indices(len(places), 1)]


def test_dogs_that_have_room_fly_as_they_like():
    dogs = jnp.array([[10.0, 10.0], [90.0, 90.0]])
    wanted = jnp.array([[1.0, 0.5], [-1.0, 0.5]])
    np.testing.assert_allclose(separated(WORLD, dogs, wanted, 2.0), wanted, atol=1e-6)


def test_in_a_scattered_flock_two_dogs_have_strays_of_their_own():
    sheep = jnp.array([[100.0, 140.0], [140.0, 100.0], [100.0, 100.0], [101.0, 101.0]])
    dogs = jnp.array([[90.0, 148.0], [148.0, 90.0]])
    team = Team(spacing=1.0)
    subgoal, drives, _ = team.subgoals(skydog.preset("strombom2014", sheep=4), start(sheep, dogs))
    assert not drives.any()
    nearest = np.argmin(np.linalg.norm(subgoal[:, None] - sheep[None], axis=-1), axis=1)
    assert set(nearest) == {0, 1}


def test_a_gathered_flock_is_driven_by_all_dogs_from_behind():
    sheep = 100.0 + jax.random.normal(jax.random.key(0), (12, 2))
    dogs = jnp.array([[120.0, 100.0], [100.0, 120.0], [125.0, 125.0]])
    subgoal, drives, _ = Team().subgoals(WORLD, start(sheep, dogs))
    assert drives.all()
    assert np.all((subgoal - 100.0) @ np.ones(2) > 0.0)


def test_one_sheep_and_sheep_on_one_point_give_finite_velocities():
    for sheep in (jnp.full((1, 2), 50.0), jnp.full((6, 2), 75.0), jnp.zeros((3, 2))):
        velocity = Team()(WORLD, start(sheep, jnp.full((3, 2), 75.0)))
        assert np.isfinite(velocity).all()


def test_three_dogs_need_fewer_steps_than_one_rule_dog():
    steps = {}
    for name, dogs in (("strombom", 1), ("team", 3)):
        starts = cases(WORLD, 10, "random", 5, 12, dogs)
        key = evaluate.noise_key(WORLD, 5)
        flown = evaluate.fly(WORLD, rules.read(name)[0], starts, 1000, key, None)
        steps[name] = evaluate.measure(flown)["steps"].mean()
    assert steps["team"] < 0.9 * steps["strombom"]


def test_a_dog_herds_sheep_that_see_less_far_than_their_flock_is_wide():
    world = skydog.preset("paper", 10.0, sheep=10)
    flown = evaluate.fly(world, Team(), cases(world, 4, "random", sheep=10), 1_000)
    assert flown.accomplished.any(axis=1).all()


def test_a_team_flies_with_the_skills_of_a_sheepdog_by_name():
    team, card = rules.read("team:h-ddpg-4x4")
    assert card["name"] == "H-DDPG-4x4"
    assert isinstance(team, Team)
    state = drawn(3, 2)
    velocity = team(WORLD, state)
    assert velocity.shape == (2, 2)
    assert not np.allclose(velocity, Team()(WORLD, state))
    assert evaluate.scenario(team, WORLD, card["name"], 12, 2).startswith("Team-H-DDPG-4x4to150")


def test_a_team_of_a_sheepdog_that_there_is_not_is_refused():
    with pytest.raises(skydog.Refusal, match="no sheepdog is called h-ddpg-44"):
        rules.read("team:h-ddpg-44")


def test_steering_to_the_gates_subgoals_is_what_a_sheepdog_does():
    from skydog.world import herding

    dog, state = store.load("h-ddpg-4x4"), drawn(1, 2)
    subgoal, drives = herding.gate(WORLD, state.sheep, state.dogs)
    np.testing.assert_array_equal(dog(WORLD, state), dog.steer(WORLD, state, subgoal, drives))
