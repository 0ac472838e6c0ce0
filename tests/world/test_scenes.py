"""Scenes by name and from files, and the way home that leads around what stands in them."""

import json
import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from missions import gate, reset, step

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.study import cases
from skydog.world import herding, mission, obstacles, params, scenes
from skydog.world import trace as traces
from skydog.world.home import AroundHome, StraightHome
from skydog.world.options import SCENE_NAMES
from skydog.world.presets import preset
from skydog.world.scenes import Scene
from skydog.world.serialise import flatten, unflatten

pytestmark = pytest.mark.usefixtures("unchecked")

DOG = store.load("h-ddpg-4x4")
fly = jax.jit(mission.rollout, static_argnames="steps")
way_home = jax.jit(herding.way_home)
clearance = jax.jit(obstacles.clearance)
reaches = jax.jit(lambda home, places: home.reaches(places))


def rectangle(tall=False):
    """12 m × 8 m with a wall across its middle that leaves a gate, and a disc."""
    walls = (((6.0, 3.0), (6.0, 8.0), 0.1), ((9.0, 5.0), (9.0, 5.0), 0.5))
    return Scene((12.0, 8.0), walls, (7.0, 0.5, 11.5, 7.5), (1.0, 6.0), 1.5, tall)


def placed(scene, sheep=3):
    return scenes.with_home(scenes.placed(preset("paper", 12.0, sheep), scene))


def test_the_names_that_commands_know_are_those_that_there_are():
    assert tuple(scenes.SCENES) == SCENE_NAMES


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_sheep_start_in_their_box_outside_obstacles_and_with_a_way_home(name):
    world = preset("paper", sheep=10, scene=name)
    assert isinstance(world.home, AroundHome)
    sheep = cases.cases(world, 20, "random", 0, 10).sheep.reshape(-1, 2)
    least, most = np.asarray(world.start).reshape(2, 2)
    assert np.all((least <= sheep) & (sheep <= most))
    anywhere = cases.cases(world, 20, "anywhere", 0, 10).sheep.reshape(-1, 2)
    for places in (sheep, anywhere):
        assert float(clearance(world.obstacles, places).min()) >= 0.0
        assert bool(reaches(world.home, places).all())


def test_a_scene_has_room_for_the_flock_and_as_much_as_is_asked_for():
    assert preset("paper", scene="gate").arena.plain_sides == (12.0, 12.0)
    assert preset("paper", sheep=30, scene="gate").arena.plain_sides == (38.0, 38.0)
    assert preset("paper", 20.0, scene="maze").arena.plain_sides == (20.0, 20.0)
    assert preset("strombom2014", sheep=20, scene="gate").arena.size == 89.0


def test_a_gate_is_as_wide_as_the_avoidance_radius():
    world = preset("paper", scene="gate")
    assert world.obstacles is not None
    (_, left), (right, _) = np.asarray(world.obstacles.ends)[:, :, 0]
    assert right - left - 2 * float(world.obstacles.radius[0]) == pytest.approx(1.0, abs=1e-5)


def test_clutter_covers_a_quarter_of_its_ground_and_leaves_passages():
    world = preset("paper", 24.0, scene="clutter")
    assert world.obstacles is not None
    centre, radius = np.asarray(world.obstacles.ends)[:, 0], np.asarray(world.obstacles.radius)
    free = 24.0**2 - math.pi / 4 * 6.0**2 - 7.2**2  # without the goal's and the start's corners
    assert np.sum(math.pi * radius**2) / free == pytest.approx(0.25, abs=0.02)
    gap = np.linalg.norm(centre[:, None] - centre, axis=-1) - radius[:, None] - radius
    assert np.min(gap + np.eye(len(gap)) * 99) >= 0.499


# The way home around obstacles


def test_where_no_obstacle_is_near_a_flock_is_gathered_and_driven_as_in_the_open():
    far = Scene((12.0, 12.0), (((11.9, 11.9), (11.9, 11.9), 0.05),), (6.0, 6.0, 11.0, 11.0))
    world = placed(far)
    straight = replace(world, home=StraightHome())
    for seed in range(40):
        state = reset(world, jax.random.key(seed), 3, 1)
        around, open_ = (way_home(w, state.sheep) for w in (world, straight))
        np.testing.assert_allclose(around.stray_distance, open_.stray_distance, atol=1e-5)
        np.testing.assert_allclose(around.push_direction, open_.push_direction, atol=1e-4)
        assert float(around.drive_direction @ open_.drive_direction) > 0.97
        assert float(around.distance_home) == pytest.approx(float(open_.distance_home), rel=0.04)
        assert bool(gate(world, state.sheep, state.dogs)[1][0]) == bool(
            gate(straight, state.sheep, state.dogs)[1][0]
        )


