from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toys import QUICK, Bandit, Count, Walk

from skydog.learning import ddpg, train
from skydog.learning.replay import Transition

STEPS = 6_000
SEEN = jnp.linspace(-1.0, 1.0, 9)[:, None]
CORNERS = jnp.array([[1.0, 1.0], [-1.0, 0.5], [0.0, -1.0], [0.7, -0.7], [-0.9, 0.0]])


def taught(task, config, seed=0):
    return train.train(task, config, seed, STEPS)[0].agent.skill


def knows_the_best_action(skill) -> bool:
    return bool(jnp.max(jnp.abs(skill(SEEN) - 0.6 * SEEN)) < 0.15)


def walks_home(skill) -> bool:
    position = CORNERS
    for _ in range(30):
        position = position + 0.1 * skill(position)
    return bool(jnp.max(jnp.linalg.norm(position, axis=-1)) < 0.25)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_best_action_of_a_bandit_is_learnt(seed):
    assert knows_the_best_action(taught(Bandit(), QUICK, seed))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_walk_home_over_many_steps_is_learnt(seed):
    assert walks_home(taught(Walk(), QUICK, seed))


@pytest.mark.parametrize(
    "broken",
    [{"actor_rate": 0.0}, {"actor_rate": -QUICK.actor_rate}, {"critic_rate": 0.0}],
    ids=["an idle actor", "an actor that descends", "an idle critic"],
)
def test_a_broken_learner_does_not_pass_for_one_that_learnt(broken):
    config = replace(QUICK, **broken)
    assert not knows_the_best_action(taught(Bandit(), config))
    assert not walks_home(taught(Walk(), config))


# One update, by hand


SMALL = ddpg.Config(actor=(5,), critic=(7, 6), batch=8, memory=16, averaging=2.0, tau=0.1)


def numbers(network):
    return [
        [np.asarray(linear.weight, np.float64), np.asarray(linear.bias, np.float64)]
        for linear in network.layers.linears
    ]


def forward(layers, x):
    """The inputs of each layer, and the output."""
    inputs = [x]
    for weight, bias in layers[:-1]:
        inputs.append(np.maximum(inputs[-1] @ weight.T + bias, 0.0))
    weight, bias = layers[-1]
    return inputs, inputs[-1] @ weight.T + bias


def backward(layers, inputs, slope):
    """The loss's gradients on weights and biases, and on the input, from that on the output."""
    gradients = []
    for depth in reversed(range(len(layers))):
        gradients.insert(0, [slope.T @ inputs[depth], slope.sum(axis=0)])
        slope = slope @ layers[depth][0]
        if depth:
            slope = slope * (inputs[depth] > 0)
    return gradients, slope


class Adam:
    """Kingma and Ba 2015, Algorithm 1."""

    def __init__(self, layers, rate):
        self.rate, self.t = rate, 0
        self.m = [[np.zeros_like(part) for part in layer] for layer in layers]
        self.v = [[np.zeros_like(part) for part in layer] for layer in layers]

    def step(self, layers, gradients):
        self.t += 1
        for layer, gradient, m, v in zip(layers, gradients, self.m, self.v, strict=True):
            for part in range(2):
                m[part] = 0.9 * m[part] + 0.1 * gradient[part]
                v[part] = 0.999 * v[part] + 0.001 * gradient[part] ** 2
                m_hat, v_hat = m[part] / (1 - 0.9**self.t), v[part] / (1 - 0.999**self.t)
                layer[part] = layer[part] - self.rate * m_hat / (np.sqrt(v_hat) + 1e-8)


def mixed(old, new, share):
    return [
        [(1 - share) * was + share * now for was, now in zip(before, after, strict=True)]
        for before, after in zip(old, new, strict=True)
    ]


class Reference:
    """Algorithm 1's update in float64, its gradients by hand."""

    actor: list
    critic: list
    target_actor: list
    target_critic: list
    skill: list

    def __init__(self, agent, config):
        self.config, self.n = config, 0
        for name in ("actor", "critic", "target_actor", "target_critic", "skill"):
            setattr(self, name, numbers(getattr(agent, name)))
        self.actor_adam = Adam(self.actor, config.actor_rate)
        self.critic_adam = Adam(self.critic, config.critic_rate)

    def update(self, seen, action, reward, then, terminated):
        count, config = len(reward), self.config
        next_action = np.tanh(forward(self.target_actor, then)[1])
        _, next_value = forward(self.target_critic, np.hstack([then, next_action]))
        target = reward + config.discount * np.where(terminated == 1, 0.0, next_value[:, 0])

        inputs, value = forward(self.critic, np.hstack([seen, action]))
        gradients, _ = backward(self.critic, inputs, 2 * (value - target[:, None]) / count)
        self.critic_adam.step(self.critic, gradients)

        actor_inputs, unsquashed = forward(self.actor, seen)
        chosen = np.tanh(unsquashed)
        inputs, _ = forward(self.critic, np.hstack([seen, chosen]))
        _, by_input = backward(self.critic, inputs, -np.ones((count, 1)) / count)
        by_action = by_input[:, seen.shape[1] :]
        gradients, _ = backward(self.actor, actor_inputs, by_action * (1 - chosen**2))
        self.actor_adam.step(self.actor, gradients)

        self.target_actor = mixed(self.target_actor, self.actor, config.tau)
        self.target_critic = mixed(self.target_critic, self.critic, config.tau)
        share = config.averaging / (self.n + config.averaging)
        self.skill = mixed(self.skill, self.actor, share)
        self.n += 1


