"""A rule dog of our own: along an arc close around the flock, and near behind what it pushes."""

import math
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from skydog.shepherds.elfiqi import bearing, place, turn
from skydog.world import herding
from skydog.world.mission import fastest, limited
from skydog.world.params import World
from skydog.world.spread import FixedSpread
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm


class Arc(eqx.Module):
    """Flies to the points of the world's gate, but nearer ones, and around the flock to get there.

    All lengths are shares of the world's f(N), so that the dog has no metres of its own. A sheep is
    collected from `gathered` on, the one at hand first; the dog stands `driving` behind the
    flock's centre or `collecting` behind the stray. While its way there would lead it nearer than
    `clearance` past the outermost sheep, it flies along that circle, at full speed and on the
    shorter side, until it is within `aligned` radians of its point's bearing.

    The numbers were tuned on starts of El-Fiqi's six patterns (`skydog.study.patterns`); a trace
    records the world's own gate beside this dog's flight.
    """

    gathered: Scalar = 2 / 3
    driving: Scalar = 1 / 2
    collecting: Scalar = 2 / 3
    nearness: Scalar = 1.0  # see `skydog.world.params.Dog`
    clearance: Scalar = 1 / 4
    aligned: Scalar = 1 / 2

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        sheep, f = state.sheep, herding.gathered_radius(world, len(state.sheep))
        near = replace(
            world.dog,
            driving=self.driving * f / math.sqrt(len(sheep)),
            collecting=self.collecting * f,
            nearness=self.nearness,
        )
        nearer = replace(world, dog=near, spread=FixedSpread(self.gathered * f))
        subgoal, _ = herding.gate(nearer, sheep, state.dogs)
        straight = fastest(world.dog, subgoal - state.dogs)
        centre, dt = herding.gcm(sheep), world.arena.dt
        dogs, ahead = state.dogs - centre, state.dogs + dt * straight - centre
        circle = jnp.max(norm(sheep - centre)) + self.clearance * f
        off = jnp.abs(turn(bearing(ahead), bearing(subgoal - centre)))
        circles = (norm(ahead) < circle) & (off > self.aligned)
        side = jnp.sign(turn(bearing(dogs), bearing(subgoal - centre)))
        next_bearing = bearing(dogs) + side * dt * norm(straight) / circle
        radius = jnp.broadcast_to(circle, side.shape)
        around = fastest(world.dog, place(next_bearing, radius) - dogs)
        return limited(world.dog, jnp.where(circles[:, None], around, straight))
