"""The study from end to end, of very short trainings."""

import numpy as np
import pytest
from studies import assert_whole

from skydog.commands import reproduce, training, zoo
from skydog.commands.zoo import Plan
from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.study import evaluate, robustness, scenarios, statistics, transfer
from skydog.study.reproduction import NATIVE, SCALED, UNSCALED

SMALL = Plan(seeds=1, episodes=20)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study of very short trainings, in few arenas: its folder and results."""
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "ARENAS", (4.0, 5.0, 6.0))
        patch.setattr(zoo, "CHOSEN_IN", dict.fromkeys(zoo.CHOSEN_IN, (4.0,)))
        patch.setattr(zoo, "CHOSEN_BY", 2)
        few = {
            "MISSIONS": 4,
            "MISSIONS_ANYWHERE": 4,
            "FLOCKS": (3,),
            "TO_GOALS": {4.0: ("H-DDPG-4x4", "H-DDPG-4x4-paper-frame")},
            "FROM_ANYWHERE": ("H-DDPG-4x4",),
        }
        for name, value in few.items():
            patch.setattr(robustness, name, value)
        patch.setattr(statistics, "RESAMPLES", 999)
        yield out, reproduce.run(out, SMALL, False, "skydog reproduce --seeds 1", evaluate.fly)


def test_every_scenario_is_trained_flown_and_told(study):
    out, results = study
    assert_whole(out, results)
    assert results["transfer"].keys() == {SCALED, UNSCALED, NATIVE}
    assert all(line.keys() == {"4", "5", "6"} for line in results["transfer"].values())


def test_what_was_trained_is_not_trained_again(study):
    out, results = study
    checkpoints = {
        path: path.stat().st_mtime_ns for path in out.rglob("trainings/**/checkpoint.safetensors")
    }
    assert len(checkpoints) == 2 * (len(SMALL.curricula()) + 1)
    trained = zoo.fuse(SMALL, out, evaluate.fly)
    dogs = {name: seeds[0] for name, seeds in trained.dogs.items()}
    name, flight = next(iter(scenarios.flights(dogs).items()))
    first, random, _ = scenarios.fly_one(flight, evaluate.fly)
    again = scenarios.row(name, flight, {name: first}, {name: random})
    assert again["ours"] == results["rows"][name]["ours"]
    assert {path: path.stat().st_mtime_ns for path in checkpoints} == checkpoints


def test_another_plan_in_the_same_folder_trains_on_but_never_another_kind(study):
    out, _ = study
    folder = out / "trainings" / "H-DDPG-4x4" / "seed-0"
    curriculum = SMALL.curriculum(4.0, one_scale=True)
    with pytest.raises(Refusal, match="one_scale"):
        training.fuse(curriculum, folder, 0)


def test_the_zoo_is_what_the_study_wrote(study):
    out, results = study
    for name in zoo.CHOSEN_IN:
        dog, card = store.read(out / "zoo" / f"{name.lower()}.safetensors")
        assert card["name"] == name
        assert card["command"] == "skydog reproduce --seeds 1 --episodes 20"
        assert card["seed"] == 0
        row = (results["rows"] | results["others"])[scenarios.row_of(name)]
        assert card["results"][f"{name} steps"] == row["ours"]["steps"]["mean"]
        assert f"{dog.arena:g}x{dog.arena:g}" in name
        assert dog.frame == ("paper" if name.endswith(scenarios.PAPER_FRAME) else "folded")
        assert (card["taught_for"]["goals"] == "anywhere") == (dog.frame == "folded")


def test_learning_curves_survive_their_table(tmp_path):
    episodes = np.array([10.0, 20.0, 30.0])
    curves = {
        "a drive": [(episodes, np.array([0.25, -0.5, 0.125])), (episodes[:1], np.array([0.5]))],
        "b collect": [(episodes[:2], np.array([1.0, 2.0]))],
    }
    (tmp_path / "curves.csv").write_text(zoo._curves_as_csv(curves))
    again = zoo._read_curves(tmp_path / "curves.csv")
    assert again.keys() == curves.keys()
    for name, seeds in curves.items():
        for one, other in zip(seeds, again[name], strict=True):
            np.testing.assert_array_equal(one, other)
