import math
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from drawn import numbers, open_scenes, scenes
from hypothesis import assume, given
from hypothesis import strategies as st

from skydog.shepherds.strombom import Strombom
from skydog.world import herding, mission
from skydog.world.presets import furthest_first, preset, with_nearness
from skydog.world.spread import TwoThirdsSpread
from skydog.world.state import start

SEVERAL = [(3, 2), (5, 3)]


@jax.jit
def gate(world, state):
    return herding.gate(world, state.sheep, state.dogs)


@jax.jit
def driving_points(world, state):
    return herding.driving_points(world, state.sheep, state.dogs)


@given(scenes())
def test_subgoals_and_behaviours_are_those_of_the_paper(scene):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    assume(not reference.gate_is_close_call(world, sheep, dogs))
    subgoal, drives = gate(world, state)
    expected_subgoal, expected_drives = reference.gate(world, sheep, dogs)
    np.testing.assert_allclose(subgoal, expected_subgoal, atol=1e-4)
    assert np.array_equal(drives, expected_drives)


@given(scenes(shapes=[(2, 1), (3, 1)]))
def test_of_strays_equally_far_one_is_collected(scene):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    centre = sheep.mean(axis=0)
    away = [reference.length(one - centre) for one in sheep]
    radius = reference.gathering_distance(world, sheep)
    assume(min(abs(one - radius) for one in away) > reference.CLOSE)
    subgoal, drives = gate(world, state)
    if not drives[0]:
        ranks = {i: reference.rank(world, sheep, i, dogs) for i in reference.outside(world, sheep)}
        beyond = world.arena.size + world.dog.airspace
        points = [
            np.clip(reference.collecting_point(world, sheep, i), -world.dog.airspace, beyond)
            for i, rank in ranks.items()
            if rank > max(ranks.values()) - 1e-4
        ]
        assert min(reference.length(np.asarray(subgoal[0]) - point) for point in points) < 1e-4


@given(scenes())
def test_subgoals_are_finite_and_within_the_airspace(scene):
    world, state = scene
    subgoal, _ = gate(world, state)
    assert np.all(np.isfinite(subgoal))
    assert np.all(np.asarray(subgoal) >= -world.dog.airspace)
    assert np.all(np.asarray(subgoal) <= np.float32(world.arena.size + world.dog.airspace))


@given(open_scenes(shapes=[(3, 1), *SEVERAL]))
def test_driving_points_lie_apart_at_the_offset_from_the_centre(scene):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    centre = sheep.mean(axis=0)
    assume(reference.length(centre - reference.goal(world)) > 1e-3)
    points = np.asarray(driving_points(world, state))
    offset = world.dog.driving * math.sqrt(len(sheep))
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), offset, rtol=1e-4)
    nearest_two = 2 * offset * math.sin(math.pi / 10)
    for j in range(len(dogs)):
        for k in range(j):
            assert np.linalg.norm(points[j] - points[k]) > nearest_two - 1e-3


@given(open_scenes(shapes=SEVERAL))
def test_the_driving_points_of_several_dogs_straddle_that_of_one(scene):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    assume(reference.length(sheep.mean(axis=0) - reference.goal(world)) > 1e-3)
    spread = (np.arange(len(dogs)) - (len(dogs) - 1) / 2) * math.pi / 5
    places = [reference.driving_point(world, sheep, angle) for angle in spread]
    points = np.asarray(driving_points(world, state))
    by_x = sorted(points.round(3).tolist())
    np.testing.assert_allclose(by_x, sorted(np.round(places, 3).tolist()), atol=2e-3)


@given(open_scenes(shapes=SEVERAL))
def test_dogs_take_their_places_behind_the_flock_in_the_order_in_which_they_stand(scene):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    assume(not reference.gate_is_close_call(world, sheep, dogs))
    points = np.asarray(driving_points(world, state), float)
    stand = np.argsort([reference.bearing(world, sheep, dog) for dog in dogs])
    fly_to = np.argsort([reference.bearing(world, sheep, point) for point in points])
    assert np.array_equal(stand, fly_to)


