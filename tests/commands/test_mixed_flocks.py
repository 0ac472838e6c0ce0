import json

import pytest

from skydog.commands import mixed as command
from skydog.errors import Refusal
from skydog.study import mixed
from skydog.world import trace as traces


@pytest.fixture(scope="module")
def folder(unchecked, tmp_path_factory):
    """The study in its run folder, of few sheep and two missions a cell."""
    out = tmp_path_factory.mktemp("mixed")
    with pytest.MonkeyPatch.context() as few:
        for name, value in {
            "SHEEP": 4,
            "SHARES": (0.0, mixed.AIM, 1.0),
            "AIM": mixed.AIM,
            "CASES": 2,
            "MORE_CASES": 2,
            "NAMES": ("rearmost",),
            "THEIRS": "rearmost",
            "LESSER": {"rearmost": mixed.LESSER["rearmost"]},
            "FLOCKS": (4,),
            "GOALS": {"at the edge": (75.0, 0.0)},
            "ELSEWHERE": {"another": ("strombom2014", 100.0, 4)},
            "SIGHTS": {"80 m": mixed.SIGHTS["80 m"]},
            "HABITUATION": (0.001,),
            "STEPS": 2000,
        }.items():
            few.setattr(mixed, name, value)
        returned = command.run(out, "skydog reproduce --mixed")
    assert set(returned) == set(json.loads((out / "results.json").read_text()))
    return out


@pytest.fixture(scope="module")
def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_every_kind_is_flown_at_every_share_and_none_differs_at_zero(results):
    assert set(results["shares"]) == set(mixed.KINDS)
    for by_share in results["shares"].values():
        assert list(by_share) == ["0", "0.2", "1"]
        assert by_share["0"] == results["shares"]["loner"]["0"]
        assert by_share["1"]["rearmost"]["cases"] == 2


def test_loners_are_never_gathered_and_come_home_all_the_same(results):
    alone = results["why"]["all loners"]["rearmost"]
    assert alone["home"] == 4.0
    assert alone["gathered"] < 0.5 < results["why"]["no others"]["rearmost"]["gathered"]
    assert results["shares"]["loner"]["1"]["rearmost"]["success"] == 1.0


def test_the_page_has_the_figure_and_the_aim(folder):
    text = (folder / "mixed.md").read_text()
    assert "Made by `skydog reproduce --mixed`" in text
    assert "mixed.png" in text
    assert "| loner | 100 %" in text
    assert (folder / "mixed.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (folder / "report.html").read_text()


def test_the_folder_has_a_trace_whose_sheep_are_as_they_were_mixed(folder):
    trace, name = traces.load(folder / "traces" / "loners-rearmost.safetensors")
    assert name == "loners-rearmost"
    assert trace.world.flock.grouping.tolist() == pytest.approx([1.05] * 3 + [0.0])


def test_two_studies_at_once_are_refused():
    from skydog.commands.reproduce import reproduce

    with pytest.raises(Refusal, match="--patterns and --mixed are two studies"):
        reproduce(patterns=True, mixed=True)
