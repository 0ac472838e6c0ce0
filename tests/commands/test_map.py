"""`skydog reproduce --herdability`, where nothing is flown."""

import json

import pytest

from skydog.commands import herdability as command
from skydog.study import herdability as study
from skydog.study import herds
from skydog.study.herdability_page import summary


def fly(name, sheep, dogs, runs, steps, progress):
    """As `study.fly`, but nothing is flown: captured by √M dogs, of the ring by one fewer."""
    progress(steps, runs)
    captured = dogs >= sheep**0.5 - (name == study.OURS)
    step = (300 if name == study.RULE else 100) if captured else herds.NEVER
    return {"share": [1.0 if captured else 0.5] * runs, **dict.fromkeys(KEPT, [step] * runs)}


KEPT = ("settled", "captured")


@pytest.fixture
def flown(monkeypatch):
    """The cells that were asked for."""
    asked = []
    monkeypatch.setattr(study, "fly", lambda *cell: (asked.append(cell[:3]), fly(*cell))[1])
    return asked


def test_the_map_is_flown_kept_and_told(tmp_path, flown, monkeypatch):
    monkeypatch.setattr(study, "MAP_DOGS", range(1, 6, 2))
    results = command.run(tmp_path, "skydog reproduce --herdability")
    for name in ("results.json", "cells.json", "herdability.md", "herdability.svg"):
        assert (tmp_path / name).stat().st_size > 0
    told = (tmp_path / "herdability.md").read_text()
    assert "skydog reproduce --herdability" in told
    assert summary(results).row_count == len(study.SHEEP)
    for row in results["rows"]:
        assert row[study.OURS]["fewest"] == max(1, row[study.RULE]["fewest"] - 1)
        assert row["faster"]["ratio"] == pytest.approx(3.0)
    assert results["lines"][study.RULE]["a"] == pytest.approx(1.0)
    cells = len(set(flown))
    monkeypatch.setattr(study, "fly", None)  # called again, nothing is flown
    assert command.run(tmp_path, "skydog reproduce --herdability") == results
    assert cells > 2 * len(study.SHEEP) * len(study.MAP_DOGS)


def test_cells_of_other_numbers_are_flown_anew(tmp_path, flown, monkeypatch):
    command.Kept(tmp_path / command.CELLS).cell("lama", 4, 2, 3, 100)
    assert command.Kept(tmp_path / command.CELLS).cells
    monkeypatch.setattr(study, "SEED", study.SEED + 1)
    assert not command.Kept(tmp_path / command.CELLS).cells


@pytest.mark.parametrize("damaged", ["", "[]", '{"asked"', '{"asked": {}}'])
def test_a_damaged_file_of_cells_is_flown_anew(tmp_path, flown, damaged):
    (tmp_path / command.CELLS).write_text(damaged)
    kept = command.Kept(tmp_path / command.CELLS)
    kept.cell("lama", 2, 1, 2, 20)
    again = command.Kept(tmp_path / command.CELLS)
    assert again.cells == kept.cells
    assert len(json.loads((tmp_path / command.CELLS).read_text())["cells"]) == 1


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (["--physical"], "--physical and --herdability are two studies"),
        (["--from-zoo"], "--herdability trains nothing"),
        (["--seeds", "2"], "--herdability trains nothing"),
        (["--on", "ray"], "--herdability trains nothing"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "why",
)
def test_what_does_not_go_with_a_study_that_trains_nothing_is_refused(
    skydog, monkeypatch, other, why
):
    monkeypatch.setattr(command, "run", None)  # a refusal that is missing would fly for hours
    code, _, said = skydog("reproduce", "--herdability", *other)
    assert code == 2
    assert why in said
