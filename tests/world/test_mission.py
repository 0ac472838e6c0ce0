import math
from dataclasses import dataclass, replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from drawn import commands, mixed_scenes, numbers, open_scenes, scenes
from hypothesis import assume, given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.world import herding, mission
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.limits import AnyDirection, Limits, PerAxis
from skydog.world.params import Dog, World
from skydog.world.presets import preset
from skydog.world.state import State

STEPS = 40  # of most rollouts here: each other number compiles again

step = jax.jit(mission.step)
gate = jax.jit(herding.gate)
accomplished = jax.jit(mission.accomplished)
reset = jax.jit(mission.reset, static_argnames=("sheep", "dogs"))
fly = jax.jit(mission.rollout, static_argnames="steps")


def with_(world: World, part: str, **changes) -> World:
    return replace(world, **{part: replace(getattr(world, part), **changes)})


class Constant(eqx.Module):
    """A shepherd that always commands the same, whatever it sees."""

    velocity: jax.Array

    def __call__(self, world: World, state: State) -> jax.Array:
        return jnp.broadcast_to(self.velocity, state.dogs.shape)


# One step


@given(st.data(), scenes())
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


@given(st.data(), mixed_scenes())
def test_a_step_of_a_mixed_flock_moves_each_sheep_by_its_own_law_and_speed(data, scene):
    world, state = scene
    sheep, dogs, previous = numbers(state)
    velocity = data.draw(commands(len(dogs)))
    assume(not reference.force_is_close_call(world, sheep, dogs, previous))
    after = step(world, state, velocity)
    expected = reference.step(world, sheep, dogs, previous, np.asarray(velocity, float))
    np.testing.assert_allclose(after.sheep, expected[0], atol=1e-4)


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


decide = jax.jit(mission.decide, static_argnames="shepherd")


@given(scenes())
def test_a_step_moves_everyone_as_is_decided(scene):
    world, state = scene
    decided = decide(world, Strombom(), state)
    moved = mission.move(world, state, decided.velocity, decided.force)
    after = step(world, state, jax.jit(Strombom())(world, state))
    for part in ("sheep", "dogs", "force"):
        np.testing.assert_allclose(getattr(moved, part), getattr(after, part), atol=1e-6)
    subgoal, drives = gate(world, state.sheep, state.dogs)
    np.testing.assert_allclose(decided.subgoal, subgoal, atol=1e-6)
    assert np.array_equal(decided.drives, drives)


def test_dogs_decide_on_what_they_see_and_sheep_on_what_is():
    world, state = preset("paper"), a_start()
    elsewhere = replace(state, sheep=state.sheep[:, ::-1] * 0.5, dogs=state.dogs + 0.7)
    decided = mission.decide(world, Strombom(), state, elsewhere)
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


# A rollout


def a_start(seed=3, sheep=3, dogs=1, world=None):
    return reset(world or preset("paper"), jax.random.key(seed), sheep, dogs)


def test_a_rollout_is_its_steps_taken_by_hand():
    world, shepherd, state = preset("paper"), Strombom(), a_start()
    trace = fly(world, shepherd, state, steps=STEPS)
    assert not trace.accomplished[-1]
    steer = jax.jit(shepherd)
    for now in range(STEPS + 1):
        np.testing.assert_allclose(trace.sheep[now], state.sheep, atol=1e-4)
        np.testing.assert_allclose(trace.dogs[now], state.dogs, atol=1e-4)
        subgoal, drives = gate(world, state.sheep, state.dogs)
        np.testing.assert_allclose(trace.subgoal[now], subgoal, atol=1e-4)
        assert np.array_equal(trace.drives[now], drives)
        if now < STEPS:
            command = steer(world, state)
            np.testing.assert_allclose(trace.command[now], command, atol=1e-3)
            state = step(world, state, command)
    np.testing.assert_allclose(trace.time, 0.1 * np.arange(STEPS + 1), rtol=1e-6)


def test_each_instant_of_a_noisy_trace_follows_from_the_one_before_and_the_command():
    world = with_(preset("paper"), "dog", perception_noise=0.2)
    trace = fly(world, Strombom(), a_start(), steps=STEPS, key=jax.random.key(5))
    flown = np.clip(np.asarray(trace.command[:-1]), -1, 1) * 0.1
    np.testing.assert_allclose(trace.dogs[1:], trace.dogs[:-1] + flown, atol=1e-5)


def test_the_last_instant_commands_nothing():
    trace = fly(
        preset("paper"), Constant(jnp.array([0.3, 0.4])), a_start(), STEPS, jax.random.key(0)
    )
    assert np.all(np.asarray(trace.command[:-1]) == np.array([0.3, 0.4], np.float32))
    assert np.all(np.asarray(trace.command[-1]) == 0.0)


