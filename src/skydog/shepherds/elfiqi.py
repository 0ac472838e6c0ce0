"""The rule dog of El-Fiqi et al. 2020: it flies around the flock to its point, not through it."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.errors import Refusal
from skydog.world import herding
from skydog.world.mission import fastest, limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm

TURN = 0.1  # theta_step, radians: how far along the circle a dog goes in a step
ALIGNED = 2 * TURN  # radians: a dog that is as near to its point's bearing leaves the circle


class ElFiqi(eqx.Module):
    """El-Fiqi et al. 2020 (IEEE Access 8), with its circular path and without stalling.

    A dog flies straight to its subgoal, always at full speed. Where that would take it too near
    to a flock that it should not disturb yet, it flies along a circle around the flock's centre
    until it has the bearing of its subgoal. The circle is R_2 + R_3 wider than the flock: R_2 is
    the world's `dog.collecting`, and R_3 is `reach` in metres, how far a dog disturbs sheep. If
    None, it is the `reach` of the world's flock, or else its `sensing`.

    Their program lets a dog fly faster than its speed on the circle, and does not see that
    bearings of -π and π are the same; this one keeps the world's limits, and does.
    """

    reach: Scalar | None = None

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        subgoal, _ = herding.gate(world, state.sheep, state.dogs)
        straight = fastest(world.dog, subgoal - state.dogs)
        centre, dt = herding.gcm(state.sheep), world.arena.dt
        dogs, ahead = state.dogs - centre, state.dogs + dt * straight - centre
        flock = jnp.maximum(
            jnp.max(norm(state.sheep - centre)),
            herding.gathered_radius(world, len(state.sheep)),
        )
        clear = flock + world.dog.collecting + self._reach(world)
        off = jnp.abs(turn(bearing(ahead), bearing(subgoal - centre)))
        circles = (norm(ahead) < clear) & (off > ALIGNED)
        # Whole steps of TURN, until the dog has turned as far as it would have flying straight.
        turned = turn(bearing(dogs), bearing(ahead))
        turned = jnp.sign(turned) * TURN * jnp.ceil(jnp.abs(turned) / TURN)
        radius = jnp.minimum(clear, norm(dogs) + dt * norm(straight))
        around = (place(bearing(dogs) + turned, radius) - dogs) / dt
        return limited(world.dog, jnp.where(circles[:, None], around, straight))

    def _reach(self, world: World) -> Scalar:
        if self.reach is not None:
            return self.reach
        for name in ("reach", "sensing"):
            if (known := getattr(world.flock, name, None)) is not None:
                return jnp.max(jnp.asarray(known))
        raise Refusal(
            f"the flock's law ({type(world.flock).__name__}) does not say how far a dog disturbs "
            "its sheep; try ElFiqi(reach=2.0)"
        )


def bearing(places: Float[Array, "*some 2"]) -> Float[Array, "*some"]:
    """The angle of each place seen from the origin, in radians."""
    return jnp.arctan2(places[..., 1], places[..., 0])


def place(bearings: Float[Array, " dogs"], radius: Float[Array, " dogs"]) -> Float[Array, "dogs 2"]:
    """The places of these bearings, in radians, that are `radius` metres from the origin."""
    return radius[:, None] * jnp.stack([jnp.cos(bearings), jnp.sin(bearings)], axis=-1)


def turn(start: Float[Array, "*some"], end: Float[Array, "*others"]) -> Float[Array, "*both"]:
    """The shorter turn from one bearing to another, in radians, -π to π."""
    return (end - start + math.pi) % (2 * math.pi) - math.pi
