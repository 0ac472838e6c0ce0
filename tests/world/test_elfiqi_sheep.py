import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import numbers, states
from hypothesis import assume, given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.world import mission
from skydog.world.laws import elfiqi
from skydog.world.laws.elfiqi import RegulatedFlock
from skydog.world.presets import preset
from skydog.world.serialise import flatten, unflatten
from skydog.world.state import State

LAW = preset("elfiqi2020").flock
CLOSE = 1e-3
RANGES = {  # the least, and by how much it may be more
    "avoidance": (0.1, 1.5),
    "sensing": (1.0, 5.0),
    "neighbourhood": (0.5, 4.0),
    "decay": (0.0, 4.0),
    "reach": (1.0, 10.0),
}


def length(v):
    return math.hypot(v[0], v[1])


def direction(v):
    return v / length(v) if length(v) > 0 else np.zeros(2)


def own(value, i):
    return value if np.ndim(value) == 0 else float(value[i])


def reference(law, sheep, dogs, previous, i):
    """The published program's sum of forces on a sheep, before it is normalised."""
    away = [sheep[i] - sheep[k] for k in range(len(sheep)) if k != i]
    near = [a for a in away if length(a) < own(law.neighbourhood, i)]
    crowding = [a for a in away if 0 < length(a) < own(law.avoidance, i)]
    pull = direction(-sum(near) / len(near)) if near else np.zeros(2)
    crowd, flee = np.zeros(2), np.zeros(2)
    for a in crowding:
        faded = math.exp(-own(law.decay, i) * length(a) / own(law.avoidance, i))
        crowd = crowd + direction(a) * faded / math.sqrt(len(crowding))
    for dog in dogs:
        a = sheep[i] - dog
        if length(a) < own(law.sensing, i):
            faded = math.exp(-own(law.decay, i) * length(a) / own(law.reach, i))
            flee = flee + direction(a) * own(law.threat, i) * faded
    return (
        own(law.inertia, i) * previous[i]
        + own(law.grouping, i) * pull
        + own(law.repulsion, i) * crowd
        + own(law.escape, i) * flee
    )


def close_call(law, sheep, dogs, previous):
    """Whether rounding may decide: a range that is just met, or a sum that nearly cancels."""
    for i in range(len(sheep)):
        away = [sheep[i] - sheep[k] for k in range(len(sheep)) if k != i]
        near = [a for a in away if length(a) < own(law.neighbourhood, i)]
        sums = [reference(law, sheep, dogs, previous, i), *([sum(near)] if near else [])]
        if any(0 < length(v) < CLOSE for v in sums):
            return True
        ranges = (own(law.neighbourhood, i), own(law.avoidance, i))
        if any(abs(length(a) - reach) < CLOSE for a in away for reach in ranges):
            return True
        if any(abs(length(sheep[i] - dog) - own(law.sensing, i)) < CLOSE for dog in dogs):
            return True
    return False


@jax.jit
def force(law, state):
    return law.force(state, None)


@st.composite
def laws(draw, count):
    """A law whose parameters are numbers, or one of each for each sheep."""
    each = draw(st.booleans())
    values = {}
    for name in vars(LAW):
        low, wide = RANGES.get(name, (0.0, 2.0))
        number = st.integers(0, 16).map(lambda k, low=low, wide=wide: low + k * wide / 16)
        drawn = draw(st.lists(number, min_size=count, max_size=count))
        values[name] = jnp.asarray(np.array(drawn if each else drawn[0], np.float32))
    return RegulatedFlock(**{**values, "noise": 0.0})


@st.composite
def scenes(draw):
    state = draw(states(0.0, 4.0, shapes=[(1, 1), (3, 2), (5, 1)]))
    return draw(laws(len(state.sheep))), state


@given(scenes())
def test_the_force_is_that_of_the_published_program(scene):
    law, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not close_call(law, sheep, dogs, previous))
    expected = [direction(reference(law, sheep, dogs, previous, i)) for i in range(len(sheep))]
    np.testing.assert_allclose(force(law, state), expected, atol=1e-3)


