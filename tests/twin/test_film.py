"""Films of missions in the twin: what they show, how long they last, and what is refused."""

import io
import sys
from dataclasses import replace
from functools import partial

import av
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from skydog.errors import Refusal
from skydog.flight import profiles
from skydog.twin import bodies, film, looks, stage
from skydog.view.colours import ROLES
from skydog.world.obstacles import Obstacles
from skydog.world.presets import preset
from skydog.world.trace import ENDINGS, Ending, Poses, Trace

LEFT = np.s_[:, : stage.PANEL - 2]  # the picture of the arena, without what is beside it
RIGHT = np.s_[:, stage.PANEL + 2 :]


@pytest.fixture
def opengl(monkeypatch):
    """OpenGL, with jagged edges that take less time."""
    monkeypatch.setattr(stage, "SAMPLES", 0)
    try:
        stage._opengl().free()
    except Refusal as missing:
        pytest.skip(str(missing))


def mission(steps: int = 5, dogs: int = 1, dog=(2.0, 1.0), **poses: np.ndarray) -> Trace:
    """A mission without an end, in which dogs fly along x at 1 m/s and rovers stand."""
    time = 0.1 * np.arange(steps + 1)
    way = np.zeros((steps + 1, dogs, 2)) + dog
    way[..., 0] += time[:, None]
    way[..., 1] += np.arange(dogs)
    level = {
        "altitude": np.full((steps + 1, dogs), 2.0),
        "attitude": np.zeros((steps + 1, dogs, 3)),
        "setpoint": np.zeros((steps + 1, dogs, 3)),
        "yaw": np.zeros((steps + 1, 3)),
        "speed": np.zeros((steps + 1, 3)),
        "turn_rate": np.zeros((steps + 1, 3)),
    }
    sheep = np.tile([[2.0, 2.5], [3.0, 2.5], [2.5, 3.2]], (steps + 1, 1, 1))
    single = partial(jnp.asarray, dtype=jnp.float32)
    return Trace(
        world=preset("paper", arena=4.0),
        time=single(time),
        sheep=single(sheep),
        dogs=single(way),
        subgoal=single(way + 0.5),
        drives=jnp.asarray(np.ones((steps + 1, dogs), bool)),
        command=single(np.zeros((steps + 1, dogs, 2))),
        accomplished=jnp.asarray(np.zeros(steps + 1, bool)),
        poses=Poses(**{name: single(pose) for name, pose in (level | poses).items()}),
    )


def picture(trace: Trace, at: float = 0.0) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(film.still(trace, at))).convert("RGB"), float)


def pixels(picture: np.ndarray, role: str) -> np.ndarray:
    """Row and column of all pixels with the hue of a role, however light falls on it."""
    colour = np.array([int(ROLES[role][place : place + 2], 16) for place in (1, 3, 5)], float)
    bright = picture.max(axis=-1, keepdims=True)
    alike = np.abs(picture / np.maximum(bright, 1.0) - colour / colour.max()).max(axis=-1) < 0.12
    return np.argwhere(alike & (bright[..., 0] > 80))


# How long a film is


def test_a_film_shows_25_frames_a_second_and_its_last_one_longer(tmp_path, opengl):
    done = []
    path = tmp_path / "herd.mp4"
    film.save(path, mission(steps=2), progress=lambda *how: done.append(how))
    assert done == [(frame, 6) for frame in range(1, 7)]  # 0.2 s, and its end
    with av.open(io.BytesIO(path.read_bytes()), "r") as shown:
        stream = shown.streams.video[0]
        assert (stream.codec.name, stream.pix_fmt, stream.average_rate) == ("h264", "yuv420p", 25)
        assert (stream.width, stream.height) == (1280, 720)
        assert stream.frames == 6 + 38  # a second and a half
        shots = [shot.to_ndarray(format="rgb24") for shot in shown.decode(video=0)]
    moved = [np.abs(shot.astype(float) - shots[0])[LEFT].max() for shot in shots[3:6]]
    assert min(moved) > 100
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("steps", "speed", "frames"),
    [(0, 1, 1), (1, 1, 4), (10, 1, 26), (300, 1, 751), (301, 2, 378), (1000, 4, 626)],
)
def test_a_longer_mission_is_shown_so_much_faster_that_it_lasts_half_a_minute(steps, speed, frames):
    scenes, fast = film.scenes_of(mission(steps))
    assert (fast, len(scenes.time)) == (speed, frames)
    assert frames <= 30 * 25 + 1
    assert scenes.time[-1] == pytest.approx(0.1 * steps)


