from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from skydog.shepherds import store
from skydog.study import cases, evaluate, navigate, navigate_page
from skydog.world import obstacles

DOG = store.load("h-ddpg-4x4")


@pytest.fixture(scope="module")
def moving(unchecked):
    return navigate.moving(3)


def test_obstacles_that_stand_are_flown_as_everywhere_else(unchecked):
    world = navigate._named("gate", 3)
    starts = cases.cases(world, 2, "random", 3)
    home = starts.sheep.at[0].set(jnp.array([[1.6, 1.5], [1.1, 2.0], [1.8, 1.9]]))
    near = replace(starts, sheep=home)
    success, steps = navigate.fly(world, None, DOG, near, 60)
    flown = evaluate.fly(world, DOG, near, 60)
    done = np.asarray(flown.accomplished)
    np.testing.assert_array_equal(success, done[:, -1])
    np.testing.assert_array_equal(success, [True, False])
    np.testing.assert_array_equal(steps, np.where(success, np.argmax(done, axis=1), 60))


def test_obstacles_that_move_begin_on_the_map_and_come_back(moving):
    for world, sway in moving.values():
        period = round(float(sway.period / world.arena.dt))
        for now, apart in ((0, 0.0), (period // 4, 1.0), (period, 0.0)):
            ends = sway.at(world, jnp.asarray(now)).obstacles.ends
            wanted = world.obstacles.ends + apart * sway.reach[:, None]
            np.testing.assert_allclose(ends, wanted, atol=1e-3)


def test_no_obstacle_is_faster_than_a_sheep(moving):
    for world, sway in moving.values():
        fastest = navigate.FULL_TURN * jnp.max(jnp.abs(sway.reach)) / sway.period
        assert fastest < world.sheep.speed


def test_the_gate_that_slides_leaves_no_gap_but_the_gate(moving):
    world, sway = moving["gate that slides"]
    side = float(world.arena.size)
    line = jnp.stack([jnp.linspace(0, side, 500), jnp.full(500, side / 2)], axis=1)
    for now in (0, 150, 450):
        here = sway.at(world, jnp.asarray(now))
        free = np.asarray(obstacles.clearance(here.obstacles, line) > 0.0)
        assert 0.05 < free.mean() < 0.11  # 1 m of 12
        assert np.abs(np.diff(free)).sum() == 2


def test_a_wrong_map_differs_from_the_world_in_its_obstacles_alone(unchecked):
    for world, map_of in navigate.wrong_maps(3).values():
        assert world.obstacles is not None
        assert map_of.obstacles is not None
        assert not np.array_equal(world.obstacles.ends, map_of.obstacles.ends)
        flown = navigate.ways(world, map_of)
        assert flown["field"][0].obstacles is flown["navigate"][0].obstacles


def test_the_page_marks_who_succeeds_more_often_than_the_field(unchecked):
    yes, no = np.ones(20, bool), np.zeros(20, bool)
    steps = np.full(20, 50)
    flown = {"field": (no, steps), "navigate": (yes, steps), "straight": (no, steps)}
    rows = navigate._rows(flown)
    results = {part: {"a wall": rows} for part in navigate_page.TITLES}
    text = navigate_page.document(results, "skydog reproduce --navigate")
    assert (
        "| a wall | 0 % [0, 16], 50 ± 0 | 100 % [84, 100], 50 ± 0 ▲ | 0 % [0, 16], 50 ± 0 |" in text
    )
    worse = navigate._rows(flown | {"field": (yes, steps), "navigate": (no, steps)})
    assert navigate_page._cell(worse["navigate"]).endswith("▼")
