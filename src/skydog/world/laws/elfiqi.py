"""The sheep of El-Fiqi et al. 2020: pushes that fade with distance, and cohesion of near sheep."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from skydog.world.laws.terms import Weighted
from skydog.world.neighbours import ALL_PAIRS, BLOCK
from skydog.world.state import State
from skydog.world.vectors import PerSheep, column, norm, unit


class RegulatedFlock(Weighted):
    """El-Fiqi et al. 2020 (IEEE Access 8), its "regulated" forces, as its published program has it.

    A push fades with distance d as exp(-μ d / range). Sheep group with those within
    `neighbourhood`, whether they see a dog or not, and the sum is normalised: a sheep always
    moves at its full speed, unless nothing acts on it at all. A range excludes its border.
    `noise` is here the most of each component of a random vector, uniform.

    All pairs of sheep are looked at: the time of a step grows as their number squared.
    """

    neighbourhood: PerSheep = 3.0  # R_ππ^s: sheep nearer than this pull each other, metres
    decay: PerSheep = 2.0  # μ: how fast pushes fade
    reach: PerSheep = 10.0  # R_3: the range over which a dog's push fades by exp(-μ), metres
    threat: PerSheep = 2.0  # a dog's push at distance 0: its speed as a multiple of a sheep's

    def force(self, state: State, key: PRNGKeyArray | None) -> Float[Array, "sheep 2"]:
        """The normalised sum of the terms."""
        sheep, count = state.sheep, len(state.sheep)
        pull, crowd = self._among(sheep)
        total = column(self.inertia, count) * state.force + column(self.grouping, count) * pull
        total = total + column(self.repulsion, count) * crowd
        total = total + column(self.escape, count) * self._flee(sheep, state.dogs)
        if key is not None:
            random = jax.random.uniform(key, sheep.shape, minval=-1.0)
            total = total + column(self.noise, count) * random
        return unit(total)

    def _flee(
        self, sheep: Float[Array, "sheep 2"], dogs: Float[Array, "dogs 2"]
    ) -> Float[Array, "sheep 2"]:
        """The push away from every dog within R_πβ."""
        count = len(sheep)
        away = sheep[:, None] - dogs[None, :]
        distance = norm(away)
        faded = jnp.exp(-column(self.decay, count) * distance / column(self.reach, count))
        push = jnp.where(distance < column(self.sensing, count), faded, 0.0)
        return column(self.threat, count) * jnp.sum(push[..., None] * unit(away), axis=1)

    def _among(
        self, sheep: Float[Array, "sheep 2"]
    ) -> tuple[Float[Array, "sheep 2"], Float[Array, "sheep 2"]]:
        """The pull to the centre of the near sheep, and the push away from those too near.

        The latter is a sum over n sheep, divided by √n. Sheep at one point do not push each other.
        """
        count = len(sheep)
        own = jnp.stack(
            [
                jnp.ravel(jnp.broadcast_to(column(value, count), (count, 1)))
                for value in (self.avoidance, self.neighbourhood, self.decay)
            ]
        )
        if count <= ALL_PAIRS:
            return _pairs(sheep, sheep, own)

        def block(one: tuple[Float[Array, "2"], Float[Array, "3"]]) -> tuple[Array, Array]:
            pull, crowd = _pairs(one[0][None], sheep, one[1][:, None])
            return pull[0], crowd[0]

        return jax.lax.map(block, (sheep, own.T), batch_size=BLOCK)


def _pairs(
    some: Float[Array, "some 2"], others: Float[Array, "others 2"], own: Float[Array, "3 some"]
) -> tuple[Float[Array, "some 2"], Float[Array, "some 2"]]:
    """`RegulatedFlock._among` for some of the sheep, each with its own ranges and decay."""
    avoidance, neighbourhood, decay = own
    # One coordinate at a time, the sheep along the last axis: XLA vectorises over them.
    x, y = some.T[:, None, :] - others.T[:, :, None]
    squared = x * x + y * y
    apart = squared > 0.0
    distance = jnp.sqrt(jnp.where(apart, squared, 1.0))
    near, crowded = apart & (distance < neighbourhood), apart & (distance < avoidance)
    # The direction to a mean is that of the sum, and summed as differences it is exactly zero for
    # sheep at one point.
    pull = [-jnp.sum(jnp.where(near, along, 0.0), axis=0) for along in (x, y)]
    range_ = jnp.where(avoidance > 0.0, avoidance, 1.0)
    faded = jnp.where(crowded, jnp.exp(-decay * distance / range_) / distance, 0.0)
    root = jnp.sqrt(jnp.maximum(jnp.sum(crowded, axis=0), 1))
    push = [jnp.sum(faded * along, axis=0) / root for along in (x, y)]
    return unit(jnp.stack(pull, axis=-1)), jnp.stack(push, axis=-1)
