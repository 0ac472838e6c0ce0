import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from drawn import commands, mixed_scenes, numbers, open_scenes, scenes
from hypothesis import assume, given
from hypothesis import strategies as st
from missions import (
    a_start,
    accomplished,
    gate,
    reset,
    step,
    with_,
)

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.world import herding, mission
from skydog.world.limits import AnyDirection, Limits, PerAxis
from skydog.world.params import Dog
from skydog.world.presets import preset
from skydog.world.state import State

# One step


@given(st.data(), scenes() | mixed_scenes())
def test_a_step_moves_everyone_as_the_paper_says(data, scene):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    velocity = data.draw(commands(len(dogs)))
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    after = step(world, state, velocity)
    expected = reference.step(world, sheep, dogs, previous, np.asarray(velocity, float))
    np.testing.assert_allclose(after.sheep, expected[0], atol=1e-4)
    np.testing.assert_allclose(after.dogs, expected[1], atol=1e-5)
    np.testing.assert_allclose(after.force, expected[2], atol=1e-3)


@given(st.data(), open_scenes())
def test_away_from_walls_a_sheep_moves_its_full_step_or_stands(data, scene):
    world, state = scene
    velocity = data.draw(commands(len(state.dogs)))
    moved = np.asarray(step(world, state, velocity).sheep - state.sheep, float)
    lengths = np.linalg.norm(moved, axis=1)
    full = world.sheep.speed * world.arena.dt
    assert np.all((lengths == 0.0) | (np.abs(lengths - full) < 2e-5))


@given(st.data(), scenes(), st.floats(0.1, 1e6))
def test_sheep_never_leave_the_arena_nor_dogs_the_airspace(data, scene, haste):
    world, state = scene
    size, edge = world.arena.size, world.dog.airspace
    hasty = with_(with_(world, "dog", speed=haste), "sheep", speed=haste)
    velocity = haste * data.draw(commands(len(state.dogs)))
    after = step(hasty, state, velocity)
    assert np.all((np.asarray(after.sheep) >= 0) & (np.asarray(after.sheep) <= size))
    dogs = np.asarray(after.dogs)
    assert np.all((dogs >= np.float32(-edge)) & (dogs <= np.float32(size + edge)))


@given(
    scenes(shapes=[(3, 1), (3, 2)]), st.sampled_from([math.nan, math.inf, -math.inf]), st.booleans()
)
def test_a_dog_hovers_on_a_command_that_is_no_number_and_the_other_flies_on(scene, bad, first):
    world, state = scene
    velocity = jnp.full(state.dogs.shape, 0.5).at[0, 0 if first else 1].set(bad)
    after = step(world, state, velocity)
    inside = herding.within_airspace(world, state.dogs)
    assert np.array_equal(after.dogs[0], inside[0])
    assert np.all(np.isfinite(after.sheep))
    for other in range(1, len(state.dogs)):
        assert not np.array_equal(after.dogs[other], state.dogs[other])


def a_dog(limits: Limits, speed: float = 1.5) -> Dog:
    return Dog(speed=speed, driving=1.0, collecting=1.0, airspace=1.0, limits=limits)


LIMITS = [PerAxis(), AnyDirection()]
velocities = st.tuples(st.floats(-5, 5, width=16), st.floats(-5, 5, width=16))


@given(velocities)
def test_a_limit_per_axis_cuts_each_component(v):
    found = mission.limited(a_dog(PerAxis()), jnp.array([v], jnp.float32))
    np.testing.assert_allclose(found[0], np.clip(v, -1.5, 1.5), rtol=1e-6)


@given(velocities)
def test_a_limit_on_the_length_keeps_the_direction(v):
    found = np.asarray(mission.limited(a_dog(AnyDirection()), jnp.array([v], jnp.float32))[0])
    length = math.hypot(*v)
    expected = np.array(v) * (min(1.0, 1.5 / length) if length else 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)


@given(velocities, st.sampled_from(LIMITS))
def test_the_fastest_velocity_reaches_the_limit_in_the_direction_asked_for(direction, limits):
    assume(max(map(abs, direction)) > 1e-3)
    dog = a_dog(limits)
    fastest = mission.fastest(dog, jnp.array([direction], jnp.float32))
    x, y = np.asarray(fastest[0], float)
    reached = max(abs(x), abs(y)) if limits == PerAxis() else math.hypot(x, y)
    assert math.isclose(reached, 1.5, rel_tol=1e-4)
    assert math.isclose(math.atan2(y, x), math.atan2(direction[1], direction[0]), abs_tol=1e-4)
    np.testing.assert_allclose(mission.limited(dog, fastest), fastest, rtol=1e-5)


@pytest.mark.parametrize("limits", LIMITS)
def test_a_dog_that_has_no_direction_hovers(limits):
    assert np.array_equal(mission.fastest(a_dog(limits), jnp.zeros((1, 2))), jnp.zeros((1, 2)))


@given(scenes())
def test_the_mission_is_accomplished_when_all_are_home_and_gathered(scene):
    world, state = scene
    sheep, _, _ = numbers(state)
    assume(not reference.gathered_is_close_call(world, sheep))
    assert bool(accomplished(world, state)) == reference.accomplished(world, sheep)


@pytest.mark.parametrize(
    ("sheep", "done"),
    [
        ([[0.0, 2.0], [0.0, 1.0], [1.0, 1.0]], True),  # one exactly on the border of the disc
        ([[0.0, 2.001], [0.0, 1.0], [1.0, 1.0]], False),  # gathered, one not home
        ([[0.0, 2.0], [2.0, 0.0], [0.0, 0.0]], False),  # all home, not gathered
    ],
)
def test_home_means_within_the_disc_and_gathered_within_f(sheep, done):
    state = mission.start(jnp.array(sheep), jnp.array([[3.0, 3.0]]))
    assert bool(mission.accomplished(preset("paper"), state)) == done


