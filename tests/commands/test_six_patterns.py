import json

import pytest

from skydog.commands import patterns as command
from skydog.study import patterns
from skydog.world import trace as traces
from skydog.world.presets import preset

WORLD = preset("elfiqi2020", sheep=4)


@pytest.fixture(scope="module")
def folder(unchecked, tmp_path_factory):
    """The study in its run folder, of one pattern, few sheep and two missions a cell."""
    out = tmp_path_factory.mktemp("patterns")
    with pytest.MonkeyPatch.context() as few:
        for name, value in {
            "PATTERNS": {"P1": patterns.PATTERNS["P1"]},
            "NAMES": ("elfiqi", "arc"),
            "SHEEP": 4,
            "CASES": 2,
            "FLOCKS": (4,),
            "FLOCK_CASES": 2,
            "ELSEWHERE": {"another": ("elfiqi2020", 60.0, 4)},
            "STEPS": 300,
        }.items():
            few.setattr(patterns, name, value)
        returned = command.run(out, "skydog reproduce --patterns")
    assert set(returned) == set(json.loads((out / "results.json").read_text()))
    return out


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_every_part_of_the_study_has_a_row_for_each_shepherd(results):
    assert set(results["patterns"]["P1"]) == {"least", "elfiqi", "arc"}
    assert set(results["lesser"]["P1"]) == set(patterns.lesser(WORLD))
    for part, where in (("without walls", "P1"), ("flocks", "4 sheep"), ("elsewhere", "another")):
        assert set(results[part][where]) == {"elfiqi", "arc"}
    assert results["patterns"]["P1"]["elfiqi"]["less than theirs"]["mean"] == 0.0


def test_arc_brings_a_small_flock_home_in_no_fewer_steps_than_the_least(results):
    rows = results["patterns"]["P1"]
    assert rows["arc"]["success"] == 1.0
    assert 15 <= rows["least"]["mean"] <= rows["arc"]["steps"]["mean"]


def test_the_page_has_the_printed_figures_beside_ours(folder, results):
    text = (folder / "patterns.md").read_text()
    ours = results["patterns"]["P1"]["arc"]["first"]
    assert "Made by `skydog reproduce --patterns`" in text
    assert "| P1 | 10 of 10, 81 |" in text
    assert f"2 of 2, {ours['steps']['mean']:.0f} |" in text
    assert "patterns.png" in text


def test_the_folder_has_the_figure_a_report_and_a_trace_to_replay(folder):
    assert (folder / "patterns.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (folder / "report.html").read_text()
    trace, name = traces.load(folder / "traces" / "P1-arc.safetensors")
    assert name == "P1-arc"
    assert trace.sheep.shape[1:] == (4, 2)
    assert bool(trace.accomplished[-1])