def flock_with_strays(count):
    near = [[2.9, 3.0], [3.1, 3.0], [3.0, 2.9], [3.0, 3.1], [3.0, 3.0]]
    far = [[0.2, 5.8], [5.7, 0.4], [5.5, 5.5]]
    world = preset("paper", 6.0)
    tight = replace(world, spread=TwoThirdsSpread(0.5))
    return tight, jnp.array(near + far[:count])


@pytest.mark.parametrize("dogs", [2, 3])
def test_several_dogs_collect_different_strays_and_the_nearest_dog_the_furthest(dogs):
    world, sheep = flock_with_strays(dogs)
    standing = jnp.array([[3.0, 1.0], [5.0, 3.0], [1.0, 5.0]])[:dogs]
    target, busy = herding.collecting_points(world, sheep, standing)
    assert np.all(busy)
    centre = np.mean(np.asarray(sheep), axis=0)
    strays = [
        int(np.argmin(np.linalg.norm(np.asarray(sheep) - np.asarray(point), axis=1)))
        for point in target
    ]
    assert sorted(strays) == list(range(5, 5 + dogs))
    furthest = int(np.argmax(np.linalg.norm(np.asarray(sheep) - centre, axis=1)))
    point = np.asarray(target)[strays.index(furthest)]
    away = np.linalg.norm(np.asarray(standing) - point, axis=1)
    assert strays[int(np.argmin(away))] == furthest


def test_a_dog_that_finds_no_stray_left_drives_while_the_other_collects():
    world, sheep = flock_with_strays(1)
    subgoal, drives = herding.gate(world, sheep, jnp.array([[5.0, 5.0], [0.5, 5.0]]))
    assert drives.tolist() == [True, False]
    centre = np.mean(np.asarray(sheep), axis=0)
    stray = np.asarray(sheep[5])
    behind = stray + (stray - centre) / np.linalg.norm(stray - centre)
    np.testing.assert_allclose(subgoal[1], behind, atol=1e-5)


def test_more_dogs_than_sheep_are_all_sent_somewhere():
    world = preset("paper", 6.0)
    sheep = jnp.array([[0.5, 5.5], [5.5, 0.5]])
    subgoal, drives = herding.gate(world, sheep, jnp.array([[1.0, 1.0], [2.0, 1.0], [5.0, 5.0]]))
    assert np.all(np.isfinite(subgoal))
    assert int(np.sum(~np.asarray(drives))) == 2


@given(open_scenes(shapes=[(3, 1), (3, 2)]), st.sampled_from([(8.0, -3.0), (-5.5, 7.25)]))
def test_subgoals_move_along_with_everything_else(scene, shift):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    assume(not reference.gate_is_close_call(world, sheep, dogs))
    x, y = shift
    arena = replace(world.arena, goal_x=world.arena.goal_x + x, goal_y=world.arena.goal_y + y)
    offset = jnp.array(shift)
    moved = replace(state, sheep=state.sheep + offset, dogs=state.dogs + offset)
    subgoal, drives = gate(world, state)
    moved_subgoal, moved_drives = gate(replace(world, arena=arena), moved)
    np.testing.assert_allclose(moved_subgoal, subgoal + offset, atol=1e-3)
    assert np.array_equal(moved_drives, drives)


