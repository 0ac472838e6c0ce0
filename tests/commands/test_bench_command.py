import json

from skydog.study import bench as benchmark


def edit(figures):
    figures["steps"]["mean"] = 1234.0
    figures["each"]["steps"] = [1234.0] * figures["cases"]


def test_a_shepherd_gets_a_row_and_a_leaderboard_and_goes_on_where_it_was(skydog, tmp_path):
    out = tmp_path / "bench"
    asked = ("bench", "strombom", "--tasks", "paper-4m", "--out", str(out))
    code, printed, _ = skydog(*asked, "--json")
    assert code == 0
    row = json.loads(printed)["strombom"]
    assert row["tasks"]["paper-4m"]["success"] == 1.0
    assert row["tasks"]["paper-4m"]["cases of"] == benchmark.digest("paper-4m")
    page = (out / "leaderboard.md").read_text()
    assert "`strombom`" in page
    # What is flown already is not flown again.
    edit(row["tasks"]["paper-4m"])
    (out / "strombom.json").write_text(json.dumps(row))
    code, printed, _ = skydog(*asked)
    assert code == 0
    assert "1234" in printed


def test_a_task_or_a_shepherd_that_there_is_not_is_refused(skydog, tmp_path):
    out = str(tmp_path / "bench")
    code, _, said = skydog("bench", "strombom", "--tasks", "gats", "--out", out)
    assert code == 2
    assert "no task is called 'gats'" in said
    code, _, said = skydog("bench", "strombum", "--out", out)
    assert code == 2
    assert "strombum" in said


def test_a_shepherd_whose_file_has_changed_is_flown_anew(skydog, tmp_path):
    code = "from skydog.shepherds.strombom import Strombom\n\ndog = Strombom()\n"
    (tmp_path / "own.py").write_text(code)
    name, out = f"{tmp_path / 'own.py'}:dog", tmp_path / "bench"
    asked = ("bench", name, "--tasks", "paper-4m", "--out", str(out), "--json")
    assert skydog(*asked)[0] == 0
    (file,) = out.glob("*.json")
    row = json.loads(file.read_text())
    edit(row["tasks"]["paper-4m"])
    file.write_text(json.dumps(row))
    (tmp_path / "own.py").write_text(code + "# another dog\n")
    again = json.loads(skydog(*asked)[1])[name]
    assert again["tasks"]["paper-4m"]["steps"]["mean"] < 1000.0


def test_a_shepherd_that_fails_is_told_in_one_line(skydog, tmp_path):
    (tmp_path / "own.py").write_text("def dog(world, state):\n    raise ValueError('broken')\n")
    for name in ("own.py:dog", "./own.py:dog"):
        code, _, said = skydog("bench", name, "--tasks", "paper-4m, gate", "--out", "bench")
        assert code == 2
        assert f"{name} flies none of the tasks" in said
        assert "failed in line 2: ValueError: broken" in said
    assert not list((tmp_path / "bench").glob("*.json"))
