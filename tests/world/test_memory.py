"""Fear that fades and sheep last seen: the state's memory, and what dogs see."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate
from skydog.world import memory, mission
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset
from skydog.world.serialise import flatten, unflatten
from skydog.world.sight import Sight, seen
from skydog.world.state import Memory, State, start

WORLD = preset("strombom2014", sheep=3)
CALM = replace(WORLD, flock=replace(WORLD.flock, noise=0.0, graze=0.0))
USED = replace(CALM, habituation=0.1)
NEAR = replace(CALM, sight=Sight(20.0))
BOTH = replace(USED, sight=Sight(20.0))
# One sheep that the dog sees, one beyond its sight, and one that does not see it either.
SHEEP = jnp.array([[70.0, 70.0], [100.0, 100.0], [140.0, 140.0]])
STATE = start(SHEEP, jnp.array([[80.0, 70.0]]))


def remembered(state):
    assert state.memory is not None
    return state.memory


def fly(world, state, steps=5, shepherd=None):
    return mission.rollout(world, shepherd or Strombom(), state, steps)


# Where it is off


def test_a_world_that_asks_for_no_memory_has_a_state_without_one():
    after = mission.step(CALM, mission.reset(CALM, jax.random.key(0)), jnp.ones((1, 2)))
    assert after.memory is None
    assert jax.tree.structure(after) == jax.tree.structure(State(SHEEP, SHEEP[:1], SHEEP))
    assert mission.perceive(CALM, after) is after


def test_a_memory_of_another_world_is_left_behind():
    assert memory.begin(CALM, memory.begin(BOTH, STATE)).memory is None
    kept = remembered(memory.begin(NEAR, memory.begin(BOTH, STATE)))
    assert kept.fear is None
    np.testing.assert_array_equal(np.asarray(kept.last_seen), SHEEP)


# Where it is on


@pytest.mark.parametrize("world", [USED, NEAR, BOTH], ids=["fear", "sight", "both"])
def test_a_state_made_by_hand_flies_as_one_whose_memory_was_begun(world):
    begun = memory.begin(world, STATE)
    assert jax.tree.structure(mission.step(world, STATE, jnp.zeros((1, 2)))) == (
        jax.tree.structure(begun)
    )
    by_hand, as_begun = (fly(world, state) for state in (STATE, begun))
    assert np.array_equal(by_hand.sheep, as_begun.sheep)
    assert np.array_equal(by_hand.dogs, as_begun.dogs)


def test_step_by_step_a_mission_is_that_of_a_rollout_and_of_a_study():
    state, shepherd = mission.reset(BOTH, jax.random.key(1)), Strombom()
    starts = cases.cases(BOTH, 1, "random", 1)
    assert starts.memory is None
    once = jax.tree.map(lambda leaf: leaf[None], replace(state, memory=None))
    flown = evaluate.fly(BOTH, shepherd, once, 30)
    trace = fly(BOTH, state, 30)
    for _ in range(30):
        state = mission.step(BOTH, state, mission.decide(BOTH, shepherd, state).velocity)
    np.testing.assert_allclose(trace.sheep[-1], state.sheep, atol=1e-3)
    np.testing.assert_allclose(flown.sheep[0, -1], state.sheep, atol=1e-3)


def test_fear_fades_while_a_dog_is_in_sight_and_stays_when_it_is_not():
    state = STATE
    for _ in range(4):
        state = mission.step(USED, state, jnp.zeros((1, 2)))
    np.testing.assert_allclose(
        np.asarray(remembered(state).fear), np.exp([-0.4, -0.4, 0.0]), rtol=1e-5
    )


def test_fear_is_a_factor_of_each_sheeps_escape():
    fear = jnp.array([0.5, 0.0, 1.0])
    state = replace(STATE, memory=Memory(fear=fear))
    weak = replace(CALM.flock, escape=CALM.flock.escape * fear)
    decided = mission.decide(USED, Strombom(), state)
    np.testing.assert_allclose(decided.force, weak.force(STATE, None), atol=1e-6)


def test_a_rate_may_differ_from_sheep_to_sheep():
    world = replace(CALM, habituation=np.array([0.0, 0.2, 0.2], np.float32))
    state = mission.step(world, STATE, jnp.zeros((1, 2)))
    np.testing.assert_allclose(
        np.asarray(remembered(state).fear), [1.0, np.exp(-0.2), 1.0], rtol=1e-5
    )


def test_sheep_that_flee_from_nobody_cannot_get_used_to_dogs():
    class Still(type(CALM.home)):
        noisy = False

        def force(self, state, key):
            return jnp.zeros_like(state.sheep)

    with pytest.raises(Refusal, match="Still cannot get used to dogs"):
        mission.check(replace(USED, flock=Still()), 3)


def test_dogs_see_a_sheep_out_of_sight_where_it_was_last_seen():
    state = mission.step(NEAR, STATE, jnp.zeros((1, 2)))
    shown = mission.perceive(NEAR, state)
    assert np.array_equal(shown.sheep[0], state.sheep[0])
    assert not np.array_equal(state.sheep[1], SHEEP[1])
    assert np.array_equal(shown.sheep[1], SHEEP[1])


def test_a_shepherd_is_given_what_dogs_see():
    state = mission.step(NEAR, STATE, jnp.zeros((1, 2)))
    given = []

    def shepherd(world, state):
        given.append(state.sheep)
        return jnp.zeros_like(state.dogs)

    mission.decide(NEAR, shepherd, state)
    assert np.array_equal(given[0], mission.perceive(NEAR, state).sheep)


def test_a_world_with_sight_and_habit_comes_back_from_a_file_and_an_older_file_has_neither():
    world = replace(CALM, sight=Sight(20.0, 2.0, 0.5), habituation=0.25)
    back = unflatten(flatten(world))
    assert (back.sight, back.habituation) == (world.sight, 0.25)
    older = unflatten(flatten(CALM))
    assert older.sight is None
    assert older.habituation is None


# Sight


def plainly(sight, sheep, dogs, known):
    """`seen` in plain Python, without obstacles."""
    found = []
    for one, at in enumerate(sheep):
        sees = False
        for dog in dogs:
            line, ahead = at - dog, known.mean(axis=0) - dog
            distance = np.hypot(*line)
            near = distance <= sight.radius
            if np.hypot(*ahead) > 0 and distance > 0 and sight.field < 2 * np.pi:
                cosine = line @ ahead / distance / np.hypot(*ahead)
                near &= cosine >= np.cos(sight.field / 2)
            for other, place in enumerate(sheep):
                if other != one and distance > 0:
                    away = place - dog
                    along = away @ line / distance
                    aside = abs(line[0] * away[1] - line[1] * away[0]) / distance
                    near &= not (0 < along < distance - sight.body and aside < sight.body)
            sees |= near
        found.append(sees)
    return found


# Odd parts of a metre, so that no sheep is exactly on the border.
places = st.tuples(st.integers(-9, 9), st.integers(-9, 9)).map(lambda at: np.array(at, float))


@given(
    st.lists(places, min_size=4, max_size=4),
    st.lists(places, min_size=2, max_size=2),
    st.sampled_from([Sight(7.3), Sight(30.0, 1.7), Sight(11.7, 2 * np.pi, 0.37)]),
)
def test_who_is_seen_is_as_geometry_has_it(sheep, dogs, sight):
    sheep, dogs = np.array(sheep), np.array(dogs)
    known = sheep + np.array([0.31, 0.17])
    at, by, last = (jnp.asarray(each, jnp.float32) for each in (sheep, dogs, known))
    assert seen(sight, at, by, last, None).tolist() == plainly(sight, sheep, dogs, known)


@pytest.mark.parametrize(("tall", "sees"), [(True, False), (False, True)])
def test_a_wall_that_dogs_go_around_hides_what_is_behind_it(tall, sees):
    wall = Obstacles(jnp.array([[[5.0, -3.0], [5.0, 3.0]]]), jnp.array([0.2]), tall)
    sheep, dogs = jnp.array([[9.0, 0.0]]), jnp.array([[1.0, 0.0]])
    assert seen(Sight(20.0), sheep, dogs, sheep, wall).tolist() == [sees]
    beside = jnp.array([[9.0, 4.0]])
    assert seen(Sight(20.0), sheep, beside, sheep, wall).tolist() == [True]
