import json

import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.study import bench, board, board_page


def row(name="a dog", **tasks):
    made = board.blank(name, "rule", f"skydog bench {name}", "—")
    made["tasks"] = tasks
    return made


def figures(task, success, steps):
    return {
        "success": success,
        "success_ci95": [success / 2, 1.0],
        "cases": 2,
        "steps": {"mean": steps},
        "each": {"success": [success == 1.0, success > 0.0], "steps": [steps, steps]},
        "cases of": bench.digest(task),
    }


def test_the_file_holds_the_cases_of_every_task_and_no_others():
    bench.check()
    found = {name.rpartition("/")[0] for name in bench._cases()}
    assert found == set(bench.TASKS)


@pytest.mark.parametrize("name", ["paper-4m", "goal-centre"])
def test_the_cases_are_those_that_the_task_draws(name):
    task = bench.TASKS[name]
    drawn, kept = task.draw(task.world()), bench.cases(name)
    np.testing.assert_allclose(drawn.sheep, kept.sheep, atol=1e-5)
    np.testing.assert_allclose(drawn.dogs, kept.dogs, atol=1e-5)


def test_a_file_of_other_cases_is_refused(tmp_path, monkeypatch):
    other = tmp_path / "bench.safetensors"
    other.write_bytes(bench.FILE.read_bytes()[:-1] + b"x")
    monkeypatch.setattr(bench, "FILE", other)
    bench._cases.cache_clear()
    with pytest.raises(Refusal, match="is damaged"):
        bench.check()
    monkeypatch.undo()
    bench._cases.cache_clear()


def test_a_row_comes_back_as_it_was_written(tmp_path):
    mine = row(
        "my.py:Dog",
        gate=figures("gate", 1.0, 100.0),
        maze={"refused": "no", "cases of": bench.digest("maze")},
    )
    board.save(tmp_path, mine)
    assert board.rows(tmp_path) == {"my.py:Dog": mine}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda row: row.update(version=0), "of version 0"),
        (lambda row: row.update(shepherd=3), "no row"),
        (lambda row: row.update(tasks=[]) or row.pop("command"), "no row"),
        (lambda row: row["tasks"]["gate"].update(success="all"), "no row"),
        (lambda row: row["tasks"]["gate"]["steps"].update(mean=5.2), "no row"),
        (lambda row: row["tasks"]["gate"].update({"cases of": "0"}), "other cases of 'gate'"),
        (lambda row: row["tasks"].update(gates=row["tasks"]["gate"]), "other cases of 'gates'"),
    ],
    ids=["version", "name", "missing", "number", "edited", "cases", "task"],
)
def test_a_row_that_cannot_be_compared_is_refused(tmp_path, change, why):
    mine = row(gate=figures("gate", 1.0, 100.0))
    change(mine)
    file = tmp_path / "row.json"
    file.write_text(json.dumps(mine))
    with pytest.raises(Refusal, match=why):
        board.read(file)


def test_a_row_does_not_replace_that_of_another_shepherd(tmp_path):
    board.save(tmp_path, row("a/b.py:dog", gate=figures("gate", 1.0, 100.0)))
    board.check_names(tmp_path, ["a/b.py:dog", "c.py:dog"])
    with pytest.raises(Refusal, match=r"is the row of a/b\.py:dog, not of a-b\.py:dog"):
        board.check_names(tmp_path, ["a-b.py:dog"])
    with pytest.raises(Refusal, match=r"is the row of c\.py:dog, not of \./c\.py:dog"):
        board.check_names(tmp_path, ["c.py:dog", "./c.py:dog"])


def test_who_does_not_accomplish_a_task_is_never_the_best_known():
    rows = {
        "fast": row("fast", gate=figures("gate", 0.5, 10.0)),
        "slow": row("slow", gate=figures("gate", 1.0, 100.0)),
    }
    assert board.best_known("gate", rows) == (100.0, "slow")
    assert board.best_known("maze", rows) is None
    known = board.best_known("paper-4m", rows)
    assert known is not None
    steps, who = known
    assert who == "planner"
    assert 0 < steps < 100


def test_the_page_tells_what_was_not_run_and_why():
    rows = {
        "good": row("good", gate=figures("gate", 1.0, 100.0)),
        "bad": row(
            "bad",
            gate=figures("gate", 0.5, 150.0),
            maze={"refused": "it sees 3 sheep", "cases of": bench.digest("maze")},
        ),
    }
    page = board_page.document(rows, "skydog bench good bad")
    assert "`good` | 1 of" in page
    assert "50 % [25, 100], 150 (×1.50)" in page
    assert "- `bad`: maze (it sees 3 sheep)" in page
    assert page.index("`good`") < page.index("`bad`")


def test_a_task_that_there_is_not_is_refused():
    with pytest.raises(Refusal, match="no task is called 'gat'"):
        bench.chosen(["gat"])
    assert bench.chosen(None) == list(bench.TASKS)
