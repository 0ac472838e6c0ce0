import dataclasses
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from browser import opened, pixels, until
from flights import herded, posed, two_dogs_cut_short
from PIL import Image

from skydog.study import metrics
from skydog.study.report import document
from skydog.view import figures, replay
from skydog.view.colours import ROLES

WICKED = "</script><b>&amp; {{colours}} <!--"


class Reader(HTMLParser):
    """The scripts of a page, and its tags, as a browser would tell them apart."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.scripts = [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.scripts and self.lasttag == "script":
            self.scripts[-1] += data


def missions(page):
    return json.loads(Reader(page).scripts[0])


def test_a_page_refers_to_nothing_outside_itself():
    page = replay.page({"Strömbom": herded()})
    assert not re.search(r"https?:|//\w+\.\w+/|\bsrc=|\bhref=|@import|url\(|fetch\(|import\(", page)
    assert not {"link", "img", "iframe", "object"} & set(Reader(page).tags)


@pytest.mark.parametrize("trace", [herded, two_dogs_cut_short])
def test_a_page_holds_the_mission_to_the_millimetre_up_to_its_end(trace):
    trace = trace()
    (shown,) = missions(replay.page({"Strömbom": trace}))
    instants = int(metrics.steps(trace)) + 1
    for name in ("time", "sheep", "dogs", "subgoal"):
        whole = np.asarray(getattr(trace, name))
        assert np.shape(shown[name]) == (instants, *whole.shape[1:])
        np.testing.assert_allclose(shown[name], whole[:instants], atol=0.501e-3)
    np.testing.assert_array_equal(shown["drives"], trace.drives[:instants])
    assert shown["ending"] == ("accomplished" if metrics.success(trace) else "out of time")
    assert shown["step"] == list(range(instants))
    assert len(shown["flown"]) == instants
    assert shown["flown"][-1] == pytest.approx(float(metrics.distance(trace)), abs=1e-3)
    low, high = shown["extent"]
    assert low < np.min(shown["dogs"])
    assert high > np.max(shown["subgoal"])


def assert_shown(poses, whole, instants):
    roll, pitch, _ = np.moveaxis(np.degrees(whole.attitude)[instants], -1, 0)
    height = np.asarray(whole.setpoint)[instants, :, 2]
    for name, true in (("altitude", whole.altitude[instants]), ("setpoint", height)):
        np.testing.assert_allclose(poses[name], true, atol=0.501e-3)
    for name, true in (("roll", roll), ("pitch", pitch)):
        np.testing.assert_allclose(poses[name], true, atol=0.0501)
    np.testing.assert_allclose(poses["yaw"], whole.yaw[instants], atol=0.501e-3)


@pytest.mark.parametrize("trace", [herded, two_dogs_cut_short])
def test_a_page_holds_altitude_attitude_and_headings_up_to_the_end(trace):
    trace = posed(trace())
    (shown,) = missions(replay.page({"Strömbom": trace}))
    assert_shown(shown["poses"], trace.poses, np.arange(int(metrics.steps(trace)) + 1))


def test_poses_are_thinned_with_the_sheep():
    whole, recorded = posed(two_dogs_cut_short()), np.array([0, 7, 14, 20])
    thin = dataclasses.replace(
        whole,
        sheep=whole.sheep[recorded],
        recorded=jnp.asarray(recorded),
        centre=whole.sheep.mean(axis=1),
    )
    (shown,) = missions(replay.page({"Strömbom": thin}))
    assert shown["step"] == recorded.tolist()
    assert_shown(shown["poses"], whole.poses, recorded)


def test_a_name_cannot_break_out_of_the_page():
    plain, wicked = (replay.page({name: herded()}) for name in ("plain", WICKED))
    assert missions(wicked)[0]["name"] == WICKED
    assert Reader(wicked).tags == Reader(plain).tags


@pytest.mark.parametrize("name", ["\udcff\x1b[31m\n", r"$\foo$", "x" * 20_000_000])
def test_a_name_may_hold_anything_and_be_of_any_length(name):
    traces = {name: two_dogs_cut_short()}
    (shown,) = missions(replay.page(traces))
    assert shown["name"].isprintable()
    assert len(shown["name"]) < 1000
    assert Image.open(io.BytesIO(replay.gif(traces))).size == (480, 480)
    assert figures.trajectories(traces)


def test_a_page_knows_the_colour_of_every_role():
    page = replay.page({"Strömbom": herded()})
    for role, colour in ROLES.items():
        assert f"--{role}: {colour};" in page


def test_the_page_is_written_with_the_player_in_it(tmp_path):
    traces = {"one": herded(), "two": two_dogs_cut_short()}
    replay.save(tmp_path / "replay.html", traces)
    assert replay.player(traces) in (tmp_path / "replay.html").read_text("utf-8")


def test_an_animation_moves_stays_small_and_holds_its_end(tmp_path):
    replay.save(tmp_path / "replay.gif", {"Strömbom": herded()})
    content = (tmp_path / "replay.gif").read_bytes()
    assert len(content) < 2_000_000
    film = Image.open(io.BytesIO(content))
    assert film.size == (480, 480)
    last = getattr(film, "n_frames", 1) - 1
    assert last == pytest.approx(int(metrics.steps(herded())) / 2, abs=1)
    shots, durations = [], []
    for number in (0, last // 2, last):
        film.seek(number)
        shots.append(np.asarray(film.convert("RGB")))
        durations.append(film.info["duration"])
    assert durations == [80, 80, 1500]
    assert (shots[0] != shots[1]).any()
    assert (shots[1] != shots[2]).any()


def test_missions_of_one_animation_stand_side_by_side():
    traces = {"one": two_dogs_cut_short(), "two": two_dogs_cut_short()}
    assert Image.open(io.BytesIO(replay.gif(traces))).size == (960, 480)


def test_the_script_of_the_page_parses(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not on the PATH, so the page's script is not parsed")
    _, *scripts = Reader(replay.page({"Strömbom": herded()})).scripts
    assert len(scripts) == 2
    for script in scripts:
        (tmp_path / "script.js").write_text(script)
        subprocess.run([node, "--check", tmp_path / "script.js"], check=True, capture_output=True)


def test_a_number_that_is_not_finite_is_never_written(tmp_path):
    trace = dataclasses.replace(herded(), dogs=jnp.nan * herded().dogs)
    with pytest.raises(ValueError, match="not JSON compliant"):
        replay.save(tmp_path / "replay.html", {"lost": trace})
    assert not list(tmp_path.iterdir())


def test_the_page_plays_in_a_browser_and_can_be_scrubbed(browser, tmp_path):
    path = tmp_path / "replay.html"
    replay.save(path, {"one": herded(), "two": two_dogs_cut_short()})
    with opened(browser, path.as_uri()) as page:
        first = pixels(page, "canvas")
        page.select_option(".speed", "4")
        last = int(metrics.steps(herded()))
        until(page, f"document.querySelector('.step').textContent === '{last} of {last}'")
        assert page.inner_text(".doing") == "accomplished"
        assert (pixels(page, "canvas") != first).any()
        page.keyboard.press("Home")
        assert page.inner_text(".step") == f"0 of {last}"
        page.keyboard.press("ArrowRight")
        assert page.inner_text(".step") == f"1 of {last}"
        page.select_option(".mission", "1")
        assert page.inner_text(".step") == "0 of 20"


def test_missions_side_by_side_are_to_one_scale_and_move_together(browser, tmp_path):
    path = tmp_path / "beside.html"
    both = replay.beside({"one": herded(), "two": two_dogs_cut_short()})
    path.write_text(document("Two", both))
    last = int(metrics.steps(herded()))
    with opened(browser, path.as_uri()) as page:
        told = [
            f"document.querySelectorAll('.step')[{which}].textContent === '{end} of {end}'"
            for which, end in enumerate((last, 20))
        ]
        page.locator(".speed").last.select_option("8")
        assert page.locator(".speed").first.input_value() == "8"
        page.locator("button").last.click()
        for over in told:
            until(page, over)
        page.locator(".replay").last.focus()
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        assert page.locator(".step").all_inner_texts() == [f"1 of {last}", "1 of 20"]
        shown = page.locator("script[type='application/json']").all_text_contents()
    extents = [json.loads(mission)[0]["extent"] for mission in shown]
    own = [mission["extent"] for mission in missions(replay.page({"1": herded()}))]
    assert extents[0] == extents[1] != own


def strip_cursor(page):
    """Where the cursor of the strip is, in CSS pixels from the left of the window."""
    return page.evaluate("document.querySelector('.strip .cursor').getBoundingClientRect().x")


def test_the_strip_follows_the_play_head_and_seeks_where_it_is_clicked(browser, tmp_path):
    path = tmp_path / "replay.html"
    replay.save(path, {"one": posed(herded()), "two": posed(two_dogs_cut_short(), "UAV down")})
    with opened(browser, path.as_uri(), reduced_motion="reduce") as page:
        start, last = strip_cursor(page), int(metrics.steps(herded()))
        page.keyboard.press("End")
        end = strip_cursor(page)
        assert page.inner_text(".doing") == "accomplished"
        box = page.locator(".strip").bounding_box()
        assert box["x"] < start < end < box["x"] + box["width"]
        page.locator(".strip").click(position={"x": (start + end) / 2 - box["x"], "y": 90})
        assert abs(int(page.inner_text(".step").split()[0]) - last / 2) <= 1
        assert strip_cursor(page) == pytest.approx((start + end) / 2, abs=(end - start) / last)
        page.keyboard.press("Home")
        assert strip_cursor(page) == start
        page.select_option(".speed", "8")
        page.click("button")
        until(page, f"document.querySelector('.strip .cursor').getBoundingClientRect().x > {start}")
        until(page, f"document.querySelector('.step').textContent === '{last} of {last}'")
        assert strip_cursor(page) == end
        page.select_option(".mission", "1")
        assert strip_cursor(page) == start
        # Of each dog: altitude with its set-point, roll, pitch.
        assert page.locator(".strip .thin").count() == 2 * 3
        assert page.locator(".strip .setpoint").count() == 2
        page.locator(".replay").focus()
        page.keyboard.press("End")
        assert page.inner_text(".doing") == "UAV down"


def test_sheep_with_poses_show_their_headings(browser, tmp_path):
    path, there = tmp_path / "replay.html", posed(two_dogs_cut_short())
    assert there.poses is not None
    back = dataclasses.replace(there.poses, yaw=there.poses.yaw + jnp.pi)
    replay.save(path, {"there": there, "back": dataclasses.replace(there, poses=back)})
    with opened(browser, path.as_uri(), reduced_motion="reduce") as page:
        first = pixels(page, "canvas")
        page.select_option(".mission", "1")
        assert (pixels(page, "canvas") != first).any()


def test_a_mission_without_poses_has_no_strip(browser, tmp_path):
    path = tmp_path / "replay.html"
    replay.save(path, {"with": posed(two_dogs_cut_short()), "without": two_dogs_cut_short()})
    assert missions(path.read_text("utf-8"))[1]["poses"] is None
    with opened(browser, path.as_uri(), reduced_motion="reduce") as page:
        assert page.locator(".posed-only:visible").count() == 2
        narrow = page.locator("canvas").bounding_box()["width"]
        page.select_option(".mission", "1")
        assert page.locator(".posed-only:visible").count() == 0
        assert page.locator("canvas").bounding_box()["width"] > narrow


@pytest.mark.parametrize("instants", [1, 2])
def test_a_dog_that_lies_still_has_a_strip_too(browser, tmp_path, instants):
    path, trace = tmp_path / "replay.html", posed(two_dogs_cut_short())
    poses = jax.tree.map(lambda every: jnp.zeros_like(every[:instants]), trace.poses)
    parts = ("time", "sheep", "dogs", "subgoal", "drives", "command", "accomplished")
    short = {name: getattr(trace, name)[:instants] for name in parts}
    replay.save(path, {"still": dataclasses.replace(trace, **short, poses=poses)})
    with opened(browser, path.as_uri(), reduced_motion="reduce") as page:
        assert "NaN" not in page.inner_html(".strip")
        assert "Infinity" not in page.inner_html(".strip")
