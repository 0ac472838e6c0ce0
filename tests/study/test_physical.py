import pytest

from skydog.study import paper, physical

NAME = "H-DDPG-6x6-Sim"
CALLED = next(iter(physical.SPEEDS))


def ours(**means):
    """A row of 33 cases as the paper's, but for the means that are given."""
    printed = paper.PHYSICAL[NAME]
    figures = {
        metric: {"mean": means.get(metric, printed[metric]["mean"]), "sd": printed[metric]["sd"]}
        for metric in physical.METRICS
    }
    return {"success": 1.0, "cases": 33, **figures}


@pytest.mark.parametrize(
    ("means", "words"),
    [
        ({}, ["compatible", "compatible", "compatible"]),
        ({"steps_gcm": 580.0}, ["compatible", "worse", "compatible"]),
        ({"distance": 12.0}, ["compatible", "compatible", "better"]),
    ],
)
def test_a_row_is_held_against_the_papers_three_cases(means, words):
    results = {f"{name}, {CALLED}": {**ours(), "first": ours()} for name in paper.PHYSICAL}
    results[f"{NAME}, {CALLED}"] = {**ours(**means), "first": ours()}
    head, body = physical.rows_table(results, CALLED)
    verdicts = [row for row in body if row[0] == "verdict"]
    assert verdicts[0][1:] == [*words, *["—"] * (len(head) - 4)]
