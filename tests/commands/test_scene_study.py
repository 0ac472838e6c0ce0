import json

import numpy as np
import pytest

from skydog.commands import scenes as command
from skydog.study import scenes
from skydog.world import trace as traces
from skydog.world.home import AroundHome


@pytest.fixture(scope="module")
def folder(unchecked, tmp_path_factory):
    """The study in its run folder, of one scene, few sheep and two missions a cell."""
    out = tmp_path_factory.mktemp("scenes")
    with pytest.MonkeyPatch.context() as few:
        for name, value in {
            "SCENE_NAMES": ("gate",),
            "NAMES": ("strombom",),
            "FLOCKS": {1: 2},
            "STEPS": {1: 900, 2: 300, 3: 300},
            "GATE_CASES": 2,
            "STRAIGHT_CASES": 2,
            "COMPARED": "gate",
            "GROUNDED": (),
            "SHOWN_SHEEP": 1,
        }.items():
            few.setattr(scenes, name, value)
        returned = command.run(out, "skydog reproduce --scenes")
        yield out, returned


def test_every_cell_of_the_study_has_figures_around_and_straight(folder):
    out, returned = folder
    results = json.loads((out / "results.json").read_text())
    assert set(results) == set(returned) == {"scenes", "grounded"}
    row = results["scenes"]["gate"]["1"]["strombom"]
    assert row["around"]["success"] == 1.0
    assert row["around"]["cases"] == row["straight"]["cases"] == 2
    ratio = row["around"]["steps"]["mean"] / row["straight"]["steps"]["mean"]
    assert row["times straight"] == pytest.approx(ratio)


def test_the_page_says_how_it_was_made_and_has_the_figures(folder):
    out, _ = folder
    text = (out / "obstacles.md").read_text()
    assert "Made by `skydog reproduce --scenes`" in text
    assert "| gate, 1 sheep | 100 % [34, 100] |" in text
    assert "(obstacles.png)" in text
    assert (out / "obstacles.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (out / "report.html").read_text()


def test_the_folder_has_a_mission_of_each_scene_to_replay(folder):
    out, _ = folder
    trace, name = traces.load(out / "traces" / "gate.safetensors")
    assert name == "gate"
    assert isinstance(trace.world.home, AroundHome)
    assert np.asarray(trace.accomplished)[-1]