def test_a_film_ends_with_the_mission():
    trace = mission(steps=20)
    home = replace(trace, accomplished=jnp.asarray(np.arange(21) >= 10))
    assert film.scenes_of(home)[0].time[-1] == pytest.approx(1.0)
    stood = jnp.asarray(np.asarray(trace.dogs)[np.minimum(np.arange(21), 12)])
    down = Ending(how=jnp.asarray(ENDINGS.index("UAV down")), steps=jnp.asarray(20))
    assert film.scenes_of(replace(trace, dogs=stood, ending=down))[0].time[-1] == pytest.approx(1.2)


# Where bodies are between instants


def test_bodies_move_and_turn_the_short_way_between_instants():
    yaw = np.radians([[170.0], [-170.0], [-150.0]]) * np.ones(3)
    roll = np.array([0.0, 0.2, 0.0])[:, None, None] * (1.0, 0.0, 0.0)
    scenes, _ = film.scenes_of(mission(steps=2, yaw=yaw, attitude=roll))
    np.testing.assert_allclose(scenes.time, [0.0, 0.04, 0.08, 0.12, 0.16, 0.2], atol=1e-6)
    np.testing.assert_allclose(scenes.dogs[:, 0, 0], 2.0 + scenes.time, atol=1e-6)
    np.testing.assert_allclose(scenes.dogs[:, 0, 2], 2.0)
    np.testing.assert_allclose(
        np.degrees(scenes.yaw[:, 0]), [170, 178, 186, 194, 202, 210], atol=1e-3
    )
    np.testing.assert_allclose(scenes.attitude[:, 0, 0], [0, 0.08, 0.16, 0.16, 0.08, 0], atol=1e-6)
    assert scenes.step.tolist() == [0, 0, 0, 1, 1, 2]


def test_a_mission_whose_sheep_were_recorded_at_some_instants_is_shown_whole():
    trace = mission(steps=20)
    some, sheep = np.arange(0, 21, 5), np.asarray(trace.sheep)
    few, centre = jnp.asarray(sheep[some]), jnp.asarray(sheep.mean(axis=1))
    thin = replace(trace, sheep=few, recorded=jnp.asarray(some), centre=centre)
    scenes, _ = film.scenes_of(thin)
    assert len(scenes.time) == 51
    np.testing.assert_allclose(scenes.dogs[:, 0, 0], 2.0 + scenes.time, atol=1e-5)


# What is seen


def test_both_pictures_show_the_drone_and_the_arena_shows_everyone_in_their_colours(opengl):
    shown = picture(mission(dogs=2))
    for role in ("dog", "sheep", "goal", "subgoal"):
        assert len(pixels(shown[LEFT], role)) > 50, role
    assert len(pixels(shown[RIGHT], "dog")) > 2000  # it is near


def test_the_drone_is_seen_where_it_is(opengl):
    near, far = (picture(mission(dog=(at, at)))[LEFT] for at in (0.5, 3.5))
    rows, columns = zip(*(pixels(look, "dog").mean(axis=0) for look in (near, far)), strict=True)
    assert columns[0] < stage.PANEL / 2 - 50
    assert columns[1] > stage.PANEL / 2 + 50
    assert rows[1] < rows[0] - 50


def test_the_head_of_a_rover_tells_where_it_looks(opengl):
    looking = [picture(mission(yaw=np.full((6, 3), yaw)))[LEFT] for yaw in (0.0, np.pi)]
    dark = [np.argwhere(look.max(axis=-1) < 60) for look in looking]
    assert dark[0][:, 1].mean() > dark[1][:, 1].mean() + 3


def test_a_flight_far_beyond_the_walls_is_seen_whole(opengl):
    shown = picture(mission(dog=(2.0, 9.0)))[LEFT]
    rows = pixels(shown, "dog")[:, 0]
    assert len(rows) > 50
    assert rows.min() > 0


