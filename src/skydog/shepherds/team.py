"""A team of dogs: each takes a sector of the flock, and all of them fly by the same numbers."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from skydog.shepherds.elfiqi import bearing, place, turn
from skydog.shepherds.sheepdog import Sheepdog
from skydog.world import herding
from skydog.world.mission import fastest, limited
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.vectors import Scalar, norm, unit

AHEAD = 0.3  # radians that the next point on the way around the flock lies ahead


class Team(eqx.Module):
    """Any number of dogs that need no message but each other's positions.

    Seen from the flock's centre, the dogs stand side by side behind it, in the order in which they
    are around it: each has a sector. In a scattered flock a dog collects the stray of its sector,
    and pushes it partly towards the centre and partly home; a gathered flock is driven by all
    dogs together, each from behind the rim of its sector. The dog with the shortest way to the back
    leads. The others go around the flock at a distance while they are on its goal's side, so that
    they do not push it away from home. Dogs of one place in the order may change places; nothing
    else depends on which dog is which.

    `skill` flies to the points: a trained sheepdog's collect and drive, or None to fly straight and
    at full speed. Lengths are shares of the world's f(N). The numbers are ours, found by
    `benchmarks/team.py`.
    """

    skill: Sheepdog | None = None
    spacing: Scalar = 0.15  # radians between the sectors of two dogs
    narrow: Scalar = 1.7  # how much less a sheep counts half a turn away from a dog's sector
    near: Scalar = 0.15  # how much less it counts for each metre between it and the dog
    gathered: Scalar = 1.35  # the flock is driven while no sheep is further than this out
    inward: Scalar = 0.3  # of the push on a stray: 1 is towards the centre, 0 is home
    behind: Scalar = 0.9  # how far behind its stray, or the rim, a dog stands
    seen: Scalar = 0.5  # but no further than this share of the distance at which sheep see it
    clearance: Scalar = 0.06  # how far outside the flock a dog goes around it
    shy: Scalar = 5.3  # the same, of a dog that does not lead, on the goal's side
    aligned: Scalar = 1.1  # radians from its point's bearing within which a dog flies straight
    apart: Scalar = 1.0  # avoidance lengths (`Dog.collecting`): dogs come no nearer to each other

    def __call__(self, world: World, state: State) -> Float[Array, "dogs 2"]:
        """Velocities of the dogs, in m/s."""
        subgoal, drives, lead = self.subgoals(world, state)
        point = self._around(world, state, subgoal, lead)
        if self.skill is None:
            velocity = fastest(world.dog, point - state.dogs)
        else:
            velocity = self.skill.steer(world, state, point, drives)
        return separated(world, state.dogs, velocity, self.apart * world.dog.collecting)

    def subgoals(
        self, world: World, state: State
    ) -> tuple[Float[Array, "dogs 2"], Bool[Array, " dogs"], Int[Array, ""]]:
        """Where each dog is to be, in metres, whether it drives, and which of them leads."""
        sheep, dogs, count = state.sheep, state.dogs, len(state.dogs)
        f, centre = herding.gathered_radius(world, len(sheep)), herding.gcm(sheep)
        way = herding.way_home(world, sheep)
        back = -way.drive_direction
        aside = jnp.stack([-back[1], back[0]])
        axes = jnp.stack([back, aside], axis=1)
        around, outward = bearing((dogs - centre) @ axes), sheep - centre
        order = jnp.argsort(jnp.argsort(around))
        sector = self.spacing * (order - (count - 1) / 2)
        out = norm(outward)
        off = jnp.abs(turn(sector[:, None], bearing(outward @ axes)[None, :]))
        counts = out * (1.0 - self.narrow * off / math.pi)
        counts = counts - self.near * norm(dogs[:, None] - sheep[None, :])
        stray = jnp.argmax(counts, axis=1)
        home = jnp.broadcast_to(back, (count, 2))
        push = unit(self.inward * unit(outward[stray]) + (1.0 - self.inward) * home)
        # Where f(N) is longer than they see, a dog that stood behind it would stand there for ever.
        behind = jnp.minimum(self.behind * f, self.seen * herding.sensing(world))
        collecting = sheep[stray] + behind * push
        sight = jnp.cos(sector)[:, None] * back + jnp.sin(sector)[:, None] * aside
        rim = jnp.max(outward @ sight.T, axis=0)
        driving = centre + (rim + behind)[:, None] * sight
        drives = jnp.broadcast_to(jnp.max(out) <= self.gathered * f, count)
        subgoal = jnp.where(drives[:, None], driving, collecting)
        lead = jnp.argmin(jnp.abs(around) * norm(dogs - centre))
        return herding.within_airspace(world, subgoal), drives, lead

    def _around(
        self, world: World, state: State, subgoal: Float[Array, "dogs 2"], lead: Int[Array, ""]
    ) -> Float[Array, "dogs 2"]:
        """Where each dog flies next: its subgoal, or a point of its way around the flock."""
        centre, f = herding.gcm(state.sheep), herding.gathered_radius(world, len(state.sheep))
        dogs, goal = state.dogs - centre, subgoal - centre
        towards = herding.goal(world.arena) - centre
        before = jnp.abs(turn(bearing(dogs), bearing(towards))) < math.pi / 2
        late = before & (jnp.arange(len(dogs)) != lead)
        out = jnp.max(norm(state.sheep - centre))
        circle = out + jnp.where(late, self.shy, self.clearance) * f
        stride = world.arena.dt * fastest(world.dog, goal - dogs)
        off = jnp.abs(turn(bearing(dogs + stride), bearing(goal)))
        circles = (norm(dogs + stride) < circle) & (off > self.aligned)
        left = turn(bearing(dogs), bearing(goal))
        after = bearing(dogs) + jnp.clip(left, -AHEAD, AHEAD)
        return jnp.where(circles[:, None], centre + place(after, circle), subgoal)


def separated(
    world: World, dogs: Float[Array, "dogs 2"], velocity: Float[Array, "dogs 2"], apart: Scalar
) -> Float[Array, "dogs 2"]:
    """The velocities in m/s, slowed so that no two dogs come nearer than `apart` metres.

    Each of two dogs may use half of the room between them in a step. What is left of a velocity
    that would use more is what leads along the other; it is then shortened, if need be. Dogs that
    are too near already do not come nearer. Without noise in their flight that holds always.
    """
    velocity = limited(world.dog, velocity)
    if len(dogs) == 1:
        return velocity
    between = dogs[None, :] - dogs[:, None]
    itself = jnp.eye(len(dogs), dtype=bool)
    toward = unit(between)
    room = jnp.maximum(norm(between) - apart, 0.0) / (2.0 * world.arena.dt)
    room = jnp.where(itself, jnp.inf, room)
    # One after the other: the nearest last, whose room is the least.
    for _ in range(2):
        closing = jnp.sum(velocity[:, None] * toward, axis=-1)
        excess = jnp.where(itself, 0.0, jnp.maximum(closing - room, 0.0))
        worst = jnp.argmax(excess, axis=1)[:, None]
        along = jnp.take_along_axis(toward, worst[..., None], axis=1)[:, 0]
        velocity = velocity - jnp.take_along_axis(excess, worst, axis=1) * along
    # Where the airspace ends they cannot go on: that may turn them towards each other.
    there = herding.within_airspace(world, dogs + world.arena.dt * velocity)
    velocity = (there - dogs) / world.arena.dt
    closing = jnp.sum(velocity[:, None] * toward, axis=-1)
    share = jnp.where(closing > room, room / jnp.where(closing > room, closing, 1.0), 1.0)
    return limited(world.dog, velocity * jnp.min(share, axis=1, keepdims=True))
