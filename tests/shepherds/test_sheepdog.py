import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds import store
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import OBSERVES, Sheepdog, observe
from skydog.world import herding, mission
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.presets import preset

FOUR, SIX = preset("paper", 4.0), preset("paper", 6.0)
GATHERED = [[2.0, 2.0], [2.4, 2.0], [2.0, 2.6]]
SCATTERED = [[1.0, 1.0], [1.2, 1.0], [3.6, 3.4]]
DOG = [3.3, 2.9]


def an_actor(seed: int, loudness: float = 1.0) -> Actor:
    actor = Actor(4, 2, (8, 6), jax.random.key(seed))
    return jax.tree.map(lambda leaf: loudness * leaf, actor)


TAUGHT_IN_FOUR = Sheepdog(an_actor(0), an_actor(1), 4.0, "paper")
FOLDED = Sheepdog(an_actor(0), an_actor(1), 4.0)


def at(sheep, *dogs):
    return mission.start(jnp.array(sheep, jnp.float32), jnp.array(dogs, jnp.float32))


# The symmetries of the square about the middle of an arena of 4 m: of a place, and of a velocity.
SYMMETRIES = [
    np.array(turn) @ np.diag(flip)
    for turn in ([[1, 0], [0, 1]], [[0, 1], [1, 0]])
    for flip in ([1, 1], [1, -1], [-1, 1], [-1, -1])
]


def by_hand(actor, world, state, drives, dog=0):
    """Observation and action from positions, in float64."""
    sheep, where = np.asarray(state.sheep, float), np.asarray(state.dogs[dog], float)
    centre = sheep.mean(axis=0)
    if drives:
        subgoal = centre + np.sqrt(3) * centre / np.linalg.norm(centre)
    else:
        stray = sheep[np.argmax(np.linalg.norm(sheep - centre, axis=1))]
        subgoal = stray + (stray - centre) / np.linalg.norm(stray - centre)
    seen = np.concatenate([where - centre, where - subgoal])
    xi = 4.0 / world.arena.size
    x = xi * seen
    *hidden, last = actor.layers.linears
    for linear in hidden:
        x = np.maximum(np.asarray(linear.weight, float) @ x + np.asarray(linear.bias), 0.0)
    action = np.tanh(np.asarray(last.weight, float) @ x + np.asarray(last.bias))
    return action if xi == 1.0 else np.tanh(action / xi)


@pytest.mark.parametrize(("sheep", "drives"), [(GATHERED, True), (SCATTERED, False)])
@pytest.mark.parametrize("world", [FOUR, SIX], ids=["its own arena", "another"])
def test_the_gates_skill_is_flown_and_scaled_only_in_another_arena(world, sheep, drives):
    state = at(sheep, DOG)
    assert bool(herding.gathered(world, state.sheep)) == drives
    actor = TAUGHT_IN_FOUR.drive if drives else TAUGHT_IN_FOUR.collect
    other = TAUGHT_IN_FOUR.collect if drives else TAUGHT_IN_FOUR.drive
    command = TAUGHT_IN_FOUR(world, state)[0]
    np.testing.assert_allclose(command, by_hand(actor, world, state, drives), atol=1e-5)
    assert np.abs(command - by_hand(other, world, state, drives)).max() > 1e-3


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=range(8))
@pytest.mark.parametrize("sheepdog", [FOLDED, *map(store.load, ("h-ddpg-4x4", "dhrl-4x4"))])
def test_a_folded_sheepdog_flies_a_mirrored_world_as_the_mirrored_way(sheepdog, symmetry):
    sheepdog = replace(sheepdog, frame="folded")
    world = replace(FOUR, arena=replace(FOUR.arena, goal_x=0.5, goal_y=1.0))

    def mirrored(places):
        return (np.asarray(places) - 2.0) @ symmetry.T + 2.0

    x, y = mirrored([0.5, 1.0]).tolist()
    other = replace(FOUR, arena=replace(FOUR.arena, goal_x=x, goal_y=y))
    for key in jax.random.split(jax.random.key(1), 20):
        state = mission.reset(world, key)
        turned = at(mirrored(state.sheep), *mirrored(state.dogs))
        expected = np.asarray(sheepdog(world, state)) @ symmetry.T
        np.testing.assert_allclose(sheepdog(other, turned), expected, atol=1e-5)


def test_in_the_octant_of_the_fold_both_frames_are_the_same():
    state = at([[2.6, 1.2], [3.0, 1.3], [2.8, 1.7]], DOG)  # to the right of the goal, and above
    assert np.array_equal(FOLDED(FOUR, state), TAUGHT_IN_FOUR(FOUR, state))
    above = at([[1.2, 2.6], [1.3, 3.0], [1.7, 2.8]], DOG)
    assert not np.allclose(FOLDED(FOUR, above), TAUGHT_IN_FOUR(FOUR, above), atol=1e-3)


def test_what_is_seen_are_the_vectors_to_the_dog_from_centre_and_subgoal():
    sheep = jnp.array([[1.0, 1.0], [2.0, 1.0], [3.0, 4.0]])
    seen = observe(sheep, jnp.array([[2.5, 3.0]]), jnp.array([[4.0, 1.0]]))
    assert seen.tolist() == [[0.5, 1.0, -1.5, 2.0]]
    assert seen.shape[1] == len(OBSERVES)


@pytest.mark.parametrize("speed", [1.0, 0.4, 3.0])
@pytest.mark.parametrize("limits", [PerAxis(), AnyDirection()])
def test_a_command_uses_the_speed_limit_and_keeps_it(speed, limits):
    world = replace(FOUR, dog=replace(FOUR.dog, speed=speed, limits=limits))
    loud = Sheepdog(an_actor(0, 30.0), an_actor(1, 30.0), 4.0)
    fastest = 0.0
    for key in jax.random.split(jax.random.key(0), 20):
        command = np.asarray(loud(world, mission.reset(world, key))[0])
        length = np.abs(command).max() if limits == PerAxis() else np.linalg.norm(command)
        assert length <= speed * (1 + 1e-6)
        fastest = max(fastest, length)
    assert fastest > 0.95 * speed


def test_several_dogs_are_each_commanded_by_what_they_see_themselves():
    dogs = [[3.3, 2.9], [0.5, 3.5], [3.8, 0.2]]
    state = at(GATHERED, *dogs)
    commands = TAUGHT_IN_FOUR(FOUR, state)
    points = herding.driving_points(FOUR, state.sheep, state.dogs)
    seen = observe(state.sheep, state.dogs, herding.within_airspace(FOUR, points))
    assert commands.shape == (3, 2)
    for dog in range(3):
        np.testing.assert_allclose(commands[dog], TAUGHT_IN_FOUR.drive(seen[dog]), atol=1e-6)
    assert len(np.unique(np.asarray(commands).round(4), axis=0)) == 3


@pytest.mark.parametrize("name", ["h-ddpg-4x4", "dhrl-4x4"])
@pytest.mark.parametrize("blind", ["sheep", "dogs"])
@pytest.mark.parametrize("lost", [math.nan, math.inf])
def test_a_dog_that_cannot_see_hovers(name, blind, lost):
    state = mission.reset(preset("paper"), jax.random.key(0))
    state = eqx.tree_at(
        lambda state: getattr(state, blind), state, replace_fn=lambda at: at.at[0, 1].set(lost)
    )
    assert not np.asarray(store.load(name)(preset("paper"), state)).any()
