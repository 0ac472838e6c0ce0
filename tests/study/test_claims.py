import numpy as np
import pytest

from skydog.study import claims
from skydog.study.claims import Claim, Less, MoreSuccess
from skydog.study.statistics import share

CASES = 30
NOISE = np.random.default_rng(0).normal(0.0, 30.0, CASES)


def flown(offset, successes=CASES):
    """The same cases, each so many steps longer, give or take one."""
    steps = 200.0 + NOISE + offset + np.sin(np.arange(CASES))
    return {"steps": steps, "success": (np.arange(CASES) < successes).astype(float)}


MEASURED = {
    "one": flown(0.0),
    "same": {**flown(0.0, 27), "steps": 200.0 + NOISE},
    "slower": flown(9.0, 20),
}


@pytest.mark.parametrize(
    ("less", "more", "outcome"), [("one", "slower", 1), ("slower", "one", -1), ("one", "same", 0)]
)
def test_a_comparison_is_decided_case_by_case(less, more, outcome):
    found, told = Less("steps", less, more).compare(MEASURED)
    assert found == outcome
    assert less in told
    assert f"{np.mean(MEASURED[more]['steps']):.0f}" in told


@pytest.mark.parametrize(
    ("more", "less", "outcome"), [("one", "slower", 1), ("slower", "one", -1), ("one", "same", 0)]
)
def test_success_is_decided_by_the_cases_that_one_alone_accomplishes(more, less, outcome):
    found, told = MoreSuccess(more, less).compare(MEASURED)
    assert found == outcome
    assert f"{more} accomplishes {MEASURED[more]['success'].sum():.0f} of 30 missions" in told


@pytest.mark.parametrize(
    ("outcomes", "paper", "ours"),
    [
        ([1, 1], "reproduced", "holds"),
        ([1, 0], "reproduced in part", "holds in part"),
        ([1, -1], "reproduced in part", "holds in part"),
        ([-1, -1], "not reproduced", "does not hold"),
        ([0, -1], "not reproduced", "does not hold"),
        ([0, 0], "undecided", "undecided"),
    ],
)
def test_a_claim_is_reproduced_if_every_comparison_of_it_is(outcomes, paper, ours):
    assert claims.judged("H-DDPG beats Strömbom", outcomes) == paper
    assert claims.judged(claims.BEYOND + "fewer steps", outcomes) == ours


@pytest.mark.parametrize(("first", "word"), [("one", "reproduced"), ("slower", "not reproduced")])
def test_what_is_compared_is_what_the_verdict_is_on(monkeypatch, first, word):
    other = "slower" if first == "one" else "one"
    both = (Less("steps", first, other), MoreSuccess(first, other))
    monkeypatch.setattr(claims, "CLAIMS", (Claim("a title", "what it says", both),))
    (found,) = claims.compared(MEASURED)
    assert found.verdict == word


def test_on_the_three_metrics_means_steps_distance_and_success():
    (three,) = (claim for claim in claims.CLAIMS if "three metrics" in claim.says)
    metrics = {getattr(one, "metric", "success") for one in three.comparisons}
    assert metrics == {"steps_gcm", "distance", "success"}


def row(successes, cases=CASES):
    found, interval = share(successes, cases)
    return {"success": found, "success_ci95": interval, "cases": cases}


@pytest.mark.parametrize(
    ("learnt", "word"),
    [((30, 1000), "compatible"), ((29, 999), "compatible"), ((24, 800), "not reproduced")],
)
def test_a_success_of_every_mission_is_tested_in_each_scenario(learnt, word):
    rows = {name: row(30) for name in ("Strombom-4x4", "DHRL-4x4", "H-DDPG-4x4")}
    random = {name: row(1000, 1000) for name in rows}
    rows["H-DDPG-4x4"], random["H-DDPG-4x4"] = row(learnt[0]), row(learnt[1], 1000)
    found, _ = claims.accomplished(rows, random)
    assert found.verdict == word
    assert f"H-DDPG-4x4: {learnt[0]} of 30" in found.found
    assert f"{learnt[1]:,} of 1,000" in found.found
    assert "Strombom" not in found.found


