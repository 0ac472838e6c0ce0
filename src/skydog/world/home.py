"""Which way is home: by default the straight line to the goal, or the way around obstacles."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from skydog.world import herding, obstacles
from skydog.world.field import Field
from skydog.world.params import Way, World
from skydog.world.vectors import norm, unit


class StraightHome(eqx.Module):
    """Straight to the goal. A sheep strays by its distance to the GCM, and is pushed towards it.

    Strömbom et al. 2014; paper, "Problem Formulation".
    """

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        centre = herding.gcm(sheep)
        from_goal, from_centre = centre - herding.goal(world.arena), sheep - centre
        return Way(
            drive_direction=-unit(from_goal),
            distance_home=norm(from_goal),
            stray_distance=norm(from_centre),
            push_direction=-unit(from_centre),
        )


# A flock that is divided is driven as one body only if the way home of each of its sheep makes at
# most this angle with their mean: cos 45°, rounded (ours).
ONE_WAY = 0.7
# Else its rearmost are pushed: those at most this share of f(N) before the last (ours).
REAR = 0.3
# A dog that pushes one along its own way stands this share of f(N) behind it, if that is more than
# `dog.collecting`: a learnt skill holds its point the less exactly, the larger the arena (ours).
BEHIND = 1 / 3
# The pull to the flock is stronger than a dog's push. A sheep behind an obstacle whose way leads
# away from the flock, by an angle of more than 135° with the pull (its cosine, rounded), cannot be
# pushed along it (ours).
AGAINST = 0.7
# The flock comes back for it. Its way is searched for a place in sight of the flock in so many
# strides of so many cells of the field (ours).
STRIDES, STRIDE = 24, 4.0


class AroundHome(eqx.Module):
    """Around obstacles: the shortest way of each sheep, from a field over the arena (ours).

    See `around`. A sheep that is left behind an obstacle, so that its way leads it from the flock,
    is no stray. The flock is driven back instead, to the first place on the way of that sheep
    that is in sight of the flock's centre.
    """

    field: Field

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        centre = herding.gcm(sheep)
        distance, direction = self.field.at(jnp.concatenate([sheep, centre[None]]))
        if world.obstacles is None:
            return around(world, sheep, distance, direction)
        leads_off = jnp.sum(direction[:-1] * unit(sheep - centre), axis=1) > AGAINST
        left = leads_off & ~_in_sight(world, sheep, centre) & (distance[:-1] > distance[-1])
        last = jnp.argmax(jnp.where(left, distance[:-1], 0.0))
        back, found = self._back(world, sheep[last], centre)
        left &= found
        way = around(world, sheep, distance, direction, left)
        return replace(
            way,
            drive_direction=jnp.where(jnp.any(left), back, way.drive_direction),
            stray_distance=jnp.where(left, 0.0, way.stray_distance),
        )

    def _back(
        self, world: World, sheep: Float[Array, "2"], centre: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
        """The direction in which the flock comes back for a sheep, and whether there is one."""

        def on(place: Float[Array, "1 2"], _: None) -> tuple[Float[Array, "1 2"], Array]:
            place = place + STRIDE * self.field.cell * self.field.at(place)[1]
            return place, place[0]

        _, ahead = jax.lax.scan(on, sheep[None], None, length=STRIDES)
        seen = _in_sight(world, ahead, centre)
        return unit(ahead[jnp.argmax(seen)] - centre), jnp.any(seen)

    def reaches(self, places: Float[Array, "some 2"]) -> Bool[Array, " some"]:
        """Whether there is a way home from each place."""
        return self.field.reaches(places)


class Given(eqx.Module):
    """A way that is known already, such as the one that a shepherd has found for itself."""

    found: Way

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """The way that was found, whatever the world and its sheep."""
        del world, sheep
        return self.found


def around(
    world: World,
    sheep: Float[Array, "sheep 2"],
    distance: Float[Array, " places"],
    direction: Float[Array, "places 2"],
    left: Bool[Array, " sheep"] | bool = False,
) -> Way:
    """The way around obstacles, from how far home is and whither: of each sheep, then of the GCM.

    While all sheep are in sight of their centre, they are gathered as in the open, and then driven
    along the centre's way home. A flock that an obstacle divides is pushed sheep by sheep, each
    along its own way: a sheep strays by how much further its way is than that of the foremost,
    and the rearmost count as strays even if that is less than f(N). Whoever is `left` behind does
    not divide it.
    """
    centre, own = herding.gcm(sheep), direction[:-1]
    behind = distance[:-1] - jnp.min(distance[:-1])
    gathered = herding.gathered_radius(world, len(sheep))
    together = jnp.max(norm(sheep - centre)) <= gathered
    together &= jnp.min(own @ unit(jnp.mean(own, axis=0))) >= ONE_WAY
    lag = jnp.maximum((1.0 + REAR) * gathered - jnp.max(behind), 0.0)
    stray = behind + jnp.where(together, 0.0, lag)
    push = jnp.maximum(BEHIND * gathered / world.dog.collecting, 1.0) * own
    if world.obstacles is not None:
        whole = jnp.all(left | _in_sight(world, sheep, centre))
        stray = jnp.where(whole, norm(sheep - centre), stray)
        push = jnp.where(whole, -unit(sheep - centre), push)
    return Way(
        drive_direction=direction[-1],
        distance_home=distance[-1],
        stray_distance=stray,
        push_direction=push,
    )


def _in_sight(
    world: World, places: Float[Array, "some 2"], centre: Float[Array, "2"]
) -> Bool[Array, " some"]:
    assert world.obstacles is not None
    return ~obstacles.passed(world.obstacles, places, jnp.broadcast_to(centre, places.shape))
