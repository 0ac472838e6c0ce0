import pytest

from skydog.study import paper
from skydog.study.verdict import RULES, verdict, verdicts

PRINTED = {
    "success": 29 / 30,
    "steps": {"mean": 100, "sd": 16},
    "distance": {"mean": 10.0, "sd": 1.5},
}


def ours(steps=100.0, distance=10.0, successes=30):
    return {
        "success": successes / 30,
        "cases": 30,
        "steps": {"mean": 0.0, "sd": 1.0},
        "steps_gcm": {"mean": steps, "sd": 16.0},
        "distance": {"mean": distance, "sd": 1.5},
    }


def test_figures_that_no_test_tells_apart_are_compatible():
    held = verdicts(ours(), PRINTED)
    assert held == dict.fromkeys(("success", "steps", "distance"), "compatible")
    assert verdict(held) == "compatible"


# Two means of 30 with an SD of 16 differ from 2.0017 · 16 · √(2 / 30) on: Student's t, 58 degrees.
REACH = 8.270


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        (100.0 - REACH - 0.01, "better"),
        (100.0 - REACH + 0.01, "compatible"),
        (100.0 + REACH - 0.01, "compatible"),
        (100.0 + REACH + 0.01, "worse"),
    ],
)
def test_steps_are_better_or_worse_from_where_the_textbook_finds_a_difference(steps, expected):
    assert verdicts(ours(steps=steps), PRINTED)["steps"] == expected


@pytest.mark.parametrize(
    ("metres", "expected"), [(8.0, "better"), (9.9, "compatible"), (12.0, "worse")]
)
def test_fewer_metres_are_better(metres, expected):
    assert verdicts(ours(distance=metres), PRINTED)["distance"] == expected


@pytest.mark.parametrize(
    ("successes", "printed", "expected"),
    [
        (0, 29 / 30, "worse"),
        (23, 29 / 30, "compatible"),  # p = 0.052
        (22, 29 / 30, "worse"),  # p = 0.026
        (30, 29 / 30, "compatible"),
        (30, 25 / 30, "compatible"),  # p = 0.052
        (30, 24 / 30, "better"),  # p = 0.024
    ],
)
def test_success_is_tested_both_ways(successes, printed, expected):
    row = ours(successes=successes)
    assert verdicts(row, {**PRINTED, "success": printed})["success"] == expected


def test_three_cases_of_the_paper_show_less_than_thirty():
    assert verdicts(ours(steps=88.0), PRINTED)["steps"] == "better"
    assert verdicts(ours(steps=88.0), PRINTED, cases=3)["steps"] == "compatible"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("compatible", "compatible", "compatible"), "compatible"),
        (("compatible", "better", "better"), "steps better, distance better"),
        (("compatible", "compatible", "worse"), "distance worse"),
        (("better", "compatible", "worse"), "success better, distance worse"),
    ],
)
def test_a_row_tells_which_of_its_figures_differ_and_how(words, expected):
    assert verdict(dict(zip(("success", "steps", "distance"), words, strict=True))) == expected


def test_the_steps_that_are_tested_are_those_that_the_paper_counts():
    row = ours(steps=200.0)
    row["steps"] = {"mean": 100.0, "sd": 16.0}
    assert verdicts(row, PRINTED)["steps"] == "worse"


@pytest.mark.parametrize(
    "word",
    [
        *("better", "worse", "compatible", "reproduced", "not reproduced", "in part", "undecided"),
        *("holds", "does not hold"),
    ],
)
def test_every_word_of_a_verdict_is_explained(word):
    assert word in " ".join(RULES)


def test_every_scenario_of_the_paper_has_its_printed_row():
    assert paper.PRINTED.keys() == paper.SCENARIOS.keys()
    for name, scenario in paper.SCENARIOS.items():
        home = f"{scenario.learnt}x{scenario.learnt}to" if scenario.learnt != scenario.flown else ""
        home = "" if scenario.learnt is None else home
        assert name == f"{scenario.shepherd}-{home}{scenario.flown}x{scenario.flown}"
