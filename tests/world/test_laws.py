import math
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from drawn import mixed_scenes, numbers, open_scenes, scenes
from hypothesis import assume, given
from hypothesis import strategies as st

from skydog.world import mission
from skydog.world.laws import terms
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.presets import preset
from skydog.world.state import State

PAPER = preset("paper").flock
NOWHERE = jnp.array([[100.0, 100.0]])  # a dog that no sheep sees


@jax.jit
def each_term(world, state):
    return (
        terms.escape(state.sheep, state.dogs, world.flock.sensing),
        terms.avoid(state.sheep, world.flock.avoidance),
        terms.group(state.sheep, reference.nearest(world)),
    )


@jax.jit
def total(world, state):
    return world.flock.force(state, None)


def assert_terms_as_in_the_paper(world, state):
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    escape, avoid, group = each_term(world, state)
    for i in range(len(sheep)):
        np.testing.assert_allclose(escape[i], reference.escape(world, sheep, dogs, i), atol=1e-5)
        np.testing.assert_allclose(avoid[i], reference.avoid(world, sheep, i), atol=1e-5)
        np.testing.assert_allclose(group[i], reference.group(world, sheep, i), atol=1e-5)


def assert_force_as_in_the_paper(world, state):
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    expected = [reference.force(world, sheep, dogs, previous, i) for i in range(len(sheep))]
    # The direction of a sum as short as CLOSE is known to 1e-7 / CLOSE.
    np.testing.assert_allclose(total(world, state), expected, atol=1e-3)


@given(scenes())
def test_escape_avoidance_and_grouping_are_those_of_the_paper(scene):
    assert_terms_as_in_the_paper(*scene)


@given(scenes(StrombomFlock, neighbours=2, shapes=[(1, 1), (3, 1), (5, 3)]))
def test_grouping_pulls_to_the_centre_of_the_nearest_flockmates_only(scene):
    assert_terms_as_in_the_paper(*scene)


@given(scenes())
def test_the_force_is_that_of_the_paper_with_normalised_terms(scene):
    assert_force_as_in_the_paper(*scene)


@given(scenes(LiteralFlock))
def test_the_literal_force_is_that_of_the_paper_as_printed(scene):
    assert_force_as_in_the_paper(*scene)


@given(mixed_scenes() | mixed_scenes(LiteralFlock) | mixed_scenes(StrombomFlock))
def test_each_sheep_follows_its_own_parameters(scene):
    assert_terms_as_in_the_paper(*scene)
    assert_force_as_in_the_paper(*scene)


@given(mixed_scenes())
def test_sheep_that_are_all_alike_move_as_one_number_says(scene):
    world, state = scene
    first = jax.tree.map(lambda leaf: leaf[0] if jnp.ndim(leaf) else leaf, world)
    alike = jax.tree.map(lambda one, each: jnp.broadcast_to(one, jnp.shape(each)), first, world)
    np.testing.assert_allclose(total(alike, state), total(first, state), atol=1e-5)


# In a process of its own, where no checker of types refuses the shapes first: as users run it.
WRONG_SHAPES = """
import jax, jax.numpy as jnp, numpy as np
from dataclasses import replace
from skydog.errors import Refusal
from skydog.world import state
from skydog.world.laws.strombom import StrombomFlock

right = StrombomFlock(1.0, 2.0, 0.5, 1.05, 1.0, 2.0)
for count in (3, 320):
    start = state.start(jnp.zeros((count, 2)), jnp.zeros((1, 2)))
    for name in vars(right):
        for shape in (count, 1), (count + 1,):
            law = replace(right, **{name: np.ones(shape)})
            if name == "neighbours":
                continue
            try:
                law.force(start, jax.random.key(0))
            except Refusal as refusal:
                assert f"({count},)" in str(refusal) and str(shape) in str(refusal)
            else:
                raise AssertionError(f"{name} of shape {shape} flew {count} sheep")
print("all refused")
"""


def test_a_parameter_of_another_shape_is_refused_by_its_shape():
    done = subprocess.run([sys.executable, "-c", WRONG_SHAPES], capture_output=True, text=True)
    assert done.stdout == "all refused\n", done.stderr


@given(scenes() | scenes(LiteralFlock) | scenes(StrombomFlock, neighbours=2))
def test_no_force_is_ever_nan(scene):
    assert np.all(np.isfinite(total(*scene)))


def test_every_range_includes_its_border():
    sheep, dogs = jnp.array([[0.0, 0.0], [1.0, 0.0]]), jnp.array([[0.0, 2.0]])
    escape, avoid = terms.escape(sheep, dogs, 2.0), terms.avoid(sheep, 1.0)
    assert np.array_equal(escape, [[0.0, -1.0], [0.0, 0.0]])
    assert np.array_equal(avoid, [[-1.0, 0.0], [1.0, 0.0]])


@pytest.mark.parametrize("count", [3, 10])
@pytest.mark.parametrize("place", [0.1, 0.3, 1.7, 3.3])
def test_sheep_at_one_point_feel_no_pull_and_no_push(count, place):
    crowd = mission.start(jnp.full((count, 2), place), NOWHERE)
    _, avoid, group = each_term(preset("paper"), crowd)
    assert np.all(np.asarray(group) == 0.0)
    assert np.all(np.asarray(avoid) == 0.0)


