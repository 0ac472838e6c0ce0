"""How bodies with physics respond to commands, for the kinematic world. Drawn for each episode.

A dog reaches its commanded velocity late, and drifts; a rover moves only a share of what its force
asks for. The ranges of lag and delay bracket what was measured in the twin (docs/twin.md), so that
a skill which was trained with all of them works for several drones.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.params import World
from skydog.world.vectors import Scalar

LAG = (0.05, 0.8)  # s: the time constant of a dog's velocity
DELAY = (0.0, 0.15)  # s: of a command, at most a step
DRIFT = 0.1  # share of the dog's speed, on each axis, at most
SHEEP_SHARE = (0.6, 1.0)  # of its speed that a rover makes, which turns as its force does; ours


class Body(eqx.Module):
    """How the bodies of an episode obey, and what the dog flies by now."""

    lag: Float[Array, ""]  # s
    delay: Float[Array, ""]  # s
    drift: Float[Array, "2"]  # shares of the dog's speed
    sheep_share: Float[Array, ""]
    velocity: Float[Array, "2"]  # m/s
    command: Float[Array, "2"]  # m/s, of the step before


def draw(key: PRNGKeyArray) -> Body:
    """Bodies for an episode, the dog at rest."""
    for_lag, for_delay, for_drift, for_sheep = jax.random.split(key, 4)
    return Body(
        lag=jax.random.uniform(for_lag, minval=LAG[0], maxval=LAG[1]),
        delay=jax.random.uniform(for_delay, minval=DELAY[0], maxval=DELAY[1]),
        drift=jax.random.uniform(for_drift, (2,), minval=-DRIFT, maxval=DRIFT),
        sheep_share=jax.random.uniform(for_sheep, minval=SHEEP_SHARE[0], maxval=SHEEP_SHARE[1]),
        velocity=jnp.zeros(2),
        command=jnp.zeros(2),
    )


def obey(
    body: Body, command: Float[Array, "2"], speed: Scalar, dt: Scalar
) -> tuple[Body, Float[Array, "2"]]:
    """The body after a step, and the mean velocity in m/s that the dog flew in it.

    The velocity follows the command by a first-order lag, exactly; the command before still stands
    for the time of the delay.
    """
    late = jnp.clip(body.delay / dt, 0.0, 1.0)
    wanted = late * body.command + (1.0 - late) * command + speed * body.drift
    kept = jnp.exp(-dt / body.lag)
    behind = body.velocity - wanted
    flown = wanted + behind * body.lag / dt * (1.0 - kept)
    after = eqx.tree_at(lambda b: (b.velocity, b.command), body, (wanted + kept * behind, command))
    return after, flown


def slowed(world: World, body: Body) -> World:
    """The world in which sheep make only the body's share of their speed."""
    return eqx.tree_at(lambda w: w.sheep.speed, world, world.sheep.speed * body.sheep_share)
