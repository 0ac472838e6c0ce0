import pytest

from skydog.study import paper
from skydog.study.verdict import RULE, verdict, verdicts

PRINTED = {
    "success": 29 / 30,
    "steps": {"mean": 100, "sd": 16},
    "distance": {"mean": 10.0, "sd": 1.5},
}
# The printed interval of the steps: 100 ± 2.045 · 16 / √30.
REACH = 5.974


def ours(steps=(95.0, 105.0), distance=(9.8, 10.2), success=(0.88, 1.0)):
    return {
        "success": 1.0,
        "success_ci95": list(success),
        "steps": {"ci95": [0.0, 0.0]},
        "steps_gcm": {"ci95": list(steps)},
        "distance": {"ci95": list(distance)},
    }


def test_figures_whose_intervals_overlap_are_reproduced():
    held = verdicts(ours(), PRINTED)
    assert held == dict.fromkeys(("success", "steps", "distance"), "reproduced")
    assert verdict(held) == "reproduced"


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ((80.0, 100.0 - REACH - 0.01), "better"),
        ((80.0, 100.0 - REACH + 0.01), "reproduced"),
        ((100.0 + REACH - 0.01, 120.0), "reproduced"),
        ((100.0 + REACH + 0.01, 120.0), "not reproduced"),
    ],
)
def test_the_papers_interval_comes_from_its_mean_and_spread_over_thirty_cases(steps, expected):
    assert verdicts(ours(steps=steps), PRINTED)["steps"] == expected


@pytest.mark.parametrize(
    ("success", "expected"),
    [((0.0, 0.5), "not reproduced"), ((0.7, 0.9), "reproduced"), ((0.9999, 1.0), "better")],
)
def test_more_success_is_better_where_fewer_steps_are(success, expected):
    assert verdicts(ours(success=success), PRINTED)["success"] == expected


@pytest.mark.parametrize(
    ("figures", "expected"),
    [
        (("better", "better", "not reproduced"), "not reproduced"),
        (("reproduced", "better", "reproduced"), "better"),
        (("reproduced", "reproduced", "reproduced"), "reproduced"),
    ],
)
def test_a_row_is_as_bad_as_its_worst_figure_else_as_good_as_its_best(figures, expected):
    assert verdict(dict(zip(("success", "steps", "distance"), figures, strict=True))) == expected


def test_the_steps_that_are_held_are_those_that_the_paper_counts():
    row = ours(steps=(200.0, 210.0))
    row["steps"] = {"ci95": [100.0, 100.0]}
    assert verdicts(row, PRINTED)["steps"] == "not reproduced"
    assert "centre" in RULE


def test_every_scenario_of_the_paper_has_its_printed_row():
    assert paper.PRINTED.keys() == paper.SCENARIOS.keys()
    for name, scenario in paper.SCENARIOS.items():
        home = f"{scenario.learnt}x{scenario.learnt}to" if scenario.learnt != scenario.flown else ""
        home = "" if scenario.learnt is None else home
        assert name == f"{scenario.shepherd}-{home}{scenario.flown}x{scenario.flown}"