@given(scenes(shapes=SEVERAL), st.randoms(use_true_random=False))
def test_neither_the_order_of_sheep_nor_that_of_dogs_decides_who_flies_where(scene, random):
    world, state = scene
    sheep, dogs, _ = numbers(state)
    assume(not reference.gate_is_close_call(world, sheep, dogs))
    of_sheep, of_dogs = list(range(len(sheep))), list(range(len(dogs)))
    random.shuffle(of_sheep)
    random.shuffle(of_dogs)
    subgoal, drives = gate(world, state)
    shuffled = replace(
        state, sheep=state.sheep[jnp.array(of_sheep)], dogs=state.dogs[jnp.array(of_dogs)]
    )
    other_subgoal, other_drives = gate(world, shuffled)
    np.testing.assert_allclose(other_subgoal, np.asarray(subgoal)[of_dogs], atol=1e-4)
    assert np.array_equal(other_drives, np.asarray(drives)[of_dogs])


def test_the_gate_drives_up_to_a_flock_as_wide_as_f_of_n():
    world = preset("paper", 6.0)
    just_in = jnp.array([[3.0 - 1.2999, 3.0], [3.0 + 1.2999, 3.0], [3.0, 3.0]])
    just_out = jnp.array([[3.0 - 1.3001, 3.0], [3.0 + 1.3001, 3.0], [3.0, 3.0]])
    dogs = jnp.array([[5.0, 5.0]])
    assert bool(herding.gate(world, just_in, dogs)[1][0])
    assert not bool(herding.gate(world, just_out, dogs)[1][0])


# The stray at hand

CORNERS = [[8.6, 0.4], [8.6, 8.6], [0.4, 8.6]]


def test_of_three_strays_the_paper_takes_the_furthest_and_the_presets_the_one_at_hand():
    sheep = jnp.array([[8.0, 0.5], [8.6, 8.6], [0.4, 8.6]])
    dogs = jnp.array([[6.0, 1.0]])
    world = preset("paper", 9.0)
    for chosen, stray in ((world, 0), (furthest_first(world), 2)):
        expected = reference.collecting_point(chosen, np.asarray(sheep, float), stray)
        point, _ = herding.collecting_points(chosen, sheep, dogs)
        np.testing.assert_allclose(point[0], expected, atol=1e-4)


def test_a_sheep_within_f_of_n_is_never_collected_however_near_it_is():
    sheep = jnp.array([[2.0, 2.0], [2.2, 2.0], [2.0, 2.2], [2.2, 2.2], [8.0, 8.0]])
    world = with_nearness(preset("paper", 9.0, 5), 100.0)
    point, _ = herding.collecting_points(world, sheep, jnp.array([[2.1, 2.1]]))
    expected = reference.collecting_point(world, np.asarray(sheep, float), 4)
    np.testing.assert_allclose(point[0], expected, atol=1e-4)


def test_a_dog_commutes_between_three_corners_unless_it_takes_the_stray_at_hand():
    world = preset("paper", 9.0)
    begun = start(jnp.array(CORNERS), jnp.array([[4.0, 4.0]]))
    done = {
        name: bool(mission.rollout(gate, Strombom("arrive"), begun).accomplished[-1])
        for name, gate in (("at hand", world), ("furthest", furthest_first(world)))
    }
    assert done == {"at hand": True, "furthest": False}


@pytest.mark.parametrize("dogs", [2, 3])
def test_several_dogs_take_the_strays_at_hand_and_share_them_out(dogs):
    world = preset("paper", 9.0)
    near = jnp.array(CORNERS)[:dogs] + 0.3
    points, busy = herding.collecting_points(world, jnp.array(CORNERS), near)
    assert busy.all()
    for i in range(dogs):
        expected = reference.collecting_point(world, np.array(CORNERS), i)
        np.testing.assert_allclose(points[i], expected, atol=1e-4)


def test_a_dog_is_seen_by_all_as_far_as_the_shortest_sighted_sees():
    world = preset("paper", 4.0)
    assert herding.sensing(world) == 2.0
    shorter = replace(world, flock=replace(world.flock, sensing=jnp.array([2.0, 0.5, 1.0])))
    assert herding.sensing(shorter) == 0.5
    for law in (SimpleNamespace(), SimpleNamespace(sensing="far")):
        assert herding.sensing(replace(world, flock=law)) == math.inf
