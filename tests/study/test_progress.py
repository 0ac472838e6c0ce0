"""How good a sheepdog was while it learnt."""

import csv
import io

import equinox as eqx
import jax.numpy as jnp
import pytest

from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, progress
from skydog.world.presets import preset


class Still(eqx.Module):
    """A dog that has learnt nothing."""

    def __call__(self, world, state):
        return jnp.zeros_like(state.dogs)


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(progress, "CASES", 4)


def test_dogs_are_measured_on_the_same_cases_as_the_rule_dog(few):
    dogs = {5_000: Strombom(), 0: Still()}
    rows, rule = progress.fly_all(preset("paper"), dogs, 3, evaluate.fly)
    assert list(rows) == [0, 5_000]
    assert rows[5_000] == rule
    assert rows[0]["success"] < rule["success"] == 1.0
    assert rows[0]["steps"]["mean"] > rule["steps"]["mean"]
    untaught = round(4 * rows[0]["success"])
    assert progress.told(rows, rule) == (
        f"Missions accomplished, sheep anywhere: untaught {untaught} of 4, after 5,000 steps "
        "4 of 4; the rule dog 4 of 4."
    )
    first, last = csv.DictReader(io.StringIO(progress.csv(rows)))
    assert (first["step"], last["step"]) == ("0", "5000")
    low, high = rule["success_ci95"]
    assert float(last["success_low"]) == pytest.approx(low)
    assert float(last["success_high"]) == pytest.approx(high)
    assert float(last["steps"]) == pytest.approx(rule["steps"]["mean"], rel=1e-5)


def test_of_a_long_training_fewer_steps_are_flown_with_the_first_and_the_last(few, monkeypatch):
    monkeypatch.setattr(progress, "MOST", 3)
    dogs = dict.fromkeys(range(0, 36_000, 5_000), Strombom())
    rows, _ = progress.fly_all(preset("paper"), dogs, 3, evaluate.fly)
    assert list(rows) == [0, 15_000, 30_000, 35_000]


def test_an_evaluation_flies_the_same_missions_when_it_is_due_and_knows_the_best(tmp_path):
    world = preset("paper")
    kept = tmp_path / "evaluation.csv"
    evaluation = progress.Evaluation(world, cases.cases(world, 4, "anywhere", 3), 1_000, kept)
    assert str(evaluation) == "no missions flown yet"
    first = evaluation(0, Still())
    assert first is not None
    assert first["success"] < 1.0
    assert evaluation(999, Strombom()) is None
    good = evaluation(1_064, Strombom())
    assert good is not None
    assert evaluation(1_999, Strombom()) is None
    evaluation(2_000, Still())
    assert list(evaluation.rows) == [0, 1_064, 2_000]
    assert evaluation.rows[2_000] == evaluation.rows[0]
    assert evaluation.rows[evaluation.best] == good
    assert str(evaluation).endswith(
        f"best so far after 1,064: 4 of 4, {good['steps']['mean']:.0f} steps each"
    )
    assert kept.read_text() == progress.csv(evaluation.rows)


def test_of_equal_successes_the_fewest_steps_are_best():
    world = preset("paper")
    evaluation = progress.Evaluation(world, cases.cases(world, 4, "anywhere", 3), 1)
    evaluation(0, Still())
    for step, mean in ((1, 90.0), (2, 80.0), (3, 85.0)):
        evaluation.rows[step] = {**evaluation.rows[0], "success": 1.0, "steps": {"mean": mean}}
    assert evaluation.best == 2


@pytest.mark.parametrize("every", [0, -1, 1.5, True, "often"])
def test_an_evaluation_that_is_never_due_is_refused(unchecked, every):
    world = preset("paper")
    with pytest.raises(Refusal, match="every is a whole number of steps"):
        progress.Evaluation(world, cases.cases(world, 4, "anywhere", 3), every)