def test_a_rollout_of_no_steps_is_its_start():
    state = a_start()
    trace = fly(preset("paper"), Strombom(), state, steps=0)
    assert trace.sheep.shape == (1, 3, 2)
    assert np.array_equal(trace.sheep[0], state.sheep)


def test_after_the_mission_is_accomplished_the_world_stands_still():
    nearly = mission.start(jnp.array([[1.6, 1.6], [1.9, 1.6], [1.6, 1.9]]), jnp.array([[3.0, 3.0]]))
    trace = fly(preset("paper"), Strombom(), nearly, steps=STEPS)
    done = np.asarray(trace.accomplished)
    end = int(np.argmax(done))
    assert done[-1]
    assert 0 < end < STEPS
    assert np.all(done[end:])
    assert not np.any(done[:end])
    assert np.all(np.asarray(trace.command[end:]) == 0.0)
    for part in (trace.sheep, trace.dogs, trace.subgoal, trace.drives):
        assert np.all(np.asarray(part[end:]) == np.asarray(part[end]))
    assert not np.array_equal(trace.sheep[end - 1], trace.sheep[end])


def test_a_mission_accomplished_at_its_start_moves_nobody():
    home = mission.start(jnp.array([[0.5, 0.5], [0.7, 0.5], [0.5, 0.9]]), jnp.array([[0.6, 0.6]]))
    trace = fly(preset("paper"), Strombom(), home, steps=STEPS)
    assert np.all(trace.accomplished)
    assert np.all(np.asarray(trace.sheep) == np.asarray(home.sheep))


# Degenerate states, and gradients

DEGENERATE = {
    "all in the goal's corner": ([[0.0, 0.0]] * 3, [[0.0, 0.0]]),
    "sheep on one another": ([[2.1, 2.1]] * 3, [[3.0, 3.0]]),
    "a dog on a sheep": ([[2.0, 2.0], [2.5, 2.0], [2.0, 3.0]], [[2.0, 2.0]]),
    "a dog on the flock's centre": ([[1.0, 2.0], [3.0, 2.0], [2.0, 2.0]], [[2.0, 2.0]]),
    "sheep in corners": ([[0.0, 4.0], [4.0, 0.0], [4.0, 4.0]], [[2.0, 2.0]]),
    "a dog in the airspace's corner": ([[2.0, 2.0], [2.0, 3.0], [3.0, 2.0]], [[5.4, 5.4]]),
    "no dog in sight": ([[0.0, 0.0], [0.1, 0.1], [0.2, 0.0]], [[5.0, 5.0]]),
    "one sheep": ([[2.0, 2.0]], [[2.5, 2.0]]),
    "one sheep under the dog": ([[2.0, 2.0]], [[2.0, 2.0]]),
    "dogs on one another": ([[2.0, 2.0], [2.0, 3.0], [3.0, 2.0]], [[2.5, 2.5]] * 2),
    "two dogs at a flock in one point": ([[2.1, 2.1]] * 3, [[2.1, 2.1]] * 2),
}


def the_degenerate(name):
    sheep, dogs = DEGENERATE[name]
    return mission.start(jnp.array(sheep), jnp.array(dogs))


def parameters(world):
    return jax.tree.map(jnp.float32, world)


@jax.jit
def gradients_of_a_step(world, state, velocity):
    def end(world, state, velocity):
        after = mission.step(world, state, velocity)
        subgoal, _ = herding.gate(world, after.sheep, after.dogs)
        return sum(jnp.sum(x) for x in (after.sheep, after.dogs, after.force, subgoal))

    return jax.value_and_grad(end, argnums=(0, 1, 2))(world, state, velocity)


@jax.jit
def gradients_of_a_ruled_flight(world, state):
    def where_all_end(world, state):
        trace = mission.rollout(world, Strombom(), state, steps=10)
        return jnp.sum(trace.sheep) + jnp.sum(trace.dogs) + jnp.sum(trace.subgoal)

    return jax.value_and_grad(where_all_end, argnums=(0, 1))(world, state)


def assert_finite(tree):
    for leaf in jax.tree.leaves(tree):
        assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("name", DEGENERATE)
def test_a_step_from_a_degenerate_state_and_its_gradients_are_finite(name):
    state = the_degenerate(name)
    for velocity in (jnp.zeros_like(state.dogs), jnp.full_like(state.dogs, 1.0)):
        assert_finite(gradients_of_a_step(parameters(preset("paper")), state, velocity))


