from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from missions import NOISY, PAPER, with_

from skydog.shepherds.strombom import Strombom
from skydog.world import herding, mission
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.presets import preset

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
