"""The networks of skills and of the learners that train them. They are pytrees of arrays only."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray


class MLP(eqx.Module):
    """A feed-forward network with ReLU after each layer but the last.

    `eqx.nn.MLP` holds its activation as a leaf, which `jax.jit`, `vmap` over seeds and
    safetensors would each have to be told to skip.
    """

    linears: tuple[eqx.nn.Linear, ...]

    def __init__(self, sizes: tuple[int, ...], key: PRNGKeyArray):
        """Random weights for layers of so many nodes, the input's and the output's included."""
        keys = jax.random.split(key, len(sizes) - 1)
        self.linears = tuple(
            eqx.nn.Linear(inward, outward, key=k)
            for inward, outward, k in zip(sizes[:-1], sizes[1:], keys, strict=True)
        )

    def __call__(self, x: Float[Array, "*batch inward"]) -> Float[Array, "*batch outward"]:
        *hidden, last = self.linears
        for linear in hidden:
            x = jax.nn.relu(_through(linear, x))
        return _through(last, x)


class Actor(eqx.Module):
    """The policy τ: what to do. Actions in [-1, 1], squashed by tanh.

    Paper, "Deep neural network structure".
    """

    layers: MLP
    stretches: ClassVar[bool] = True  # its actions have any length, so that 1/ξ can scale them

    def __init__(self, observation: int, action: int, hidden: tuple[int, ...], key: PRNGKeyArray):
        self.layers = MLP((observation, *hidden, action), key)

    def __call__(self, observation: Float[Array, "*batch seen"]) -> Float[Array, "*batch action"]:
        return jnp.tanh(self.layers(observation))


class GreedyQ(eqx.Module):
    """The greedy policy of DQN: of two actions on each axis, -1 and 1, that of the highest Q."""

    layers: MLP
    stretches: ClassVar[bool] = False  # its actions have one length

    def __init__(self, observation: int, action: int, hidden: tuple[int, ...], key: PRNGKeyArray):
        self.layers = MLP((observation, *hidden, 2 * action), key)

    def __call__(self, observation: Float[Array, "*batch seen"]) -> Float[Array, "*batch action"]:
        return self.best(self.values(observation))

    def values(self, observation: Float[Array, "*batch seen"]) -> Float[Array, "*batch actions"]:
        """The value Q of each action: back and forth along each axis in turn."""
        return self.layers(observation)

    def best(self, values: Float[Array, "*batch actions"]) -> Float[Array, "*batch action"]:
        """The action of the highest value."""
        return _steps(values.shape[-1])[jnp.argmax(values, axis=-1)]

    def which(self, action: Float[Array, "*batch action"]) -> Bool[Array, "*batch actions"]:
        """Which of the actions an action is."""
        return jnp.all(action[..., None, :] == _steps(2 * action.shape[-1]), axis=-1)


class Critic(eqx.Module):
    """The value Q of an action: how good it is. In the unit of the summed rewards."""

    layers: MLP

    def __init__(self, observation: int, action: int, hidden: tuple[int, ...], key: PRNGKeyArray):
        self.layers = MLP((observation + action, *hidden, 1), key)

    def __call__(
        self, observation: Float[Array, "*batch seen"], action: Float[Array, "*batch action"]
    ) -> Float[Array, "*batch"]:
        return self.layers(jnp.concatenate([observation, action], axis=-1))[..., 0]


def _steps(actions: int) -> Float[Array, "actions action"]:
    axes = jnp.eye(actions // 2)
    return jnp.stack([-axes, axes], axis=1).reshape(actions, actions // 2)


def _through(linear: eqx.nn.Linear, x: Array) -> Array:
    # On the last axis, so that one call serves a single input and a batch alike.
    return x @ linear.weight.T + linear.bias  # pyright: ignore[reportOperatorIssue]
