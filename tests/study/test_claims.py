import numpy as np
import pytest

from skydog.study import claims
from skydog.study.claims import Claim, Less

CASES = 30
NOISE = np.random.default_rng(0).normal(0.0, 30.0, CASES)


def flown(offset):
    """The same cases, each so many steps longer, give or take one."""
    return {"steps": 200.0 + NOISE + offset + np.sin(np.arange(CASES))}


MEASURED = {"one": flown(0.0), "same": {"steps": 200.0 + NOISE}, "slower": flown(9.0)}


@pytest.mark.parametrize(
    ("less", "more", "verdict"),
    [
        ("one", "slower", "reproduced"),
        ("slower", "one", "not reproduced"),
        ("one", "same", "undecided"),
    ],
)
def test_a_comparison_is_decided_case_by_case(less, more, verdict):
    held, told = Less("steps", less, more).holds(MEASURED)
    assert held == verdict
    assert less in told
    assert f"{np.mean(MEASURED[more]['steps']):.0f}" in told


@pytest.mark.parametrize(
    ("pairs", "verdict"),
    [
        ([("one", "slower"), ("same", "slower")], "reproduced"),
        ([("one", "slower"), ("slower", "one")], "reproduced in part"),
        ([("slower", "one"), ("slower", "same")], "not reproduced"),
        ([("slower", "one"), ("one", "same")], "not reproduced"),
        ([("one", "same")], "undecided"),
    ],
)
def test_a_claim_is_reproduced_if_every_comparison_of_it_is(monkeypatch, pairs, verdict):
    comparisons = tuple(Less("steps", less, more) for less, more in pairs)
    monkeypatch.setattr(claims, "CLAIMS", (Claim("a title", "what it says", comparisons),))
    (found,) = claims.compared(MEASURED)
    assert found.verdict == verdict


def row(successes, cases=CASES):
    from skydog.study.statistics import share

    found, interval = share(successes, cases)
    return {"success": found, "success_ci95": interval, "cases": cases}


def test_the_learnt_dogs_must_all_accomplish_everything():
    rows = {"Strombom-4x4": row(30), "DHRL-4x4": row(30), "H-DDPG-4x4": row(29)}
    random = {name: row(990, 1000) for name in rows}
    learnt, rule = claims.accomplished(rows, random)
    assert learnt.verdict == "not reproduced"
    assert "H-DDPG-4x4: 29 of 30" in learnt.found
    assert "990 of 1,000" in learnt.found
    assert "Strombom" not in learnt.found
    assert rule.verdict == "reproduced"
    rows["H-DDPG-4x4"] = row(30)
    assert claims.accomplished(rows, random)[0].verdict == "reproduced"


@pytest.mark.parametrize(("plain", "verdict"), [(240, "reproduced"), (200, "not reproduced")])
def test_carrying_over_is_judged_by_the_lessons_that_the_paper_has(plain, verdict):
    moved = {
        claims.ONE_SCALE: {"6": row(plain, 240), **dict.fromkeys(claims.FURTHER, row(20, 240))},
        claims.ALL_SCALES: dict.fromkeys(("6", *claims.FURTHER), row(240, 240)),
    }
    assert claims.carried_over(moved)[0].verdict == verdict
    assert claims.carried_over({}) == []


def test_learning_is_judged_by_the_end_of_its_curves():
    episodes = np.arange(10, 210, 10)
    risen = (episodes, np.where(episodes < 100, 0.02, 0.09))
    fallen = (episodes, np.where(episodes < 150, 0.09, 0.01))
    assert claims.learnt({"drive": [risen, risen]})[0].verdict == "reproduced"
    assert claims.learnt({"drive": [fallen, fallen]})[0].verdict == "not reproduced"
    both = claims.learnt({"drive": [risen], "collect": [fallen]})[0]
    assert both.verdict == "reproduced in part"
    assert "0.090" in both.found
    nothing = (np.zeros(0), np.zeros(0))
    assert claims.learnt({"drive": [nothing]}) == []


def goals(worst: float, name: str = "H-DDPG-4x4"):
    cell = {"cases": 1000, "steps": {"mean": 90.0}}
    cells = {
        "corner 0,0": {**cell, "success": 1.0, "failed": 0},
        "centre": {**cell, "success": worst, "failed": round(1000 * (1 - worst))},
    }
    return {f"{name}, 4 m": cells}


@pytest.mark.parametrize(
    ("rows", "verdict"),
    [
        (goals(0.999), "reproduced"),
        (goals(0.998), "not reproduced"),
        (goals(0.99, "DHRL-4x4"), "reproduced"),
        (goals(0.98, "DHRL-4x4"), "not reproduced"),
        (goals(1.0) | goals(0.1, "H-DDPG-4x4-paper-frame"), "reproduced"),
        (goals(1.0) | goals(0.1, "Strombom"), "reproduced"),
    ],
)
def test_a_sheepdog_herds_to_any_goal_if_it_does_to_the_worst(rows, verdict):
    (found,) = claims.any_goal(rows)
    assert found.verdict == verdict
    assert "to the corners" in found.found
    if verdict == "not reproduced":
        assert "(centre)" in found.found
