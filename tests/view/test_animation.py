"""Films and the pictures that they are made of."""

import io
import sys

import av
import jax.numpy as jnp
import numpy as np
import pytest
from flights import herded, two_dogs_cut_short
from PIL import Image

from skydog.errors import Refusal
from skydog.study import metrics
from skydog.view import animation, replay
from skydog.view.colours import ROLES
from skydog.world.presets import preset
from skydog.world.trace import Trace


def shots(content: bytes) -> list[np.ndarray]:
    with av.open(io.BytesIO(content), "r") as film:
        return [shot.to_ndarray(format="rgb24") for shot in film.decode(video=0)]


def shows(picture, role: str, off: int = 0) -> bool:
    """Whether some pixel has the colour of a role, give or take `off` in each channel."""
    colour = [int(ROLES[role][place : place + 2], 16) for place in (1, 3, 5)]
    return bool((np.abs(picture.astype(int) - colour).max(axis=-1) <= off).any())


def circling(steps: int) -> Trace:
    """A mission of so many steps in which a dog flies rounds and nobody arrives."""
    world = preset("paper")
    turn = jnp.arange(steps + 1) / 20
    dogs = 2.0 + 1.5 * jnp.stack([jnp.cos(turn), jnp.sin(turn)], axis=-1)[:, None]
    flock = jnp.broadcast_to(jnp.asarray([[3.0, 2.0], [2.5, 3.0], [3.5, 1.0]]), (steps + 1, 3, 2))
    return Trace(
        world=world,
        time=turn,
        sheep=flock,
        dogs=dogs,
        subgoal=dogs + 0.5,
        drives=jnp.ones((steps + 1, 1), bool),
        command=jnp.zeros_like(dogs),
        accomplished=jnp.zeros(steps + 1, bool),
    )


# Films


def test_an_mp4_shows_every_step_in_a_format_that_browsers_play(tmp_path):
    replay.save(tmp_path / "herd.mp4", {"Strömbom": herded()})
    content = (tmp_path / "herd.mp4").read_bytes()
    steps = int(metrics.steps(herded()))
    with av.open(io.BytesIO(content), "r") as film:
        stream = film.streams.video[0]
        told = stream.codec.name, stream.pix_fmt, stream.width, stream.height
        assert told == ("h264", "yuv420p", 480, 480)
        assert stream.average_rate == 25
        assert stream.frames == steps + 1 + 38  # the last stands for a second and a half
    assert content.index(b"moov") < content.index(b"mdat")  # plays before it is all there
    assert len(content) < 2_000_000
    pictures = shots(content)
    assert len(pictures) == steps + 39
    assert not np.array_equal(pictures[0], pictures[steps // 2])
    np.testing.assert_allclose(pictures[-1], pictures[steps], atol=60)
    assert list(tmp_path.iterdir()) == [tmp_path / "herd.mp4"]


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_the_first_picture_of_a_film_shows_everyone_in_their_colours(tmp_path, suffix):
    replay.save(tmp_path / f"herd.{suffix}", {"Strömbom": two_dogs_cut_short()})
    content = (tmp_path / f"herd.{suffix}").read_bytes()
    if suffix == "gif":
        first = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))
    else:
        first = shots(content)[0]
    assert first.shape == (480, 480, 3)
    for role in ("sheep", "dog"):
        assert shows(first, role, off=40)
    assert shows(first, "drive", off=40) or shows(first, "collect", off=40)


def test_a_gif_has_the_very_colour_of_whatever_is_small(tmp_path):
    film = Image.open(io.BytesIO(animation.gif({"Strömbom": two_dogs_cut_short()})))
    first = np.asarray(film.convert("RGB"))
    assert all(shows(first, role) for role in ("sheep", "dog", "subgoal"))


@pytest.mark.parametrize(("sheep", "far_back"), [(3, True), (100, False)])
def test_of_a_large_flock_only_the_latest_way_is_shown(sheep, far_back):
    world, instants = preset("paper", 30.0, sheep), 200
    way = np.full((instants, sheep, 2), 15.0, np.float32)
    way[:100, :, 0] = 25.0  # the trail leads there, for those who remember it
    dogs = np.full((instants, 1, 2), 5.0, np.float32)
    draw = animation.stage(world, sheep, 1)
    moved, stood = (
        draw(seen, dogs, dogs[0], np.ones(1, bool), "", 0)
        for seen in (way, np.full_like(way, 15.0))
    )
    assert (not np.array_equal(moved, stood)) == far_back


@pytest.mark.parametrize("film", [animation.gif, animation.mp4])
def test_three_missions_stand_side_by_side_until_the_longest_ends(film):
    traces = {"one": circling(4), "two": circling(8), "pair": two_dogs_cut_short()}
    content = film(traces)
    if film is animation.gif:
        shown = Image.open(io.BytesIO(content))
        assert shown.size == (3 * 480, 480)
        assert getattr(shown, "n_frames", 1) == 11
    else:
        pictures = shots(content)
        assert pictures[0].shape == (480, 3 * 480, 3)
        assert len(pictures) == 21 + 38
        still = np.abs(pictures[6].astype(int) - pictures[20])
        assert still[:, :480].max() < 60 < still[:, 960:].max()


