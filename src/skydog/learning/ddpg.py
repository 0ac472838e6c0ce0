"""DDPG (paper, Algorithm 1; Lillicrap et al. 2015), in one file that knows nothing of sheep."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.learning.noise import ornstein_uhlenbeck
from skydog.learning.replay import Transition
from skydog.learning.weights import adam, soft_update
from skydog.shepherds.networks import Actor, Critic


@dataclass(frozen=True)
class Config:
    """The numbers of Algorithm 1."""

    actor: tuple[int, ...] = (32, 64)
    """Nodes in the actor's hidden layers (paper, "Deep neural network structure")."""
    critic: tuple[int, ...] = (64, 64)
    """Nodes in the critic's, which sees state and action side by side. The paper says only that
    it is "more complex" than the actor's; a first layer of twice the nodes for half again as
    many inputs is the least that is, and costs a tenth of the training speed."""
    actor_rate: float = 2.5e-4
    """Learning rate of the actor (paper, "Deep neural network structure")."""
    critic_rate: float = 1e-3
    """Learning rate of the critic (paper, "Deep neural network structure")."""
    discount: float = 0.99
    """γ (paper, "Deep neural network structure")."""
    batch: int = 32
    """Transitions in a mini-batch (paper, "Deep neural network structure")."""
    memory: int = 100_000
    """Transitions that the replay memory holds (paper, "Deep neural network structure")."""
    tau: float = 0.001
    """λ: how far the target networks follow in a step (Lillicrap et al. 2015); not in the paper."""
    theta: float = 0.15
    """θ of the exploration noise (Lillicrap et al. 2015); not in the paper."""
    sigma: float = 0.2
    """σ of the exploration noise (Lillicrap et al. 2015); not in the paper."""
    averaging: float = 5.0
    """The skill is the actor averaged over about the latest 1/5 of the updates (polynomial decay,
    Shamir and Zhang 2013); not in the paper, whose DDPG hands over the latest actor."""


class Randomness(eqx.Module):
    """The randomness of one step: what the noise is kicked by, and which memories are drawn."""

    kick: Float[Array, "*batch action"]  # standard normal
    picks: Float[Array, "*batch transitions"]


class DDPG(eqx.Module):
    """The learner's whole state: networks, their targets, their optimisers, its noise."""

    actor: Actor
    critic: Critic
    target_actor: Actor
    target_critic: Critic
    skill: Actor  # the actor averaged over its recent past: what has been learnt
    updates: Int[Array, ""]
    actor_adam: optax.OptState
    critic_adam: optax.OptState
    noise: Float[Array, " action"]


def init(key: PRNGKeyArray, observation: int, action: int, config: Config) -> DDPG:
    """An untaught learner for so many numbers seen and so many commanded."""
    for_actor, for_critic = jax.random.split(key)
    actor = Actor(observation, action, config.actor, for_actor)
    critic = Critic(observation, action, config.critic, for_critic)
    return DDPG(
        actor=actor,
        critic=critic,
        # Copies, so that the loop may donate its whole state: XLA takes no buffer twice.
        target_actor=jax.tree.map(jnp.copy, actor),
        target_critic=jax.tree.map(jnp.copy, critic),
        skill=jax.tree.map(jnp.copy, actor),
        updates=jnp.asarray(0),
        actor_adam=adam(config.actor_rate).init(actor),
        critic_adam=adam(config.critic_rate).init(critic),
        noise=jnp.zeros(action),
    )


def draw(key: PRNGKeyArray, action: int, config: Config) -> Randomness:
    """Draw the randomness of one step: normal kicks, and picks uniform in [0, 1)."""
    for_kick, for_picks = jax.random.split(key)
    return Randomness(
        kick=jax.random.normal(for_kick, (action,)),
        picks=jax.random.uniform(for_picks, (config.batch,)),
    )


def explore(
    agent: DDPG, observation: Float[Array, " seen"], config: Config, drawn: Randomness
) -> tuple[DDPG, Float[Array, " action"]]:
    """The actor's action with noise added, within [-1, 1]."""
    noise = ornstein_uhlenbeck(agent.noise, config.theta, config.sigma, drawn.kick)
    action = jnp.clip(agent.actor(observation) + noise, -1.0, 1.0)
    return eqx.tree_at(lambda a: a.noise, agent, noise), action


def episode_start(agent: DDPG, starts: Bool[Array, ""]) -> DDPG:
    """The learner, its noise at rest again where an episode starts."""
    return eqx.tree_at(lambda a: a.noise, agent, jnp.where(starts, 0.0, agent.noise))


def update(agent: DDPG, batch: Transition, config: Config) -> DDPG:
    """One gradient step on critic and actor, then the targets follow (Algorithm 1)."""
    next_action = agent.target_actor(batch.next_observation)
    next_value = agent.target_critic(batch.next_observation, next_action)
    target = batch.reward + config.discount * (1.0 - batch.terminated) * next_value

    def critic_loss(critic: Critic) -> Float[Array, ""]:
        return jnp.mean((critic(batch.observation, batch.action) - target) ** 2)

    slope = jax.grad(critic_loss)(agent.critic)
    change, critic_adam = adam(config.critic_rate).update(slope, agent.critic_adam)
    critic = eqx.apply_updates(agent.critic, change)

    # The paper prints the actor's step with a minus sign; it has to climb.
    def actor_loss(actor: Actor) -> Float[Array, ""]:
        return -jnp.mean(critic(batch.observation, actor(batch.observation)))

    slope = jax.grad(actor_loss)(agent.actor)
    change, actor_adam = adam(config.actor_rate).update(slope, agent.actor_adam)
    actor = eqx.apply_updates(agent.actor, change)

    # The latest actor wanders about the policy that it converges to; its average far less.
    share = config.averaging / (agent.updates + config.averaging)
    return DDPG(
        actor=actor,
        critic=critic,
        skill=soft_update(agent.skill, actor, share),
        updates=agent.updates + 1,
        target_actor=soft_update(agent.target_actor, actor, config.tau),
        target_critic=soft_update(agent.target_critic, critic, config.tau),
        actor_adam=actor_adam,
        critic_adam=critic_adam,
        noise=agent.noise,
    )
