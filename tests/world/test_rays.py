import jax.numpy as jnp
import numpy as np
import pytest

from skydog.world import rays as sights
from skydog.world.obstacles import Obstacles

WALL = Obstacles(jnp.array([[[0.0, 6.0], [10.0, 6.0]]]), jnp.array([0.5]))
EAST, NORTH, WEST = (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)


def seen(walls, place, rays, far=4.0):
    return np.asarray(sights.free(walls, 10.0, jnp.array(place), jnp.array(rays), far))


@pytest.mark.parametrize(
    ("place", "ray", "metres"),
    [
        ((5.0, 4.0), NORTH, 1.5),  # to the rim of the wall, not to its middle
        ((5.0, 4.0), EAST, 4.0),  # no further than the sight
        ((9.0, 4.0), EAST, 1.0),  # to the arena's own wall
        ((0.5, 4.0), WEST, 0.5),
        ((0.0, 4.0), WEST, 0.0),
        ((5.0, 6.0), NORTH, 0.0),  # from within an obstacle nothing is free
    ],
)
def test_a_ray_ends_where_the_first_obstacle_begins(place, ray, metres):
    np.testing.assert_allclose(seen(WALL, place, [ray]), [metres], atol=1e-3)


def test_a_ray_ends_at_a_disc_as_geometry_has_it():
    disc = Obstacles(jnp.array([[[6.0, 5.0], [6.0, 5.0]]]), jnp.array([1.0]))
    angles = np.array([0.0, 0.1, 0.2])
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    along = 3.0 * np.cos(angles)
    wanted = along - np.sqrt(1.0 - (3.0 * np.sin(angles)) ** 2)
    np.testing.assert_allclose(seen(disc, (3.0, 5.0), rays), wanted, atol=2e-3)


def test_in_an_arena_without_obstacles_only_its_walls_are_seen():
    none = Obstacles(jnp.zeros((0, 2, 2)), jnp.zeros(0))
    np.testing.assert_allclose(seen(none, (5.0, 9.0), [NORTH, EAST]), [1.0, 4.0])