def test_a_sheep_midway_between_two_others_is_not_pushed_and_stands():
    sheep = jnp.array([[0.5, 1.0], [1.0, 1.0], [1.5, 1.0]])
    before = jnp.array([[0.0, 1.0]] * 3)
    assert np.array_equal(PAPER.force(State(sheep, NOWHERE, before), None)[1], [0.0, 0.0])


def test_a_lone_sheep_flees_straight_from_the_dog():
    sheep, dogs = jnp.array([[2.0, 2.0]]), jnp.array([[1.25, 1.0]])
    force = PAPER.force(mission.start(sheep, dogs), None)
    np.testing.assert_allclose(force, [[0.6, 0.8]], atol=1e-6)


@given(scenes())
def test_a_force_without_noise_has_length_one_or_zero(scene):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    lengths = np.linalg.norm(np.asarray(total(world, state)), axis=1)
    assert np.all((lengths == 0.0) | (np.abs(lengths - 1.0) < 1e-5))


@given(scenes(), st.booleans())
def test_a_sheep_that_sees_no_dog_and_has_no_near_neighbour_stands(scene, far):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    if far:
        state = replace(state, dogs=state.dogs + 100.0)
        dogs = dogs + 100.0
    force = np.asarray(total(world, state))
    for i in range(len(sheep)):
        calm = min(reference.length(sheep[i] - dog) for dog in dogs) > world.flock.sensing
        apart = [reference.length(sheep[i] - sheep[k]) for k in range(len(sheep)) if k != i]
        if calm and all(distance > world.flock.avoidance for distance in apart):
            assert np.all(force[i] == 0.0)


def turned(points, angle, about):
    c, s = math.cos(angle), math.sin(angle)
    return (points - about) @ jnp.array([[c, s], [-s, c]]) + about


@given(open_scenes(), st.floats(-math.pi, math.pi))
def test_a_scene_turned_by_an_angle_has_its_forces_turned_by_that_angle(scene, angle):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    assume(not reference.range_is_close_call(world, sheep, dogs))
    about = jnp.array([50.0, 50.0])
    after = replace(
        state,
        sheep=turned(state.sheep, angle, about),
        dogs=turned(state.dogs, angle, about),
        force=turned(state.force, angle, 0.0),
    )
    # A turned sheep may leave the dog it stood on by a rounding error, and flee from it.
    assume(not any(reference.length(a - b) < 1e-3 for a in sheep for b in dogs))
    assume(
        all(
            reference.length(sheep[i] - sheep[k]) > 1e-3
            for i in range(len(sheep))
            for k in range(i)
        )
    )
    np.testing.assert_allclose(
        total(world, after), turned(total(world, state), angle, 0.0), atol=0.02
    )


@given(scenes(), st.randoms(use_true_random=False))
def test_sheep_in_another_order_feel_the_same_forces_in_that_order(scene, random):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    order = list(range(len(sheep)))
    random.shuffle(order)
    shuffled = replace(
        state, sheep=state.sheep[jnp.array(order)], force=state.force[jnp.array(order)]
    )
    np.testing.assert_allclose(
        total(world, shuffled), np.asarray(total(world, state))[order], atol=1e-3
    )


MANY = jax.random.split(jax.random.key(0), 4000)


def forces_over_many_draws(parameters, sheep, dogs):
    state = mission.start(sheep, dogs)
    one = jax.jit(jax.vmap(lambda key: parameters.force(state, key)))
    return np.asarray(one(MANY))


def test_a_grazing_sheep_moves_at_random_with_the_chance_asked_for():
    sheep = jnp.array([[2.0, 2.0], [4.0, 4.0]])
    drawn = forces_over_many_draws(StrombomFlock(**vars(PAPER), graze=0.25), sheep, NOWHERE)
    moves = np.linalg.norm(drawn, axis=-1)
    assert np.all((moves == 0.0) | (np.abs(moves - 1.0) < 1e-5))
    assert abs(np.mean(moves) - 0.25) < 5 * math.sqrt(0.25 * 0.75 / moves.size)
    assert np.all(np.abs(drawn.mean(axis=0)) < 5 * math.sqrt(0.25 / 2 / len(MANY)))


def test_noise_turns_a_fleeing_sheep_by_at_most_its_weight():
    sheep, dogs = jnp.array([[2.0, 2.0]]), jnp.array([[1.0, 2.0]])
    drawn = forces_over_many_draws(replace(PAPER, noise=0.3), sheep, dogs)[:, 0]
    angle = np.arctan2(drawn[:, 1], drawn[:, 0])
    assert np.max(np.abs(angle)) <= math.asin(0.3) + 1e-5
    assert np.max(angle) > 0.9 * math.asin(0.3)
    assert np.min(angle) < -0.9 * math.asin(0.3)


def test_noise_moves_no_sheep_that_nothing_disturbs():
    drawn = forces_over_many_draws(replace(PAPER, noise=0.3), jnp.array([[2.0, 2.0]]), NOWHERE)
    assert np.all(drawn == 0.0)