def test_sheep_that_a_wall_divides_are_pushed_one_by_one_along_their_own_ways():
    world = placed(replace(rectangle(), walls=(((6.0, 2.0), (6.0, 8.0), 0.1),)))
    sheep = jnp.asarray([[7.0, 6.0], [7.0, 6.2], [5.0, 6.0], [5.0, 6.1], [5.0, 5.9]], jnp.float32)
    way = way_home(world, sheep)
    assert int(jnp.argmax(way.stray_distance)) in (0, 1)
    assert float(way.push_direction[0, 1]) < -0.7  # down to the gap, not through the wall


def test_a_flock_comes_back_for_a_sheep_that_a_wall_keeps_from_it():
    # A floor with a tip that points up at its left end, as in the maze.
    walls = (((4.0, 4.0), (12.0, 4.0), 0.1), ((4.0, 4.0), (4.0, 6.0), 0.1))
    world = placed(Scene((12.0, 12.0), walls, (5.0, 6.0, 11.0, 11.0), (1.0, 1.0), 1.0), sheep=4)
    flock = [[4.3, 1.5], [4.7, 1.5], [4.5, 1.8]]
    behind, beside = (jnp.asarray([*flock, one], jnp.float32) for one in ([4.5, 4.4], [4.5, 3.0]))
    back, home = (way_home(world, sheep) for sheep in (behind, beside))
    assert float(back.drive_direction[1]) > 0.7
    assert float(home.drive_direction[0]) < -0.7
    assert float(back.stray_distance[3]) == 0.0
    assert float(gate(world, behind, behind[:1])[1][0]) == 1.0


def test_a_flock_comes_home_through_a_gate():
    world = preset("paper", scene="gate")
    start = cases.cases(world, 4, "random", 7).sheep[1]
    begin = mission.start(start, jnp.asarray([[6.0, 3.0]]))
    assert bool(fly(world, DOG, begin, 900).accomplished[-1])


def test_a_goal_that_moves_takes_its_way_home_along():
    world = preset("paper", scene="gate", goal=(12.0, 12.0))
    distance, _ = world.home.field.at(jnp.asarray([[1.0, 1.0]]))
    assert 15.0 < float(distance[0]) < 16.5  # by the gate, √2 · 11 m and a little
    moved = replace(world, arena=replace(world.arena, goal_x=0.0, goal_y=0.0))
    again = scenes.renewed(moved).home.field.at(jnp.asarray([[1.0, 1.0]]))[0]
    assert float(again[0]) < 2.0
    bare = replace(moved, home=StraightHome())
    assert scenes.renewed(bare) is bare


# Rectangles


def test_in_a_rectangle_everybody_starts_and_stays_within_its_sides():
    world = placed(rectangle(), sheep=5)
    drawn = cases.cases(world, 20, "anywhere", 1, 5, 2)
    for who in (drawn.sheep, drawn.dogs):
        assert np.all((np.asarray(who) >= 0) & (np.asarray(who) <= (12.0, 8.0)))
        assert np.asarray(who)[..., 0].max() > 8.5
    begin = mission.start(jnp.asarray([[11.9, 7.9]]), jnp.asarray([[11.0, 7.0]]))
    for _ in range(12):
        begin = step(world, begin, jnp.asarray([[0.5, 0.5]]))
        assert np.all(np.asarray(begin.sheep) <= (12.0, 8.0))
    assert np.max(np.asarray(begin.sheep)) == 12.0
    beyond = float(world.dog.airspace)
    assert np.all(np.asarray(begin.dogs) <= np.array([12.0, 8.0]) + beyond + 1e-5)


def test_the_scale_of_a_rectangle_is_that_of_the_square_with_the_same_diagonal():
    arena = placed(rectangle()).arena
    assert float(arena.scale) == pytest.approx(math.sqrt((144 + 64) / 2))
    square = replace(arena, height=arena.size)
    assert float(square.scale) == pytest.approx(float(arena.size))
    assert preset("paper", 4.0).arena.scale == 4.0


