import math
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from drawn import scenes
from hypothesis import given
from hypothesis import strategies as st
from missions import (
    BLURRED,
    MANY,
    NOISY,
    STEPS,
    Constant,
    a_start,
    fly,
    gate,
    reset,
    step,
    with_,
)

from skydog.shepherds.strombom import Strombom
from skydog.world import mission
from skydog.world.laws.literal import LiteralFlock
from skydog.world.presets import preset

# A rollout


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