# What is decided in an instant


RULE = Strombom()
move = jax.jit(mission.move)
decide = jax.jit(mission.decide, static_argnames="shepherd")
steer = jax.jit(lambda world, state: RULE(world, state))


@given(scenes())
def test_a_step_moves_everyone_as_is_decided(scene):
    world, state = scene
    decided = decide(world, RULE, state)
    moved = move(world, state, decided.velocity, decided.force)
    after = step(world, state, steer(world, state))
    for part in ("sheep", "dogs", "force"):
        np.testing.assert_allclose(getattr(moved, part), getattr(after, part), atol=1e-6)
    subgoal, drives = gate(world, state.sheep, state.dogs)
    np.testing.assert_allclose(decided.subgoal, subgoal, atol=1e-6)
    assert np.array_equal(decided.drives, drives)


def test_dogs_decide_on_what_they_see_and_sheep_on_what_is():
    world, state = preset("paper"), a_start()
    elsewhere = replace(state, sheep=state.sheep[:, ::-1] * 0.5, dogs=state.dogs + 0.7)
    decided = mission.decide(world, Strombom(), state, seen=elsewhere)
    here, there = (mission.decide(world, Strombom(), seen) for seen in (state, elsewhere))
    assert np.array_equal(decided.velocity, there.velocity)
    assert not np.array_equal(decided.velocity, here.velocity)
    for part in ("force", "subgoal", "drives"):
        assert np.array_equal(getattr(decided, part), getattr(here, part))


# Symmetries


@given(st.data(), scenes())
def test_a_scene_mirrored_in_the_diagonal_moves_mirrored(data, scene):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    assume(not reference.gate_is_close_call(world, sheep, dogs))
    velocity = data.draw(commands(len(dogs)))
    mirror = jax.tree.map(lambda x: x[:, ::-1], state)
    other = with_(world, "arena", goal_x=world.arena.goal_y, goal_y=world.arena.goal_x)
    here, there = step(world, state, velocity), step(other, mirror, velocity[:, ::-1])
    np.testing.assert_allclose(there.sheep[:, ::-1], here.sheep, atol=1e-4)
    np.testing.assert_allclose(there.dogs[:, ::-1], here.dogs, atol=1e-5)
    subgoal, drives = gate(world, state.sheep, state.dogs)
    mirrored_subgoal, mirrored_drives = gate(other, mirror.sheep, mirror.dogs)
    np.testing.assert_allclose(mirrored_subgoal[:, ::-1], subgoal, atol=1e-4)
    assert np.array_equal(mirrored_drives, drives)


@given(st.data(), open_scenes(), st.integers(1, 3))
def test_a_scene_turned_by_right_angles_about_the_goal_moves_turned(data, scene, quarters):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    velocity = data.draw(commands(len(dogs)))
    about = jnp.array([world.arena.goal_x, world.arena.goal_y])

    def turn(v):
        for _ in range(quarters):
            v = jnp.stack([-v[:, 1], v[:, 0]], axis=1)
        return v

    turned = State(
        sheep=turn(state.sheep - about) + about,
        dogs=turn(state.dogs - about) + about,
        force=turn(state.force),
    )
    here, there = step(world, state, velocity), step(world, turned, turn(velocity))
    np.testing.assert_allclose(there.sheep, turn(here.sheep - about) + about, atol=1e-4)
    np.testing.assert_allclose(there.dogs, turn(here.dogs - about) + about, atol=1e-4)


@given(st.data(), open_scenes(), st.sampled_from([(8.0, -3.0), (-5.5, 7.25)]))
def test_a_scene_moved_with_its_goal_steps_alike(data, scene, shift):
    world, state = scene
    velocity = data.draw(commands(len(state.dogs)))
    offset = jnp.array(shift)
    moved = replace(state, sheep=state.sheep + offset, dogs=state.dogs + offset)
    here, there = step(world, state, velocity), step(world, moved, velocity)
    np.testing.assert_allclose(there.sheep, here.sheep + offset, atol=2e-5)
    np.testing.assert_allclose(there.dogs, here.dogs + offset, atol=2e-5)


# Starts


@pytest.mark.parametrize(("sheep", "dogs"), [(1, 1), (3, 2), (40, 3)])
def test_a_random_start_has_its_sheep_opposite_the_goal_and_its_dogs_in_the_arena(sheep, dogs):
    world = preset("paper", 6.0)
    drawn = jax.vmap(lambda key: reset(world, key, sheep, dogs))(
        jax.random.split(jax.random.key(1), 200)
    )
    assert drawn.sheep.shape == (200, sheep, 2)
    assert drawn.dogs.shape == (200, dogs, 2)
    assert np.all((np.asarray(drawn.sheep) >= 3.0) & (np.asarray(drawn.sheep) <= 5.7))
    assert np.all((np.asarray(drawn.dogs) >= 0.0) & (np.asarray(drawn.dogs) <= 6.0))
    assert np.min(drawn.sheep) < 3.1 < 5.6 < np.max(drawn.sheep)
    assert np.min(drawn.dogs) < 0.2 < 5.8 < np.max(drawn.dogs)
    assert np.all(np.asarray(drawn.force) == 0.0)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_start_at_no_position_is_refused_by_its_number_and_value(bad):
    sheep = jnp.array([[1.0, 1.0], [2.0, bad]])
    with pytest.raises(Refusal, match=rf"position 1 of the sheep is \[2.0, {bad}\].*metres"):
        mission.start(sheep, jnp.zeros((1, 2)))
