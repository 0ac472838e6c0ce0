"""Obstacles and arenas that are not square, in figures, films, replays and the live view."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from browser import opened, pixels, until
from matplotlib.patches import Polygon
from serving import serving
from test_animation import shows

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.view import animation, figures, ground, messages, replay
from skydog.view.session import Settings, advance, new, update, view
from skydog.world import mission, obstacles, scenefile
from skydog.world.home import AroundHome
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

SHEPHERDS = {"strombom": Strombom()}
SCENE = """
size = [9, 5]
start = [5.5, 0.5, 8.5, 4.5]
goal = [1, 4]
goal_radius = 1.0
walls = [[[5, 0], [5, 3]]]
discs = [[2.5, 1.5, 1.0]]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "pen.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def trace(unchecked, file):
    world = preset("paper", scene=file)
    begin = mission.reset(world, jax.random.key(2))
    return jax.jit(mission.rollout, static_argnums=3)(world, Strombom(), begin, 30)


def test_a_figure_shows_every_obstacle_in_its_place(trace):
    (axes,) = figures.trajectories({"pen": trace}).axes
    solid = [patch for patch in axes.patches if type(patch) is Polygon]
    boxes = [patch.get_path().get_extents().extents for patch in solid]
    wall, disc = sorted(boxes, key=lambda box: -box[0])
    np.testing.assert_allclose(wall, (4.9, -0.1, 5.1, 3.1), atol=5e-3)
    np.testing.assert_allclose(disc, (1.5, 0.5, 3.5, 2.5), atol=1e-2)
    low, high = axes.get_xlim()
    assert low < 0.0
    assert high > 9.0


def test_the_outline_of_an_obstacle_lies_on_its_rim(trace):
    for obstacle in ground.obstacles(trace.world):
        rim = jnp.asarray(ground.outline(obstacle), jnp.float32)
        gap = np.asarray(obstacles.away(trace.world.obstacles, rim)[0])
        assert np.abs(gap).min(axis=1).max() < 1e-3


def test_a_film_shows_obstacles(trace):
    draw = animation.stage(trace.world, 3, 1)
    picture = draw(trace.sheep[:1], trace.dogs[:1], trace.subgoal[0], trace.drives[0], "pen", 0)
    bare = animation.stage(dataclasses.replace(trace.world, obstacles=None), 3, 1)
    other = bare(trace.sheep[:1], trace.dogs[:1], trace.subgoal[0], trace.drives[0], "pen", 0)
    assert shows(picture, "arena")
    assert (picture != other).any(axis=-1).sum() > 2000  # a disc of 1 m in 480 pixels


def test_a_replay_shows_obstacles_in_a_browser(trace, tmp_path, browser):
    bare = dataclasses.replace(trace, world=dataclasses.replace(trace.world, obstacles=None))
    pictures = []
    for name, shown in (("walls", trace), ("bare", bare)):
        replay.save(tmp_path / f"{name}.html", {"pen": shown})
        with opened(browser, (tmp_path / f"{name}.html").as_uri()) as page:
            until(page, "document.querySelector('canvas')?.width > 300")
            pictures.append(pixels(page, "canvas"))
    assert pictures[0].shape == pictures[1].shape
    assert (pictures[0] != pictures[1]).any(axis=-1).sum() > 2000


# The live view


def begun(**chosen):
    return advance(new(Settings("strombom", **chosen)), SHEPHERDS, 0)


def test_a_session_shows_the_scene_that_is_chosen_and_the_open_again():
    session = begun()
    assert view(session)["world"]["obstacles"] == []
    session = advance(update(session, {"scene": "gate"}), SHEPHERDS, 3)
    shown = view(session)["world"]
    assert (shown["size"], shown["height"], len(shown["obstacles"])) == (12.0, 12.0, 2)
    assert isinstance(session.world.home, AroundHome)
    session = advance(update(session, {"scene": None}), SHEPHERDS, 0)
    assert view(session)["world"]["obstacles"] == []
    assert view(session)["world"]["size"] == 4.0


def test_a_goal_that_is_dragged_in_a_scene_takes_its_way_home_along(file):
    session = begun(scene=str(file))
    assert (view(session)["world"]["size"], view(session)["world"]["height"]) == (9.0, 5.0)
    session = advance(update(session, {"hold": ("goal", 0, (99.0, 99.0))}), SHEPHERDS, 1)
    assert view(session)["world"]["goal"] == [9.0, 5.0]
    distance, direction = session.world.home.field.at(jnp.asarray([[4.0, 1.0]]))
    assert float(distance[0]) > 5.5  # above the wall, not through it
    assert float(direction[0, 1]) > 0.5
    again = advance(update(session, {"reset": True}), SHEPHERDS, 0)
    assert view(again)["world"]["goal"] == [9.0, 5.0]


def test_a_goal_is_not_dragged_into_an_obstacle_that_is_larger(tmp_path):
    path = tmp_path / "rock.toml"
    path.write_text(
        SCENE.replace("1.5, 1.0]]", "1.5, 1.4]]").replace("radius = 1.0", "radius = 0.3")
    )
    session = begun(scene=str(path))
    with pytest.raises(Refusal, match=r"the goal at 2.5,1.5 lies within an obstacle; move it"):
        update(session, {"hold": ("goal", 0, (2.5, 1.5))})


def test_a_sheep_that_is_dragged_into_an_obstacle_stands_at_its_rim(file):
    session = advance(
        update(begun(scene=str(file)), {"hold": ("sheep", 0, (2.6, 1.5))}), SHEPHERDS, 2
    )
    place = session.flights[0].state.sheep[:1]
    assert session.world.obstacles is not None
    assert 0.0 <= float(obstacles.clearance(session.world.obstacles, place)[0]) < 0.01
    free = advance(update(session, {"hold": None}), SHEPHERDS, 0)
    assert free.held is None


@pytest.mark.parametrize("scene", ["labyrinth", 3, ["gate"], "../pen.toml"])
def test_a_page_can_choose_no_other_scenes_than_those_it_is_told_of(scene):
    with pytest.raises(Refusal, match="scene"):
        messages.parse(json.dumps({"scene": scene}), ["a"], ["b"], ["gate"])
    assert messages.parse('{"scene": null}', ["a"], ["b"], ["gate"]) == {"scene": None}


def test_a_page_chooses_a_scene_and_goes_back_to_the_open(browser, file):
    with (
        serving(SHEPHERDS, "strombom", scene=str(file)) as server,
        opened(browser, server.url, reduced_motion="reduce") as page,
    ):
        until(page, "window.skydog?.flights.length > 0")
        assert page.evaluate("[skydog.world.size, skydog.world.height]") == [9.0, 5.0]
        assert page.evaluate("skydog.world.obstacles.length") == len(scenefile.read(file).walls)
        before = pixels(page, "canvas.arena")
        page.select_option("select.scene", "gate")
        until(page, "skydog.world.size === 12 && skydog.world.obstacles.length === 2")
        page.select_option("select.scene", "none")
        until(page, "skydog.world.size === 4 && skydog.world.obstacles.length === 0")
        after = pixels(page, "canvas.arena")
        assert (before != after).any()
