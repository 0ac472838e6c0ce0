"""Goals, starts and the gate of `skydog test`, and what a sheepdog says of them."""

import json

import jax
import pytest

from skydog.shepherds import store
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import Sheepdog
from skydog.world import trace as traces


def test_a_sheepdog_says_what_it_was_not_taught_for_and_flies_all_the_same(skydog, tmp_path):
    actor = Actor(4, 2, (6,), jax.random.key(0))
    card = {"taught_for": {"goals": [0.0, 0.0], "arenas": [3.0, 5.0], "sheep": 3}}
    store.save(tmp_path / "dog" / store.FILE, Sheepdog(actor, actor, 4.0, "paper"), card)
    code, _, err = skydog("test", "dog", "--cases", "1", "--json")
    assert (code, "taught" in err) == (0, False)
    asked = ["--goal", "6,6", "--arena", "6", "--cases", "1", "--json"]
    code, out, err = skydog("test", "dog", *asked)
    assert code == 0
    assert "for the goal 0,0, not 6,6; for arenas of 3 to 5 m, not 6 m" in err
    assert json.loads(out)["cases"] == 1
    assert "not 6,6" in skydog("export", "dog", "--onnx", "--goal", "6,6", "--arena", "6")[2]


def test_any_goal_and_starts_anywhere_are_flown_and_no_row_of_the_papers(skydog):
    asked = ["--goal", "0,4", "--starts", "anywhere", "--cases", "5"]
    code, out, _ = skydog("test", "h-ddpg-4x4", *asked)
    assert code == 0
    assert "100 %" in out
    assert "paper's own" not in out
    assert "paper's own" not in skydog("test", "strombom", "--cases", "2", "--goal", "4,4")[1]


@pytest.mark.parametrize(
    ("asked", "nearness", "beside"),
    [
        ([], 0.0, True),
        (["--goal", "0,0"], 0.0, True),
        (["--nearness", "0"], 0.0, True),
        (["--nearness", "1"], 1.0, False),
        (["--goal", "4,4"], 1.0, False),
        (["--starts", "random"], 1.0, False),
        (["--preset", "paper-w05"], 1.0, False),
    ],
)
def test_rows_beside_the_papers_own_are_flown_with_its_gate_and_no_others(
    skydog, tmp_path, asked, nearness, beside
):
    code, out, _ = skydog("test", "strombom", "--cases", "1", "--steps", "5", "--out", "o", *asked)
    assert code == 0
    assert ("the paper's own" in out) == beside
    (file,) = (tmp_path / "o" / "traces").iterdir()
    assert float(traces.load(file)[0].world.dog.nearness) == nearness


def test_missions_that_are_over_where_they_start_are_said_to_be(skydog):
    _, _, err = skydog("test", "strombom", "--goal", "2,2", "--cases", "3", "--json")
    assert "3 of 3 missions are accomplished at the start; try --starts anywhere" in err
    assert "at the start" not in skydog("test", "strombom", "--cases", "3", "--json")[2]


def test_the_sheepdog_of_the_papers_frame_stands_beside_the_paper(skydog):
    assert "the paper's own" in skydog("test", "h-ddpg-4x4-paper-frame", "--cases", "2")[1]
