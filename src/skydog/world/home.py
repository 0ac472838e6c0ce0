"""Which way is home: by default the straight line to the goal."""

import equinox as eqx
from jaxtyping import Array, Float

from skydog.world import herding
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