@given(scenes())
def test_no_force_is_ever_nan(scene):
    assert np.all(np.isfinite(force(*scene)))


def test_a_large_flock_feels_block_by_block_what_all_pairs_at_once_give(monkeypatch):
    places = jax.random.uniform(jax.random.key(0), (70, 2), maxval=6.0)
    state = mission.start(places, jnp.array([[3.0, -1.0]]))
    at_once = LAW.force(state, None)
    monkeypatch.setattr(elfiqi, "ALL_PAIRS", 10)
    np.testing.assert_allclose(LAW.force(state, None), at_once, atol=1e-4)


def test_a_sheep_flees_from_a_dog_beyond_reach_but_weakly():
    # A lone sheep that ran east: at 5 m the dog's push, 2 exp(-1), outweighs its inertia.
    east = State(jnp.zeros((1, 2)), jnp.array([[0.0, 5.0]]), jnp.array([[1.0, 0.0]]))
    near = LAW.force(east, None)[0]
    far = LAW.force(replace(east, dogs=jnp.array([[0.0, 20.0]])), None)[0]
    np.testing.assert_allclose(near / near[0], [1.0, -2 * math.exp(-1.0) / 0.5], rtol=1e-5)
    np.testing.assert_allclose(far / far[0], [1.0, -2 * math.exp(-4.0) / 0.5], rtol=1e-5)


def test_noise_shifts_each_component_of_the_sum_by_no_more_than_its_weight():
    state = State(jnp.zeros((1, 2)), jnp.array([[100.0, 0.0]]), jnp.array([[1.0, 0.0]]))
    keys = jax.random.split(jax.random.key(0), 2000)
    drawn = np.asarray(jax.vmap(lambda key: replace(LAW, noise=0.1).force(state, key))(keys))
    angle = np.abs(np.arctan2(drawn[:, 0, 1], drawn[:, 0, 0]))
    assert 0.9 * math.atan(0.1 / 0.5) < angle.max() <= math.atan(0.1 / 0.4) + 1e-6


def test_a_parameter_of_another_shape_is_refused(unchecked):
    state = mission.start(jnp.zeros((3, 2)), jnp.zeros((1, 2)))
    for name in vars(LAW):
        with pytest.raises(Refusal, match=r"\(3,\)"):
            replace(LAW, **{name: jnp.ones(4)}).force(state, jax.random.key(0))


def test_the_preset_holds_the_numbers_of_the_published_configuration():
    world = preset("elfiqi2020", sheep=100)
    f = 0.4 * math.sqrt(200)
    assert (world.arena.size, world.arena.goal_x, world.arena.goal_y) == (50, 25, 50)
    assert (world.arena.goal_radius, world.arena.dt) == (10, 1)
    assert (world.sheep.speed, world.dog.speed) == (1, 2)
    assert math.isclose(world.spread.radius(100), f)
    assert math.isclose(world.dog.driving * 10, f + 4)
    assert world.dog.collecting == 4


def test_the_world_comes_back_from_a_file_as_it_was():
    world = preset("elfiqi2020", sheep=100)
    assert flatten(unflatten(flatten(world))) == flatten(world)


@pytest.mark.parametrize("gathered", [True, False])
def test_a_mission_is_accomplished_when_all_are_at_the_goal_gathered_or_not(gathered):
    world = preset("elfiqi2020", sheep=4)  # f(N) is 1.1 m
    apart = 0.5 if gathered else 9.0
    sheep = jnp.array([[25 - apart, 50], [25 + apart, 50], [25, 50 - apart], [25, 50]])
    at = mission.start(sheep, jnp.array([[25.0, 30.0]]))
    assert bool(mission.accomplished(world, at))
    beyond = replace(at, sheep=sheep.at[3].set(jnp.array([25.0, 39.0])))
    assert not bool(mission.accomplished(world, beyond))
