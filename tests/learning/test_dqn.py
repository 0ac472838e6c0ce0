from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toys import Walk

from skydog.learning import dqn, train
from skydog.learning.replay import Transition
from skydog.shepherds.networks import GreedyQ

# Small and quick, as the toys of DDPG.
QUICK = dqn.Config(network=(32,), rate=3e-3, memory=2_000, tau=0.02, epsilon_steps=2_000)
SMALL = dqn.Config(network=(7, 6), batch=8, memory=16, averaging=2.0, tau=0.1, rate=0.01)
CORNERS = jnp.array([[1.0, 1.0], [-1.0, 0.5], [0.0, -1.0], [0.7, -0.7], [-0.9, 0.0]])
ACTIONS = [[-1, 0], [1, 0], [0, -1], [0, 1]]


def furthest_after_walking(config, seed=0):
    skill = train.train(Walk(), config, seed, 8_000)[0].agent.skill
    position = CORNERS
    for _ in range(30):
        position = position + 0.1 * skill(position)
    return float(jnp.max(jnp.linalg.norm(position, axis=-1)))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_walk_home_in_four_directions_is_learnt(seed):
    assert furthest_after_walking(QUICK, seed) < 0.25


@pytest.mark.parametrize("rate", [0.0, -QUICK.rate], ids=["idle", "one that climbs"])
def test_a_broken_learner_does_not_pass_for_one_that_learnt(rate):
    assert not furthest_after_walking(replace(QUICK, rate=rate)) < 0.25


# One update, in float64 beside it


def transitions(count=8):
    keys = jax.random.split(jax.random.key(3), 4)
    return Transition(
        observation=jax.random.normal(keys[0], (count, 3)),
        action=jnp.array(ACTIONS, jnp.float32)[jnp.arange(count) % 4],
        reward=jax.random.normal(keys[1], (count,)),
        next_observation=jax.random.normal(keys[2], (count, 3)),
        terminated=(jnp.arange(count) % 3 == 0).astype(jnp.float32),
    )


def values(network, x):
    *hidden, last = network.layers.linears
    for linear in hidden:
        x = np.maximum(x @ np.asarray(linear.weight, float).T + np.asarray(linear.bias), 0.0)
    return x @ np.asarray(last.weight, float).T + np.asarray(last.bias)


def test_the_gradient_moves_the_value_of_the_action_taken_towards_reward_and_discounted_best():
    agent, batch = dqn.init(jax.random.key(0), 3, 2, SMALL), transitions()
    taken = np.arange(8) % 4
    best = values(agent.target, np.asarray(batch.next_observation)).max(axis=1)
    target = np.asarray(batch.reward) + 0.99 * (1 - np.asarray(batch.terminated)) * best
    after = dqn.update(agent, batch, SMALL)

    was = values(agent.network, np.asarray(batch.observation))[np.arange(8), taken]
    now = values(after.network, np.asarray(batch.observation))[np.arange(8), taken]
    assert np.mean((now - target) ** 2) < np.mean((was - target) ** 2)
    # Adam's first step is the learning rate along each sign of the slope: of the last bias,
    # by hand.
    slope = np.array([2 * np.sum((was - target)[taken == a]) / 8 for a in range(4)])
    then, before = (one.network.layers.linears[-1].bias for one in (after, agent))
    moved = np.asarray(then) - np.asarray(before)
    np.testing.assert_allclose(moved, -SMALL.rate * np.sign(slope), rtol=1e-3)


def test_target_and_skill_follow_the_network():
    agent = dqn.init(jax.random.key(0), 3, 2, SMALL)
    first = dqn.update(agent, transitions(), SMALL)
    second = dqn.update(first, transitions(), SMALL)
    for old, share in ((first.target, 0.1), (first.skill, 2.0 / (1 + 2.0))):
        new = second.target if share == 0.1 else second.skill
        for was, aim, now in zip(*map(jax.tree.leaves, (old, second.network, new)), strict=True):
            np.testing.assert_allclose(now, was + share * (aim - was), atol=1e-6)


# Choosing and exploring


def test_of_four_actions_the_one_of_the_highest_value_is_chosen():
    network = GreedyQ(3, 2, (5,), jax.random.key(0))
    for place, action in enumerate(ACTIONS):
        assert network.best(jnp.eye(4)[place]).tolist() == action
        assert network.which(jnp.array(action, jnp.float32)).tolist() == [
            place == other for other in range(4)
        ]
    seen = jax.random.normal(jax.random.key(1), (20, 3))
    chosen = np.argmax(np.asarray(network.values(seen)), axis=1)
    assert network(seen).tolist() == [ACTIONS[place] for place in chosen]


@pytest.mark.parametrize(
    ("updates", "epsilon"), [(0, 1.0), (10_000, 0.5), (19_000, 0.05), (10**6, 0.05)]
)
def test_the_share_of_random_actions_falls_to_its_least(updates, epsilon):
    config = dqn.Config(network=(4,))
    agent = replace(dqn.init(jax.random.key(0), 3, 2, config), updates=jnp.asarray(updates))
    seen = jnp.array([0.3, -0.2, 0.5])
    keys = jax.random.split(jax.random.key(1), 4_000)
    draws = jax.vmap(lambda key: dqn.draw(key, 2, config))(keys)
    actions = jax.vmap(lambda drawn: dqn.explore(agent, seen, config, drawn)[1])(draws)
    greedy = np.all(np.asarray(actions) == np.asarray(agent.network(seen)), axis=1)
    assert greedy.mean() == pytest.approx(1 - 0.75 * epsilon, abs=0.03)


def test_a_dqn_training_resumes_bit_for_bit(tmp_path):
    whole, _ = train.train(Walk(), QUICK, 0, 2_000)
    train.train(Walk(), QUICK, 0, 1_000, tmp_path)
    resumed, _ = train.train(Walk(), QUICK, 0, 2_000, tmp_path, resume=True)
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(resumed), strict=True):
        assert np.array_equal(one, other)
