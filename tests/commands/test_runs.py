"""A run folder: what is written there, and by whom."""

import json
import shutil
import subprocess
import sys

import pytest

import skydog as package
from skydog import files
from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.study import evaluate
from skydog.study.paper import PRINTED
from skydog.world.presets import preset

TRAIN = ("train", "--steps", "100", "--out", "run")


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """The folder of a training, in which nobody changes anything."""
    folder = tmp_path_factory.mktemp("once")
    command = [sys.executable, "-m", "skydog.cli", *TRAIN]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / "run"


@pytest.fixture
def trained(once, tmp_path):
    shutil.copytree(once, tmp_path / "run")


def test_a_training_that_is_further_than_asked_for_is_refused_with_its_steps(trained, refused):
    told = refused("train", "--steps", "60", "--out", "run", "--resume")
    assert "trained for 100 steps already, more than the 60" in told


def test_a_training_that_goes_on_says_how_far_it_came(trained, skydog):
    assert skydog("train", "--steps", "160", "--out", "run", "--resume")[0] == 0
    assert store.read("run")[1]["steps_a_skill"] == 160


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--seed 3", "was trained with --seed 0, not 3"),
        ("--arena 5", "was trained with --arena 4.0, not 5.0"),
        ("--goal 4,4", "was trained with --goal 0.0,0.0, not 4.0,4.0"),
        ("--learner dqn", "was trained with --learner ddpg, not dqn"),
        ("--reward paper", "was trained with --reward progress, not paper"),
    ],
)
def test_another_training_is_refused_in_the_words_of_the_command_line(
    trained, refused, options, told
):
    assert told in refused(*TRAIN, "--resume", *options.split())


@pytest.mark.parametrize("command", [TRAIN, ("herd", "--steps", "10", "--out", "run")])
def test_a_finished_run_is_not_written_over(trained, refused, command):
    assert "add --resume, or choose another --out" in refused(*command)


@pytest.mark.parametrize(
    "command", [("train", "--seeds", "2"), ("train", "--seeds", "2", "--resume")]
)
def test_a_run_of_another_layout_is_not_put_beside_it(trained, refused, command):
    assert "run holds another training, collect" in refused(*command, "--out", "run")


def test_the_results_of_a_test_are_not_written_over(skydog, refused):
    test = ("test", "strombom", "--cases", "1", "--steps", "5", "--out", "run")
    assert skydog(*test)[0] == 0
    assert "run holds results already" in refused(*test)


def test_a_study_that_was_trained_is_not_written_over_by_the_zoo(refused, tmp_path):
    (tmp_path / "run" / "trainings").mkdir(parents=True)
    assert "choose another --out" in refused("reproduce", "--from-zoo", "--out", "run")


def test_a_folder_belongs_to_one_run_at_a_time(tmp_path):
    with files.claimed(tmp_path / "run") as run:
        with pytest.raises(Refusal, match="another run"), files.claimed(run):
            pass
        assert list(run.iterdir()) == []
    with files.claimed(run):
        pass


@pytest.mark.parametrize("command", ["train", "herd", "reproduce"])
def test_a_folder_where_another_run_is_at_work_is_refused(refused, tmp_path, command):
    with files.claimed(tmp_path / "run"):
        assert "another run is at work in run" in refused(command, "--out", "run")


def test_a_sheepdog_that_was_trained_in_another_way_is_not_called_as_the_papers(skydog, tmp_path):
    dog, _ = store.read("h-ddpg-4x4")
    cards = {"mine": {"name": "mine"}, "nameless": {}, "odd": {"name": "../../x\x1b[31m"}}
    for name, card in cards.items():
        store.save(tmp_path / f"{name}.safetensors", dog, card)
        code, out, _ = skydog("test", f"{name}.safetensors", "--cases", "1", "--out", f"to-{name}")
        assert code == 0
        assert "H-DDPG-4x4" not in out
        assert "the paper's own" not in out
        (row,) = json.loads((tmp_path / f"to-{name}" / "results.json").read_text())
        assert row == {"odd": "x--31m"}.get(name, name) + "-4x4"


@pytest.mark.parametrize(
    ("shepherd", "called", "sheep", "dogs", "name"),
    [
        ("strombom", None, 3, 1, "Strombom-4x4"),
        ("strombom", None, 46, 3, "Strombom-4x4-46-sheep-3-dogs"),
        ("h-ddpg-4x4", None, 3, 1, "H-DDPG-4x4"),
        ("h-ddpg-6x6", "H-DDPG-6x6", 3, 1, "H-DDPG-6x6to4x4"),
        ("h-ddpg-4x4", "H-DDPG-4x4-paper-reward", 3, 1, "H-DDPG-4x4-paper-reward"),
        ("h-ddpg-6x6", "H-DDPG-6x6-physical", 5, 1, "H-DDPG-6x6to4x4-physical-5-sheep"),
        ("h-ddpg-4x4", "H-DDPG-4x400", 3, 1, "H-DDPG-4x400-4x4"),
    ],
)
def test_a_row_says_who_flew_where_and_with_whom(shepherd, called, sheep, dogs, name):
    steers = package.Strombom() if shepherd == "strombom" else package.load(shepherd)
    found = evaluate.scenario(steers, preset("paper"), called, sheep, dogs)
    assert found == name
    assert (found in PRINTED) == (name in ("Strombom-4x4", "H-DDPG-4x4"))