def test_a_sheepdog_herds_in_a_rectangle():
    world = placed(rectangle())
    assert bool(fly(world, DOG, mission.reset(world, jax.random.key(3)), 900).accomplished[-1])


# Traces and files of worlds


@pytest.mark.parametrize("tall", [False, True])
def test_a_world_with_a_scene_round_trips_through_a_file(tall):
    world = params.traced(placed(rectangle(tall)))
    plain = json.loads(json.dumps(flatten(world), allow_nan=False))
    again = params.traced(unflatten(plain))
    assert jax.tree.structure(again) == jax.tree.structure(world)
    for old, new in zip(jax.tree.leaves(world), jax.tree.leaves(again), strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-6)


def test_a_trace_with_a_scene_round_trips(tmp_path):
    world = placed(rectangle())
    trace = fly(world, DOG, mission.reset(world, jax.random.key(3)), 900)
    traces.save(tmp_path / "one.safetensors", trace, "dog")
    again, _ = traces.load(tmp_path / "one.safetensors")
    np.testing.assert_array_equal(again.sheep, trace.sheep[: len(again.sheep)])
    assert again.world.obstacles is not None
    assert world.obstacles is not None
    np.testing.assert_array_equal(again.world.obstacles.ends, world.obstacles.ends)
    assert isinstance(again.world.home, AroundHome)


def test_a_world_from_before_there_were_scenes_is_an_open_square():
    values = flatten(preset("paper"))
    assert not [name for name in values if "obstacles" in name or "height" in name]
    world = unflatten(values)
    assert (world.obstacles, world.start, world.arena.height) == (None, None, None)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("obstacles.ends", [1.0]),
        ("obstacles.ends", None),
        ("obstacles.radius", [0.1, -0.1]),
        ("obstacles.radius", [0.1, 0.0]),
        ("obstacles.radius", [0.1, math.inf]),
        ("obstacles.radius", ["0.1", 0.1]),
        ("obstacles.radius", [0.1] * 10_001),
        ("obstacles.tall", 1),
        ("start", [0.0, 1.0]),
        ("arena.height", 0.0),
        ("arena.height", "8"),
    ],
    ids=lambda value: str(value)[:24],
)
def test_a_scene_of_the_wrong_kind_in_a_file_is_refused(name, value):
    values = {**flatten(placed(rectangle())), name: value}
    with pytest.raises(Refusal, match=r"world parameter|no radii"):
        unflatten(values)


# What cannot be


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"scene": "labyrinth"}, "no scene is called 'labyrinth'; choose from gate, corridor"),
        ({"scene": ""}, "no scene is called ''; choose from"),
        ({"scene": "gate", "arena": 1.0}, "arena must be longer than 2 m"),
        ({"scene": "gate", "goal": (13.0, 1.0)}, "the goal lies in the arena"),
        ({"scene": "nowhere.toml"}, "nowhere.toml"),
        ({"scene": "nowhere.svg"}, r"ends in .toml or .geojson"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_a_scene_that_cannot_be_is_refused(asked, said):
    with pytest.raises(Refusal, match=said):
        preset("paper", **asked)


def test_a_start_without_a_way_home_is_refused():
    closed = replace(rectangle(), walls=(((6.0, 0.0), (6.0, 8.0), 0.1),))
    with pytest.raises(Refusal, match=r"no way home from where the sheep start; leave passages"):
        placed(closed)


def test_starts_that_lie_within_obstacles_are_refused():
    three = replace(rectangle(), walls=(((8.6, 5.7), (8.6, 5.7), 2.0),))
    world = placed(three)
    for draw in (lambda: cases.cases(world, 2, "paper"), lambda: cases.shipped(world, "random")):
        with pytest.raises(Refusal, match="within obstacles; try --starts random"):
            draw()
    assert len(cases.cases(preset("paper", scene="gate"), 2, "paper").sheep) == 2


@pytest.mark.parametrize("odd", ["obstacles", "arenas that are not square", "a way home around"])
def test_what_has_no_place_for_a_scene_says_so(odd):
    world = placed(rectangle())
    if odd != "obstacles":
        world = replace(world, obstacles=None)
    if odd == "a way home around":
        world = replace(world, arena=replace(world.arena, height=None))
    with pytest.raises(Refusal, match=f"the twin has no {odd}"):
        scenes.check_open(world, "the twin")
    assert scenes.check_open(preset("paper"), "the twin") == preset("paper")
