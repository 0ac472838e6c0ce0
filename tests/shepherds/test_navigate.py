from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.shepherds import navigate, store
from skydog.shepherds.networks import Actor
from skydog.world import home, params
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset
from skydog.world.state import start

SKILL = Actor(len(navigate.SEES), 2, (8,), jax.random.key(3))
NOTHING = Obstacles(jnp.zeros((0, 2, 2)), jnp.zeros(0))
OPEN = preset("paper")


def turned(points, angle, mirrored):
    """Points turned about (50, 50), far from the arena's walls, and mirrored in y = 50."""
    sign = -1.0 if mirrored else 1.0
    turn = np.array([(np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))])
    off = (np.asarray(points) - 50.0) * (1.0, sign)
    return jnp.asarray(50.0 + off @ turn.T, jnp.float32)


@given(st.integers(0, 99), st.floats(0.0, 6.2), st.booleans())
def test_a_scene_that_is_turned_or_mirrored_has_its_way_turned_or_mirrored(seed, angle, mirrored):
    drawn = np.random.default_rng(seed)
    ends, place = drawn.uniform(45, 55, (4, 2, 2)), drawn.uniform(45, 55, 2)
    goal, bearing = drawn.uniform(45, 55, 2), drawn.uniform(0.3, 2.8)
    ahead = (goal - place) / np.linalg.norm(goal - place)
    heading = np.cos(bearing) * ahead + np.sin(bearing) * np.array((-ahead[1], ahead[0]))

    def way(move):
        about = move(50.0 + heading) - move(np.array((50.0, 50.0)))
        walls = Obstacles(move(ends), jnp.full(4, 0.2))
        seen, axes = navigate.observe(walls, 100.0, move(goal), 4.0, move(place), about)
        return seen, 50.0 + np.asarray(navigate.direction(SKILL(seen), axes))

    one, there = way(lambda points: turned(points, 0.0, False))
    other, here = way(lambda points: turned(points, angle, mirrored))
    np.testing.assert_allclose(other, one, atol=0.02)
    np.testing.assert_allclose(here, turned(there, angle, mirrored), atol=0.05)


def test_what_is_out_of_sight_changes_nothing():
    far = Obstacles(jnp.array([[[8.0, 0.0], [8.0, 10.0]]]), jnp.array([0.1]))
    place, heading = jnp.array([2.0, 5.0]), jnp.array([1.0, 0.0])
    nothing, wall = (
        navigate.observe(walls, 10.0, jnp.zeros(2), 4.0, place, heading)[0]
        for walls in (NOTHING, far)
    )
    np.testing.assert_array_equal(nothing, wall)


def test_among_obstacles_the_third_skill_decides_and_the_worlds_map_does_not(unchecked):
    dog = replace(store.load("h-ddpg-4x4"), navigate=SKILL)
    mapped = preset("paper", scene="gate")
    blind = replace(mapped, home=home.StraightHome())
    state = start(jnp.array([[3.0, 8.0], [3.5, 8.5], [2.5, 8.0]]), jnp.array([[4.0, 10.0]]))
    fly = eqx.filter_jit(lambda dog, world: dog(params.traced(world), state))
    np.testing.assert_array_equal(fly(dog, mapped), fly(dog, blind))
    assert not np.array_equal(fly(dog, mapped), fly(replace(dog, navigate=None), mapped))


def test_in_the_open_the_third_skill_changes_nothing(unchecked):
    dog = store.load("h-ddpg-4x4")
    state = start(jnp.array([[3.0, 3.0], [3.5, 3.5]]), jnp.array([[1.0, 3.0]]))
    np.testing.assert_array_equal(replace(dog, navigate=SKILL)(OPEN, state), dog(OPEN, state))


def test_a_sheepdog_with_three_skills_comes_back_exactly(tmp_path):
    dog = replace(store.load("h-ddpg-4x4"), navigate=SKILL)
    store.save(tmp_path / "x.safetensors", dog, {})
    back = store.load(tmp_path / "x.safetensors")
    for here, there in zip(jax.tree.leaves(dog), jax.tree.leaves(back), strict=True):
        assert np.array_equal(here, there)


def test_a_third_skill_that_sees_something_else_is_refused(tmp_path, monkeypatch):
    dog = replace(store.load("h-ddpg-4x4"), navigate=SKILL)
    monkeypatch.setattr(store, "SEES", navigate.SEES[:-1])
    store.save(tmp_path / "x.safetensors", dog, {})
    monkeypatch.undo()
    with pytest.raises(Refusal, match=r"navigates 18 numbers, this mission has 19"):
        store.load(tmp_path / "x.safetensors")