def test_propellers_turn_in_turn_and_bodies_stand_as_they_are_posed():
    turned = np.tile([0.1, -0.2, 0.7], (6, 2, 1))
    trace = mission(dogs=2, attitude=turned)
    scenes, _ = film.scenes_of(trace)
    drawn = film._stage(trace, scenes, 1, "crazyflie", "kobuki", "")
    drawn._pose(0)
    still = drawn.data.geom_xmat.copy()
    drawn._pose(1)
    moved = np.flatnonzero(np.abs(drawn.data.geom_xmat - still).max(axis=1) > 1e-6)
    assert sorted(moved) == sorted(geom for geom, _ in drawn.blades)
    assert len(moved) == 8
    quaternions = drawn.data.qpos[drawn.bodies.dogs[:, None] + np.arange(3, 7)]
    np.testing.assert_allclose(bodies.attitudes(quaternions), turned[0], atol=1e-6)


@pytest.mark.parametrize("name", profiles.ship("uav"))
def test_what_is_drawn_has_neither_mass_nor_contact(name):
    uav, rover = profiles.uav(name), profiles.rover("kobuki")
    sides, goal = (5.0, 4.0), (0.0, 0.0, 1.0)
    closed = Obstacles(jnp.array([[[2.0, 2.0], [3.0, 3.0]], [[1.0, 1.0]] * 2]), jnp.full(2, 0.3))
    build = partial(bodies.build, uav, rover, sides, goal, sheep=2, dogs=2, closed=closed)
    dress = partial(looks.dress, uav=uav, rover=rover, sides=sides, goal=goal, closed=closed)
    bare, dressed = build().model, build(dress=dress).model
    for what in ("body_mass", "body_inertia", "body_ipos", "dof_damping", "qpos0"):
        np.testing.assert_array_equal(getattr(bare, what), getattr(dressed, what))
    physical = dressed.geom_group == bodies.PHYSICAL
    assert physical.sum() == bare.ngeom
    assert not np.any(dressed.geom_contype[~physical] | dressed.geom_conaffinity[~physical])
    for what in ("geom_contype", "geom_conaffinity", "geom_size", "geom_pos", "geom_friction"):
        np.testing.assert_array_equal(getattr(bare, what), getattr(dressed, what)[physical])


# What is refused, and what is left behind


def test_a_mission_without_physics_is_refused(tmp_path):
    with pytest.raises(Refusal, match="no poses to film; fly it with skydog twin"):
        film.save(tmp_path / "herd.mp4", replace(mission(), poses=None))
    assert not list(tmp_path.iterdir())


def test_a_stack_of_missions_is_refused():
    stack = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), mission())
    with pytest.raises(Refusal, match=r"one mission, got a stack of shape \(2,\)"):
        film.scenes_of(stack)


def test_another_format_is_refused(tmp_path):
    with pytest.raises(Refusal, match=r"name herd\.mp4"):
        film.save(tmp_path / "herd.gif", mission())


def test_without_pyav_the_refusal_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[video\]'"):
        film.save(tmp_path / "herd.mp4", mission())


@pytest.mark.parametrize("way", ["egl", "osmesa"])
def test_without_opengl_the_refusal_says_what_to_install(tmp_path, monkeypatch, way):
    monkeypatch.setenv("MUJOCO_GL", way)
    monkeypatch.setitem(sys.modules, f"mujoco.{way}", None)
    with pytest.raises(Refusal, match=f"{way} has none .*libegl1.*MUJOCO_GL=osmesa"):
        film.save(tmp_path / "herd.mp4", mission())
    assert not list(tmp_path.iterdir())


def test_a_film_that_is_interrupted_leaves_what_was_there(tmp_path, opengl):
    def interrupt(done, whole):
        if done == 3:
            raise KeyboardInterrupt

    path = tmp_path / "herd.mp4"
    path.write_bytes(b"an older film")
    with pytest.raises(KeyboardInterrupt):
        film.save(path, mission(), progress=interrupt)
    assert path.read_bytes() == b"an older film"
    assert list(tmp_path.iterdir()) == [path]