@pytest.mark.parametrize(
    "name",
    [name for name, (sheep, dogs) in DEGENERATE.items() if (len(sheep), len(dogs)) == (3, 1)],
)
def test_ten_steps_under_the_rule_dog_and_their_gradients_are_finite(name):
    assert_finite(gradients_of_a_ruled_flight(parameters(preset("paper")), the_degenerate(name)))


def test_gradients_are_finite_with_the_goal_on_the_flock():
    state = the_degenerate("sheep on one another")
    world = with_(preset("paper"), "arena", goal_x=2.1, goal_y=2.1, goal_radius=0.5)
    assert_finite(gradients_of_a_step(parameters(world), state, jnp.array([[0.1, 0.0]])))


@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf])
def test_a_command_that_is_no_number_leaves_the_other_gradients_finite(bad):
    velocity, state = jnp.array([[bad, 1.0]]), the_degenerate("a dog on a sheep")
    assert_finite(gradients_of_a_step(parameters(preset("paper")), state, velocity))


@jax.jit
def gradients_of_a_noisy_step(world, state):
    def end(world, state):
        after = mission.step(world, state, jnp.zeros((1, 2)), jax.random.key(0))
        return jnp.sum(after.sheep) + jnp.sum(after.force)

    return jax.value_and_grad(end, argnums=(0, 1))(world, state)


@pytest.mark.parametrize("law", [LiteralFlock, partial(StrombomFlock, neighbours=1)])
@pytest.mark.parametrize("name", ["sheep on one another", "a dog on a sheep"])
def test_a_noisy_step_of_every_law_has_finite_gradients(name, law):
    weights = {name: value for name, value in vars(PAPER.flock).items() if name != "noise"}
    world = replace(NOISY, flock=law(**weights, noise=0.3))
    assert_finite(gradients_of_a_noisy_step(parameters(world), the_degenerate(name)))


# jit and vmap


def test_missions_flown_together_are_the_missions_flown_one_by_one():
    world, count = preset("paper"), 5
    drawn = jax.vmap(lambda key: reset(world, key))(jax.random.split(jax.random.key(2), count))
    together = jax.jit(jax.vmap(lambda s: mission.rollout(world, Strombom(), s, STEPS)))(drawn)
    for i in range(count):
        alone = fly(world, Strombom(), jax.tree.map(lambda x, i=i: x[i], drawn), steps=STEPS)
        np.testing.assert_allclose(together.sheep[i], alone.sheep, atol=1e-3)
        np.testing.assert_allclose(together.dogs[i], alone.dogs, atol=1e-3)
        assert np.array_equal(together.accomplished[i], alone.accomplished)


def test_worlds_of_different_sizes_and_speeds_fly_together_as_they_fly_alone():
    worlds = [
        preset("paper", 4.0),
        preset("paper", 6.0),
        with_(preset("paper", 5.0), "dog", speed=0.5),
        with_(preset("paper-w05", 4.0), "sheep", speed=0.3),
    ]
    stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.float32(x) for x in leaves]), *worlds)
    state = a_start()
    together = jax.jit(jax.vmap(lambda w: mission.rollout(w, Strombom(), state, STEPS)))(stacked)
    for i, world in enumerate(worlds):
        alone = fly(world, Strombom(), state, steps=STEPS)
        np.testing.assert_allclose(together.sheep[i], alone.sheep, atol=1e-3)
        np.testing.assert_allclose(together.dogs[i], alone.dogs, atol=1e-3)
        np.testing.assert_allclose(together.world.arena.size[i], world.arena.size)


def test_a_second_mission_of_the_same_shepherd_is_not_compiled_again():
    world, compiled = preset("paper"), []

    class Counted(eqx.Module):
        gain: jax.Array

        def __call__(self, world, state):
            compiled.append(True)
            return self.gain * Strombom()(world, state)

    first = mission.rollout(world, Counted(jnp.asarray(1.0)), a_start(), 20)
    once = len(compiled)
    second = mission.rollout(world, Counted(jnp.asarray(0.5)), a_start(), 20)
    assert len(compiled) == once > 0
    assert (first.dogs[-1] != second.dogs[-1]).any()


def test_a_shepherd_that_was_changed_flies_as_it_is_now():
    @dataclass
    class Changing:
        gain: float

        def __call__(self, world, state):
            return self.gain * Strombom()(world, state)

    def flown():
        return mission.rollout(preset("paper"), shepherd, a_start(), 20).dogs

    shepherd = Changing(1.0)
    assert (flown()[-1] != a_start().dogs).any()
    shepherd.gain = 0.0
    np.testing.assert_array_equal(flown()[-1], a_start().dogs)


