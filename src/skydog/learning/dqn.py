"""DQN (Mnih et al. 2015), DHRL's learner, in one file that knows nothing of sheep."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.learning.replay import Transition
from skydog.learning.weights import adam, soft_update
from skydog.shepherds.networks import GreedyQ


@dataclass(frozen=True)
class Config:
    """The numbers of the algorithm. The paper prints none for DHRL: most are H-DDPG's own."""

    network: tuple[int, ...] = (64, 64)
    """Nodes in the hidden layers; as many as our critic has."""
    rate: float = 1e-3
    """Learning rate; the paper's for its critic."""
    discount: float = 0.99
    """γ (paper, "Deep neural network structure")."""
    batch: int = 32
    """Transitions in a mini-batch (paper, "Deep neural network structure")."""
    memory: int = 100_000
    """Transitions that the replay memory holds (paper, "Deep neural network structure")."""
    tau: float = 0.001
    """λ: how far the target network follows in a step, as H-DDPG's do."""
    epsilon_steps: int = 20_000
    """Steps over which ε falls from 1 to its least. Ours; Mnih et al. take a fiftieth of a
    training, and this is a fifth of the default one, which is five hundred times as short."""
    epsilon_min: float = 0.05
    """The least ε: the share of actions that stay random. Between Mnih et al.'s 0.1 and 0.01."""
    averaging: float = 5.0
    """The skill is the network averaged over about the latest 1/5 of the updates, as DDPG's is."""


class Randomness(eqx.Module):
    """The randomness of one step: whether to explore, by which values, and what is replayed."""

    explore: Float[Array, "*batch"]
    values: Float[Array, "*batch actions"]
    picks: Float[Array, "*batch transitions"]


class DQN(eqx.Module):
    """The learner's whole state: the network, its target, its optimiser."""

    network: GreedyQ
    target: GreedyQ
    skill: GreedyQ  # the network averaged over its recent past: what has been learnt
    updates: Int[Array, ""]
    adam: optax.OptState


def init(key: PRNGKeyArray, observation: int, action: int, config: Config) -> DQN:
    """An untaught learner for so many numbers seen and so many commanded."""
    network = GreedyQ(observation, action, config.network, key)
    return DQN(
        network=network,
        # Copies, so that the loop may donate its whole state: XLA takes no buffer twice.
        target=jax.tree.map(jnp.copy, network),
        skill=jax.tree.map(jnp.copy, network),
        updates=jnp.asarray(0),
        adam=adam(config.rate).init(network),
    )


def draw(key: PRNGKeyArray, action: int, config: Config) -> Randomness:
    """Draw the randomness of one step, all uniform in [0, 1)."""
    for_explore, for_values, for_picks = jax.random.split(key, 3)
    return Randomness(
        explore=jax.random.uniform(for_explore),
        values=jax.random.uniform(for_values, (2 * action,)),
        picks=jax.random.uniform(for_picks, (config.batch,)),
    )


def explore(
    agent: DQN, observation: Float[Array, " seen"], config: Config, drawn: Randomness
) -> tuple[DQN, Float[Array, " action"]]:
    """The action of the highest value, or with probability ε any (ε-greedy)."""
    epsilon = jnp.maximum(config.epsilon_min, 1.0 - agent.updates / config.epsilon_steps)
    values = agent.network.values(observation)
    return agent, agent.network.best(jnp.where(drawn.explore < epsilon, drawn.values, values))


def episode_start(agent: DQN, starts: Bool[Array, ""]) -> DQN:
    """The learner at the start of an episode, which means nothing to it."""
    return agent


def update(agent: DQN, batch: Transition, config: Config) -> DQN:
    """One gradient step on the network, then the target follows."""
    next_value = jnp.max(agent.target.values(batch.next_observation), axis=-1)
    target = batch.reward + config.discount * (1.0 - batch.terminated) * next_value
    taken = agent.network.which(batch.action)

    def loss(network: GreedyQ) -> Float[Array, ""]:
        value = jnp.sum(jnp.where(taken, network.values(batch.observation), 0.0), axis=-1)
        return jnp.mean((value - target) ** 2)

    change, optimiser = adam(config.rate).update(jax.grad(loss)(agent.network), agent.adam)
    network = eqx.apply_updates(agent.network, change)
    share = config.averaging / (agent.updates + config.averaging)
    return DQN(
        network=network,
        target=soft_update(agent.target, network, config.tau),
        skill=soft_update(agent.skill, network, share),
        updates=agent.updates + 1,
        adam=optimiser,
    )