@pytest.mark.parametrize(
    ("first", "random", "word"),
    [
        (0, 0, "not reproduced"),
        (29, 967, "compatible"),
        (30, 970, "compatible"),
        (30, 1000, "not reproduced"),  # of 1,030 none fails: not one in thirty
    ],
)
def test_one_failure_in_thirty_is_neither_none_nor_thirty(first, random, word):
    rows = {"Strombom-4x4": row(29), "Strombom-6x6": row(first)}
    others = {"Strombom-4x4": row(967, 1000), "Strombom-6x6": row(random, 1000)}
    assert claims.accomplished(rows, others)[1].verdict == word


@pytest.mark.parametrize(("plain", "word"), [(239, "compatible"), (200, "not reproduced")])
def test_carrying_over_is_judged_by_the_lessons_that_the_paper_has(plain, word):
    whole = dict.fromkeys(("6", *claims.FURTHER), row(240, 240))
    moved = {
        claims.ONE_SCALE: {"6": row(plain, 240), **dict.fromkeys(claims.FURTHER, row(20, 240))},
        claims.ALL_SCALES: whole,
        claims.FOLDED: whole,
    }
    assert claims.carried_over(moved)[0].verdict == word
    assert claims.carried_over({}) == []


EPISODES = np.arange(10, 210, 10)


def curves(early, late):
    """Three seeds: 0.02 in the first ten episodes, `early` up to 100, then `late`."""
    reward = np.where(EPISODES <= 10, 0.02, np.where(EPISODES <= 100, early, late))
    return [(EPISODES, reward + wobble) for wobble in (-0.001, 0.0, 0.001)]


@pytest.mark.parametrize(
    ("models", "word"),
    [
        ([curves(0.09, 0.09)], "reproduced"),
        ([curves(0.02, 0.09)], "reproduced in part"),  # it rises too late
        ([curves(0.09, 0.01)], "reproduced in part"),  # and falls again
        ([curves(0.09, 0.09), curves(0.01, 0.01)], "reproduced in part"),
        ([curves(0.01, 0.01)], "not reproduced"),
        ([curves(0.09, 0.09)[:1]], "undecided"),  # one seed may be luck
    ],
)
def test_learning_is_judged_by_its_rise_and_by_its_end(models, word):
    for model in models:  # or the rises of all seeds would be one number
        model[0][1][0] -= 0.005
    (found,) = claims.learnt({f"skill {i}": model for i, model in enumerate(models)})
    assert found.verdict == word
    assert f"{np.mean([reward[-1] for _, reward in models[0]]):.3f}" in found.found


def test_lessons_too_short_for_a_curve_are_not_judged():
    assert claims.learnt({"drive": [(np.zeros(0), np.zeros(0))]}) == []


def goals(worst: int, name: str = "H-DDPG-4x4"):
    def cell(successes: int):
        found = row(successes, 1000)
        return {**found, "failed": 1000 - successes, "steps": {"mean": 90.0}}

    return {f"{name}, 4 m": {"corner 0,0": cell(1000), "centre": cell(worst)}}


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        (goals(998), "holds"),
        (goals(992), "holds in part"),  # [98.4 %, 99.6 %]: unsure to one goal
        (goals(900), "holds in part"),
        (goals(900, "DHRL-4x4"), "holds in part"),
        (goals(1000) | goals(100, "H-DDPG-4x4-paper-frame"), "holds"),
        (goals(1000) | goals(100, "Strombom"), "holds"),
    ],
)
def test_a_sheepdog_herds_to_any_goal_if_it_does_to_the_worst(rows, word):
    (found,) = claims.any_goal(rows)
    assert found.verdict == word
    assert "to the corners" in found.found
    if word != "holds":
        assert "(centre)" in found.found


def test_a_sheepdog_that_herds_to_no_goal_does_not_hold():
    rows = {"H-DDPG-4x4, 4 m": {"corner 0,0": goals(900)["H-DDPG-4x4, 4 m"]["centre"]}}
    assert claims.any_goal(rows)[0].verdict == "does not hold"
