"""Which way is home: by default the straight line to the goal, or the way around obstacles."""

import equinox as eqx
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


class AroundHome(eqx.Module):
    """Around obstacles: the shortest way of each sheep, from a field over the arena (ours).

    See `around`.
    """

    field: Field

    def way(self, world: World, sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        places = jnp.concatenate([sheep, herding.gcm(sheep)[None]])
        return around(world, sheep, *self.field.at(places))

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
) -> Way:
    """The way around obstacles, from how far home is and whither: of each sheep, then of the GCM.

    While all sheep are in sight of their centre, they are gathered as in the open, and then driven
    along the centre's way home. A flock that an obstacle divides is pushed sheep by sheep, each
    along its own way: a sheep strays by how much further its way is than that of the foremost,
    and the rearmost count as strays even if that is less than f(N).
    """
    centre, own = herding.gcm(sheep), direction[:-1]
    behind = distance[:-1] - jnp.min(distance[:-1])
    gathered = herding.gathered_radius(world, len(sheep))
    together = jnp.max(norm(sheep - centre)) <= gathered
    together &= jnp.min(own @ unit(jnp.mean(own, axis=0))) >= ONE_WAY
    lag = jnp.maximum((1.0 + REAR) * gathered - jnp.max(behind), 0.0)
    stray, push = behind + jnp.where(together, 0.0, lag), own
    if world.obstacles is not None:
        middle = jnp.broadcast_to(centre, sheep.shape)
        seen = ~jnp.any(obstacles.passed(world.obstacles, sheep, middle))
        stray = jnp.where(seen, norm(sheep - centre), stray)
        push = jnp.where(seen, -unit(sheep - centre), push)
    return Way(
        drive_direction=direction[-1],
        distance_home=distance[-1],
        stray_distance=stray,
        push_direction=push,
    )
