import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds.networks import MLP, Actor, Critic


def by_hand(layers, x):
    *hidden, last = [
        (np.asarray(linear.weight, float), np.asarray(linear.bias, float))
        for linear in layers.linears
    ]
    for weight, bias in hidden:
        x = np.maximum(weight @ x + bias, 0.0)
    weight, bias = last
    return weight @ x + bias


@pytest.mark.parametrize("sizes", [(3, 2), (4, 8, 2), (4, 32, 64, 2)])
def test_layers_are_linear_with_relu_between_them(sizes):
    layers = MLP(sizes, jax.random.key(0))
    for x in np.random.default_rng(0).normal(size=(20, sizes[0])).astype(np.float32):
        np.testing.assert_allclose(layers(jnp.asarray(x)), by_hand(layers, x), atol=1e-5)


def test_an_actor_squashes_its_layers_by_tanh_and_a_critic_sees_the_action_too():
    actor, critic = Actor(4, 2, (8,), jax.random.key(0)), Critic(4, 2, (8,), jax.random.key(1))
    seen, action = np.array([0.3, -2.0, 1.0, 0.1]), np.array([0.5, -0.9])
    found = actor(jnp.asarray(seen, jnp.float32))
    np.testing.assert_allclose(found, np.tanh(by_hand(actor.layers, seen)), atol=1e-6)
    value = critic(jnp.asarray(seen, jnp.float32), jnp.asarray(action, jnp.float32))
    expected = by_hand(critic.layers, np.concatenate([seen, action]))[0]
    np.testing.assert_allclose(value, expected, atol=1e-6)
    assert value.shape == ()


def test_a_batch_is_answered_row_by_row():
    actor = Actor(4, 2, (8, 5), jax.random.key(0))
    seen = jax.random.normal(jax.random.key(1), (3, 6, 4))
    batch = actor(seen)
    assert batch.shape == (3, 6, 2)
    np.testing.assert_allclose(batch[1, 4], actor(seen[1, 4]), atol=1e-6)


def test_every_leaf_is_an_array_and_another_key_gives_other_weights():
    leaves = jax.tree.leaves(Critic(4, 2, (8,), jax.random.key(0)))
    assert [leaf.shape for leaf in leaves] == [(8, 6), (8,), (1, 8), (1,)]
    assert all(isinstance(leaf, jax.Array) for leaf in leaves)
    others = jax.tree.leaves(Critic(4, 2, (8,), jax.random.key(1)))
    assert not np.array_equal(leaves[0], others[0])
    assert np.ptp(np.asarray(leaves[0])) > 0.1
