"""The main job from end to end, small: one run for all tests of this file."""

import json
import re
import subprocess
import sys

import equinox as eqx
import jax
import pytest

from skydog.commands import training
from skydog.learning import train
from skydog.learning.curriculum import Curriculum

CURRICULUM = Curriculum(steps=2_000)
SKYDOG = [sys.executable, "-m", "skydog.cli"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run folder, and what the command printed."""
    out = tmp_path_factory.mktemp("run") / "herd"
    command = [*SKYDOG, "herd", "--steps", "2000", "--cases", "3", "--json", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return out, json.loads(done.stdout)


def test_the_results_of_both_shepherds_are_printed_and_written(run):
    out, printed = run
    assert json.loads((out / "results.json").read_text()) == printed
    assert {"H-DDPG-4x4", "Strombom-4x4"} <= printed.keys()
    for row in printed.values():
        assert 0.0 <= row["success"] <= 1.0
        assert row["cases"] == 3
        for figure in ("steps", "steps_gcm", "distance"):
            low, high = row[figure]["ci95"]
            assert low <= row[figure]["mean"] <= high
            assert row[figure]["sd"] >= 0.0


def test_a_run_folder_holds_everything(run):
    out, printed = run
    found = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert found == {
        "sheepdog.safetensors",
        "sheepdog.md",
        "learning_curves.png",
        "learning_curves.svg",
        "trajectories.png",
        "trajectories.svg",
        "report.html",
        "results.json",
        "results.md",
        "progress.csv",
        *(f"{s}/{f}" for s in CURRICULUM.skills for f in ("checkpoint.safetensors", "curve.csv")),
        *(f"traces/{name}.safetensors" for name in printed),
    }


@pytest.mark.parametrize("skill", CURRICULUM.skills)
def test_a_worker_teaches_what_is_taught_in_process_with_its_seed(run, skill):
    out, _ = run
    task = CURRICULUM.lesson(skill)
    seed = 1 if skill == "drive" else 0
    here, _ = train.train(task, CURRICULUM.config(), seed, CURRICULUM.steps)
    sheepdog, histories = training.fuse(CURRICULUM, out, 0)
    assert len(histories[skill].length) == 40
    for mine, theirs in zip(
        jax.tree.leaves(here.agent.skill), jax.tree.leaves(getattr(sheepdog, skill)), strict=True
    ):
        assert (mine == theirs).all()


def test_the_sheepdog_on_the_way_is_the_untaught_one_and_at_the_end_itself(run):
    out, _ = run
    sheepdog, histories = training.fuse(CURRICULUM, out, 0)
    dogs = training.on_the_way(CURRICULUM, sheepdog, histories)
    assert list(dogs) == [0, CURRICULUM.steps]
    assert dogs[CURRICULUM.steps] is sheepdog
    for seed, skill in enumerate(CURRICULUM.skills):
        _, key = jax.random.split(jax.random.key(seed))
        task = CURRICULUM.lesson(skill)
        untaught = train.init(task, CURRICULUM.config(), key).agent.skill
        assert eqx.tree_equal(getattr(dogs[0], skill), untaught)
    lines = (out / "progress.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["step", "0", "2000"]


def test_the_report_shows_first_what_moves(run):
    out, _ = run
    page = (out / "report.html").read_text()
    assert re.findall(r"<h2>(.*?)</h2>", page) == [
        "Replay",
        "An untaught and a taught dog",
        "Results",
        "Learning",
        "Paths",
        "Notes",
    ]
    shown = re.findall(r'<script type="application/json">(.*?)</script>', page)
    untaught, taught = (json.loads(missions)[0] for missions in shown[1:])
    assert (untaught["name"], taught["name"]) == (
        "after 0 training steps",
        "after 2,000 training steps",
    )
    assert untaught["extent"] == taught["extent"]
    for part in ("sheep", "dogs"):
        assert untaught[part][0] == taught[part][0]
        assert len(untaught[part]) <= 251


def test_a_sheepdog_that_was_written_is_flown_again_to_the_same_figures(run):
    out, printed = run
    done = subprocess.run(
        [*SKYDOG, "test", str(out), "--cases", "3", "--json"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    again, first = json.loads(done.stdout), printed["H-DDPG-4x4"]
    assert again.keys() == first.keys()
    # To rounding: `test` records the sheep at the start and at the end alone.
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(first), strict=True):
        assert one == pytest.approx(other, rel=1e-5, abs=1e-6)
