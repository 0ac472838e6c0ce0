import re
from xml.etree import ElementTree

import numpy as np
import pytest
from flights import herded, two_dogs_cut_short

from skydog.study import metrics
from skydog.view import figures
from skydog.view.colours import ROLES

EPISODES = np.arange(10, 210, 10)


def curve(episodes, slope=0.001):
    return episodes, slope * episodes


def points(line):
    return np.asarray(line.get_xydata())


def test_a_figure_is_saved_as_png_and_svg_byte_for_byte_alike_twice(tmp_path):
    for name in ("once", "twice"):
        figures.save(figures.trajectories({"Strömbom": herded()}), tmp_path / name / "paths.of.1")
    once, twice = (
        {f.name: f.read_bytes() for f in (tmp_path / n).iterdir()} for n in ("once", "twice")
    )
    assert set(once) == {"paths.of.1.png", "paths.of.1.svg"}
    assert once == twice
    assert once["paths.of.1.png"].startswith(b"\x89PNG")


def test_a_panel_is_titled_with_shepherd_steps_and_distance():
    traces = {"$rule_dog": herded(), "pair": two_dogs_cut_short()}
    first, second = (axes.get_title(loc="left") for axes in figures.trajectories(traces).axes)
    steps, distance = int(metrics.steps(herded())), float(metrics.distance(herded()))
    turn = f"turns by {float(metrics.turn(herded())):.0f}° a step"
    assert first == f"$rule_dog\n{steps} steps, {distance:.1f} m flown\n{turn}"
    assert second.startswith("pair\nnot accomplished, 20 steps, ")


def test_panels_show_every_path_at_one_scale():
    traces = {"one": herded(), "two": two_dogs_cut_short()}
    panels = figures.trajectories(traces).axes
    assert panels[0].get_xlim() == panels[1].get_xlim() == panels[1].get_ylim()
    low, high = panels[0].get_xlim()
    for axes, trace in zip(panels, traces.values(), strict=True):
        drawn = {points(line).tobytes() for line in axes.lines}
        for path in [*np.swapaxes(trace.sheep, 0, 1), *np.swapaxes(trace.dogs, 0, 1)]:
            assert np.asarray(path, float).tobytes() in drawn
            assert low <= path.min() <= path.max() <= high


def test_one_seed_is_a_line_without_a_band():
    (axes,) = figures.learning_curves({"collect": [curve(EPISODES)]}).axes
    faint, line = axes.lines
    np.testing.assert_allclose(points(faint), np.stack(curve(EPISODES)).T)
    smooth = figures.smoothed(curve(EPISODES)[1])
    np.testing.assert_allclose(points(line), np.stack([EPISODES, smooth]).T)
    assert not axes.collections
    assert line.get_color() == ROLES["collect"]


def test_seeds_are_their_mean_and_sd_as_far_as_the_shortest_goes():
    seeds = [curve(EPISODES, 0.001), curve(EPISODES[:8] + 3, 0.003)]
    (axes,) = figures.learning_curves({"drive": seeds}).axes
    (_, line), (band,) = axes.lines, axes.collections
    shortest = EPISODES[:8] + 3  # of so few nothing is smoothed
    np.testing.assert_allclose(points(line), np.stack(curve(shortest, 0.002)).T)
    spread = np.std([0.001, 0.003], ddof=1) * shortest[-1]
    top = np.max(np.asarray(band.get_paths()[0].vertices)[:, 1])
    assert top == pytest.approx(0.002 * shortest[-1] + spread)


@pytest.mark.parametrize(("rows", "window"), [(300, 10), (40, 4), (5, 1)])
def test_a_curve_is_smoothed_by_the_mean_of_the_latest_rows(rows, window):
    values = np.random.default_rng(0).normal(size=rows)
    expected = [values[max(0, row + 1 - window) : row + 1].mean() for row in range(rows)]
    np.testing.assert_allclose(figures.smoothed(values), expected, atol=1e-12)


def test_missions_are_drawn_over_the_training_steps_beside_the_rule_dog():
    def row(success, steps):
        interval = [success - 0.1, success + 0.1], [steps - 9, steps + 9]
        mean = {"mean": steps, "sd": 9, "ci95": interval[1]}
        return {"success": success, "success_ci95": interval[0], "cases": 30, "steps": mean}

    rows, rule = {0: row(0.1, 900.0), 5_000: row(0.8, 200.0)}, row(0.9, 120.0)
    curves = {skill: curve(EPISODES) for skill in ("collect", "drive")}
    success, collect, steps, drive = figures.learning(rows, rule, curves).axes
    for axes, values, level in ((success, [10, 80], 90), (steps, [900, 200], 120)):
        line, reference = axes.lines
        np.testing.assert_allclose(points(line), np.stack([[0, 5], values]).T)
        np.testing.assert_allclose(points(reference)[:, 1], level)
        assert len(axes.collections) == 1
    for axes, skill in ((collect, "collect"), (drive, "drive")):
        assert axes.lines[1].get_color() == ROLES[skill]


def test_a_skill_without_ten_episodes_yet_has_an_empty_panel():
    nothing = (np.array([]), np.array([]))
    (axes,) = figures.learning_curves({"drive": [nothing]}).axes
    assert not axes.lines


def test_figures_inside_one_page_share_no_id_and_miss_none():
    traces = {"one": herded()}
    drawn = [
        figures.svg(figures.trajectories(traces)),
        figures.svg(figures.learning_curves({"drive": [curve(EPISODES)]})),
    ]
    ids = [set(re.findall(r'\bid="([^"]+)"', markup)) for markup in drawn]
    assert not ids[0] & ids[1]
    for markup, own in zip(drawn, ids, strict=True):
        ElementTree.fromstring(markup)
        assert set(re.findall(r'(?:url\(|href=")#([^")]+)', markup)) <= own