def a_batch(draw, count=SMALL.batch, seen=3, action=2):
    return (
        draw.normal(size=(count, seen)),
        draw.uniform(-1, 1, (count, action)),
        draw.normal(size=count),
        draw.normal(size=(count, seen)),
        (draw.uniform(size=count) < 0.4).astype(float),
    )


def test_updates_are_those_of_the_algorithm_with_gradients_by_hand():
    config = replace(SMALL, actor_rate=0.01, critic_rate=0.02)
    agent = ddpg.init(jax.random.key(1), 3, 2, config)
    reference, draw = Reference(agent, config), np.random.default_rng(0)
    update = jax.jit(ddpg.update, static_argnums=2)
    for _ in range(5):
        batch = a_batch(draw)
        agent = update(agent, Transition(*(jnp.asarray(x, jnp.float32) for x in batch)), config)
        reference.update(*batch)
    for name in ("critic", "actor", "target_critic", "target_actor", "skill"):
        for found, expected in zip(
            numbers(getattr(agent, name)), getattr(reference, name), strict=True
        ):
            np.testing.assert_allclose(found[0], expected[0], atol=1e-4, err_msg=name)
            np.testing.assert_allclose(found[1], expected[1], atol=1e-4, err_msg=name)


def test_the_first_skill_is_the_actor_and_later_ones_lag_behind_it():
    agent = ddpg.init(jax.random.key(1), 3, 2, SMALL)
    draw = np.random.default_rng(0)
    for update in range(2):
        batch = Transition(*(jnp.asarray(x, jnp.float32) for x in a_batch(draw)))
        agent = ddpg.update(agent, batch, SMALL)
        same = np.array_equal(
            agent.skill.layers.linears[0].weight, agent.actor.layers.linears[0].weight
        )
        assert same == (update == 0)


# Ends


def what_the_critic_is_taught(terminated: float) -> tuple[float, float]:
    """The value to which many updates bring the critic, for reward 1 and a constant next value."""
    config = replace(SMALL, tau=0.0, critic_rate=0.01, actor_rate=0.0)
    agent = ddpg.init(jax.random.key(3), 1, 1, config)
    one = jnp.ones((8, 1))
    batch = Transition(one, one, jnp.ones(8), one, jnp.full(8, terminated))
    update = jax.jit(ddpg.update, static_argnums=2)
    for _ in range(400):
        agent = update(agent, batch, config)
    next_value = agent.target_critic(one, agent.target_actor(one))[0]
    return float(agent.critic(one, one)[0]) - 1.0, float(config.discount * next_value)


def test_after_the_end_of_a_task_nothing_more_is_expected():
    beyond, _ = what_the_critic_is_taught(terminated=1.0)
    assert abs(beyond) < 0.01


def test_otherwise_the_discounted_value_of_what_follows_is():
    beyond, expected = what_the_critic_is_taught(terminated=0.0)
    assert abs(expected) > 0.02
    assert abs(beyond - expected) < 0.01


def remembered(task, steps=6):
    config = replace(SMALL, memory=10)
    training = train.init(task, config, jax.random.key(0))
    training, ended = train.advance(task, config, training, jax.random.key(1), steps)
    columns = np.asarray(training.memory.ring[:steps])
    seen, _, reward, then, terminated = columns.T
    return seen, reward, then, terminated, np.asarray(ended.ended)


def test_an_episode_cut_off_by_time_is_remembered_as_going_on():
    seen, reward, then, terminated, ended = remembered(Count(cut=3))
    assert terminated.tolist() == [0] * 6
    assert ended.tolist() == [False, False, True] * 2
    assert seen.tolist() == [0, 1, 2] * 2
    assert then.tolist() == [1, 2, 3] * 2  # what was there, not the next episode's start
    assert reward.tolist() == [1, 2, 3] * 2


def test_an_episode_that_ends_by_itself_is_remembered_as_ended():
    seen, _, then, terminated, ended = remembered(Count(ends=3))
    assert terminated.tolist() == [0, 0, 1] * 2
    assert ended.tolist() == [False, False, True] * 2
    assert then.tolist() == [1, 2, 3] * 2
    assert seen.tolist() == [0, 1, 2] * 2


def test_no_update_is_made_before_a_whole_batch_is_remembered():
    config = replace(SMALL, batch=8)
    for steps, updates in ((7, 0), (8, 1), (12, 5)):
        training = train.init(Count(), config, jax.random.key(0))
        training, _ = train.advance(Count(), config, training, jax.random.key(1), steps)
        assert int(training.agent.updates) == updates


def kicked(*kick: float) -> ddpg.Randomness:
    return ddpg.Randomness(kick=jnp.array(kick), picks=jnp.zeros(SMALL.batch))


def test_exploring_adds_the_noise_and_stays_within_the_commands():
    agent = ddpg.init(jax.random.key(0), 3, 2, SMALL)
    seen = jnp.array([0.1, -0.2, 0.3])
    quiet, action = ddpg.explore(agent, seen, SMALL, kicked(0.5, -0.5))
    np.testing.assert_allclose(action, agent.actor(seen) + quiet.noise, rtol=1e-6)
    np.testing.assert_allclose(quiet.noise, [0.1, -0.1], rtol=1e-6)
    _, wild = ddpg.explore(agent, seen, SMALL, kicked(100.0, -100.0))
    assert wild.tolist() == [1.0, -1.0]
