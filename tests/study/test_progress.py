"""How good a sheepdog was while it learnt."""

import csv
import io

import equinox as eqx
import jax.numpy as jnp
import pytest

from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, progress
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
