"""Shepherds on the same cases, in one table."""

import csv
import json

import numpy as np
import pytest

import skydog
from skydog.errors import Refusal
from skydog.study import compare, evaluate
from skydog.study.cases import cases
from skydog.world.presets import preset

WORLD = preset("paper", 4.0)
NAMES = ["strombom", "strombom-arrive"]
SHAPE = {"world": WORLD, "cases": 4, "steps": 100}


@pytest.fixture(scope="module")
def found():
    return skydog.compare(NAMES, **SHAPE)


def test_a_row_is_what_the_shepherd_flies_alone(found):
    alone = evaluate.measure(
        evaluate.fly(WORLD, skydog.Strombom(), cases(WORLD, 4), 100, None, None)
    )
    assert found.rows["strombom"] == evaluate.figures(alone)
    assert found.first == "strombom"


def test_differences_are_of_the_same_missions(found):
    ours, theirs = (found.missions[name]["steps"] for name in reversed(NAMES))
    (less,) = found.differences.values()
    assert less["steps"]["mean"] == pytest.approx(np.mean(ours - theirs))
    low, high = less["success"]["ci95"]
    assert low <= less["success"]["mean"] <= high
    assert high - low > 0.1  # four cases say little, even if all succeed


def test_it_shows_itself_as_a_table(found):
    for shown in (repr(found), found._repr_html_(), found.markdown()):
        assert all(name in shown for name in NAMES)
        assert "4 missions" in shown
    assert json.loads(json.dumps(found.plain()))["rows"].keys() == set(NAMES)


def test_a_folder_keeps_rows_and_flies_only_who_is_new(found, tmp_path):
    flights = []

    def fly(*missions):
        flights.append(missions[1])
        return evaluate.fly(*missions, every=None)

    skydog.compare(NAMES[:1], **SHAPE, out=tmp_path, fly=fly)
    again = skydog.compare(NAMES, **SHAPE, out=tmp_path, fly=fly)
    assert [shepherd.at_point for shepherd in flights] == ["constant", "arrive"]
    assert again.rows == found.rows
    assert skydog.compare(NAMES, **SHAPE, out=tmp_path, fly=fly).rows == found.rows
    assert len(flights) == 2
    with (tmp_path / "results.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["shepherd"] for line in lines] == [name for name in NAMES for _ in range(4)]
    written = json.loads((tmp_path / "results.json").read_text())
    assert written["rows"]["strombom"]["digest"] == "rule"
    assert (tmp_path / "results.md").read_text() == again.markdown()


def test_what_is_flown_before_a_stop_is_kept(found, tmp_path):
    def fly(world, shepherd, *rest):
        if shepherd.at_point == "arrive":
            raise KeyboardInterrupt
        return evaluate.fly(world, shepherd, *rest, every=None)

    with pytest.raises(KeyboardInterrupt):
        skydog.compare(NAMES, **SHAPE, out=tmp_path, fly=fly)
    flown = []

    def others(world, shepherd, *rest):
        flown.append(shepherd.at_point)
        return evaluate.fly(world, shepherd, *rest, every=None)

    assert skydog.compare(NAMES, **SHAPE, out=tmp_path, fly=others).rows == found.rows
    assert flown == ["arrive"]


def test_a_folder_of_other_missions_or_that_is_damaged_is_refused(found, tmp_path):
    skydog.compare(NAMES[:1], **SHAPE, out=tmp_path)
    with pytest.raises(Refusal, match=r"other missions \(steps\).*choose another --out"):
        skydog.compare(NAMES[:1], **{**SHAPE, "steps": 99}, out=tmp_path)
    # Missions that are lost are flown again; another comparison is not written over for that.
    (tmp_path / "results.csv").unlink()
    with pytest.raises(Refusal, match="other missions"):
        skydog.compare(NAMES[:1], **{**SHAPE, "steps": 99}, out=tmp_path)
    again = skydog.compare(NAMES[:1], **SHAPE, out=tmp_path)
    assert again.rows["strombom"] == found.rows["strombom"]
    (tmp_path / "results.csv").write_text("shepherd,case,steps\nstrombom,1,many\n")
    with pytest.raises(Refusal, match="damaged"):
        skydog.compare(NAMES[:1], **SHAPE, out=tmp_path)


def test_functions_and_names_of_ones_own_are_taken():
    def mine(world, state):
        return state.dogs

    assert list(compare.entries([mine, "arc"])) == ["mine", "arc"]
    assert list(compare.entries({"a": mine, "b": "arc"})) == ["a", "b"]
    for shepherds in ([], "arc", ["arc", "arc"]):
        with pytest.raises(Refusal):
            compare.entries(shepherds)  # pyright: ignore[reportArgumentType]