@pytest.mark.parametrize(("steps", "frames"), [(1000, 1001), (2000, 1001)])
def test_a_long_mission_lasts_no_longer_than_a_minute(monkeypatch, steps, frames):
    drawn = []
    monkeypatch.setattr(animation, "PIXELS", 48)
    monkeypatch.setattr(
        animation,
        "_pictures",
        lambda traces, instants: (
            drawn.append(instant) or np.zeros((48, 48, 3), np.uint8) for instant in instants
        ),
    )
    content = animation.mp4({"lost": circling(steps)})
    assert len(drawn) == frames + 38
    assert drawn[0] == 0
    assert set(drawn[frames:]) == {steps}
    with av.open(io.BytesIO(content), "r") as film:
        assert float(film.duration or 0) / av.time_base < 62
    drawn.clear()
    animation.gif({"lost": circling(steps)})
    assert len(drawn) <= animation.SAMPLES + animation.FRAMES + 1


def test_an_mp4_without_pyav_is_refused_with_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(Refusal, match=r"run: pip install 'skydog\[video\]'$"):
        replay.save(tmp_path / "herd.mp4", {"Strömbom": two_dogs_cut_short()})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["replay.avi", "replay", "replay.mp4.txt"])
def test_a_replay_of_another_kind_is_refused_with_the_kinds_that_there_are(tmp_path, name):
    with pytest.raises(Refusal, match=r"\.html.*\.gif.*\.mp4"):
        replay.save(tmp_path / name, {"Strömbom": herded()})
    assert not list(tmp_path.iterdir())


# The stage


def instant(sheep: int = 3, dogs: int = 1, instants: int = 5):
    """Plain arrays as an environment has them, within 4 m."""
    rng = np.random.default_rng(sheep)
    flock = rng.uniform(1, 3, (instants, sheep, 2)).astype(np.float32)
    team = rng.uniform(1, 3, (instants, dogs, 2)).astype(np.float32)
    return flock, team, team[-1] + np.float32(0.5), np.arange(dogs) % 2 == 0


@pytest.mark.parametrize("pixels", [96, 240, 333, 480, 511])
def test_a_stage_draws_plain_arrays_as_wide_and_high_as_asked(pixels):
    draw = animation.stage(preset("paper"), 3, 2, pixels)
    picture = draw(*instant(3, 2), "two dogs", 4)
    assert picture.shape == (pixels, pixels, 3)
    assert picture.dtype == np.uint8
    for role in ("sheep", "dog"):
        assert shows(picture, role)


def test_a_stage_shows_each_role_and_behaviour_in_its_colour():
    draw = animation.stage(preset("paper"), 3, 1)
    sheep, dogs, subgoal, _ = instant()
    for drives, role, other in ((True, "drive", "collect"), (False, "collect", "drive")):
        picture = draw(sheep, dogs, subgoal, np.array([drives]), "", 4)
        assert shows(picture, role)
        assert not shows(picture, other)
        for always in ("sheep", "dog", "subgoal"):
            assert shows(picture, always)


def test_a_stage_remembers_nothing_and_its_pictures_stay():
    draw = animation.stage(preset("paper"), 3, 1)
    sheep, dogs, subgoal, drives = instant()
    first = draw(sheep[:1], dogs[:1], subgoal, drives, "", 0)
    kept = first.copy()
    later = draw(sheep, dogs, subgoal, drives, "", 4)
    assert not np.array_equal(first, later)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(draw(sheep[:1], dogs[:1], subgoal, drives, "", 0), first)


@pytest.mark.parametrize("name", ["paper", "strombom2014"])
def test_a_stage_shows_a_dog_beyond_the_walls(name):
    world = preset(name)
    size = float(world.arena.size)
    draw = animation.stage(world, 3, 1)
    sheep = np.full((1, 3, 2), size / 2, np.float32)
    beyond = min(float(world.dog.airspace), size / 2)
    for corner in (-beyond, size + beyond):
        dogs = np.full((1, 1, 2), corner, np.float32)
        assert shows(draw(sheep, dogs, dogs[0], np.array([True]), "", 0), "dog")


def test_a_name_is_drawn_as_it_is_written():
    draw = animation.stage(preset("paper"), 3, 1)
    plain, wicked = (draw(*instant(), title, 4) for title in ("x", r"$\frac$ <b>"))
    assert not np.array_equal(plain, wicked)


def test_more_missions_than_fit_an_mp4_are_refused_before_any_is_drawn(tmp_path):
    many = {str(number): two_dogs_cut_short() for number in range(35)}
    with pytest.raises(Refusal, match=r"at most 34 missions, got 35"):
        replay.save(tmp_path / "wide.mp4", many)
    assert not list(tmp_path.iterdir())