def test_one_compiled_mission_serves_every_arena_and_every_speed():
    compiled = []

    @jax.jit
    def flown(world, state):
        compiled.append(True)
        return mission.rollout(world, Strombom(), state, 20).sheep[-1]

    ends = [
        flown(world, a_start(world=world))
        for world in (
            preset("paper", 4.0),
            preset("paper", 6.0),
            with_(preset("paper", 4.0), "dog", speed=0.4),
        )
    ]
    assert len(compiled) == 1
    assert not np.array_equal(ends[0], ends[2])


# Noise

MANY = jax.random.split(jax.random.key(0), 4000)
PAPER = preset("paper")
BLURRED = with_(preset("paper"), "dog", perception_noise=0.5)
NOISY = with_(
    replace(PAPER, flock=StrombomFlock(**{**vars(PAPER.flock), "noise": 0.3}, graze=0.1)),
    "dog",
    actuation_noise=0.1,
    perception_noise=0.05,
)


def test_a_mission_in_a_world_without_noise_is_the_same_with_and_without_a_key():
    quiet = fly(preset("paper"), Strombom(), a_start(), steps=STEPS)
    keyed = fly(preset("paper"), Strombom(), a_start(), steps=STEPS, key=jax.random.key(0))
    np.testing.assert_allclose(keyed.sheep, quiet.sheep, atol=1e-4)
    np.testing.assert_allclose(keyed.dogs, quiet.dogs, atol=1e-4)


@given(scenes(LiteralFlock, shapes=[(3, 1)]), st.integers(0, 9))
def test_a_literal_step_in_a_world_without_noise_is_the_same_with_and_without_a_key(scene, seed):
    world, state = scene
    told = jnp.ones((1, 2))
    quiet, keyed = step(world, state, told), step(world, state, told, jax.random.key(seed))
    np.testing.assert_allclose(keyed.sheep, quiet.sheep, atol=1e-6)


def test_the_same_key_gives_the_same_mission_and_another_key_another():
    first, again, other = (
        fly(NOISY, Strombom(), a_start(), steps=STEPS, key=jax.random.key(seed))
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first.sheep, again.sheep)
    assert np.array_equal(first.dogs, again.dogs)
    assert not np.allclose(first.sheep, other.sheep, atol=1e-2)
    assert not np.allclose(first.dogs, other.dogs, atol=1e-2)


def test_perception_noise_moves_nobody_when_the_command_is_fixed():
    shepherd, key = Constant(jnp.array([0.3, -0.2])), jax.random.key(4)
    clear = fly(preset("paper"), shepherd, a_start(), steps=STEPS, key=key)
    blurred = fly(BLURRED, shepherd, a_start(), steps=STEPS, key=key)
    assert np.array_equal(blurred.sheep, clear.sheep)
    assert np.array_equal(blurred.dogs, clear.dogs)


def test_perception_noise_misleads_a_dog_that_looks():
    key = jax.random.key(4)
    clear = fly(preset("paper"), Strombom(), a_start(), steps=STEPS, key=key)
    blurred = fly(BLURRED, Strombom(), a_start(), steps=STEPS, key=key)
    assert not np.allclose(blurred.dogs, clear.dogs, atol=1e-2)


def test_actuation_noise_has_the_spread_asked_for_on_each_axis_each_step():
    world = with_(preset("paper", 100.0), "dog", actuation_noise=0.2)
    middle = mission.start(jnp.full((3, 2), 10.0), jnp.full((1, 2), 50.0))
    told = jnp.array([[0.5, 0.0]])
    after = jax.jit(jax.vmap(lambda key: mission.step(world, middle, told, key)))(MANY)
    velocity = np.asarray(after.dogs - middle.dogs, float)[:, 0] / 0.1
    np.testing.assert_allclose(velocity.mean(axis=0), [0.5, 0.0], atol=5 * 0.2 / math.sqrt(4000))
    np.testing.assert_allclose(velocity.std(axis=0), 0.2, rtol=0.06)


def test_perception_noise_has_the_spread_asked_for_and_leaves_the_force():
    world = with_(preset("paper"), "dog", perception_noise=0.3)
    state = a_start()
    seen = jax.jit(jax.vmap(lambda key: mission.perceive(world, state, key)))(MANY)
    np.testing.assert_allclose(np.std(np.asarray(seen.sheep), axis=0), 0.3, rtol=0.06)
    np.testing.assert_allclose(np.std(np.asarray(seen.dogs), axis=0), 0.3, rtol=0.06)
    assert np.all(np.asarray(seen.force) == np.asarray(state.force))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_start_at_no_position_is_refused_by_its_number_and_value(bad):
    sheep = jnp.array([[1.0, 1.0], [2.0, bad]])
    with pytest.raises(Refusal, match=rf"position 1 of the sheep is \[2.0, {bad}\].*metres"):
        mission.start(sheep, jnp.zeros((1, 2)))
