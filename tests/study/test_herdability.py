import numpy as np
import pytest

from skydog.study import herdability as study
from skydog.study.herdability import OURS, RULE
from skydog.study.herds import NEVER


def cell(share, settled=100, captured=100, runs=4):
    return {"share": [share] * runs, "settled": [settled] * runs, "captured": [captured] * runs}


def threshold(at):
    """Cells of a herd that `at` dogs capture, and the numbers of dogs that were asked for."""
    asked = []

    def fly(dogs):
        asked.append(dogs)
        return cell(1.0 if dogs >= at else 0.5)

    return fly, asked


@pytest.mark.parametrize("guess", [1, 4, 5, 6, 9])
def test_the_fewest_dogs_are_found_from_any_guess_and_one_fewer_is_flown_too(guess):
    fly, asked = threshold(5)
    cells = study.least(fly, guess)
    assert study.fewest(cells) == 5
    assert 4 in cells
    assert len(asked) == len(set(asked))


def test_one_dog_that_captures_has_no_fewer():
    cells = study.least(threshold(1)[0], 3)
    assert study.fewest(cells) == 1
    assert 0 not in cells


@pytest.mark.parametrize(("share", "captures"), [(0.99, True), (0.9899, False)])
def test_a_herd_is_captured_from_a_mean_of_99_percent(share, captures):
    assert study.captured(cell(share)) == captures


def test_the_line_is_that_of_its_points_and_the_interval_holds_it():
    sheep = [4, 25, 64, 100]
    exact = study.line(sheep, [2, 5, 8, 10])
    assert (exact["a"], exact["b"]) == pytest.approx((1.0, 0.0))
    low, high = study.line(sheep, [2, 4, 8, 9])["a_ci95"]
    assert low < 0.9 < high


def test_a_run_that_never_settles_counts_with_the_cap():
    seconds = study.settling(cell(0.5, settled=NEVER), steps=1_000)
    np.testing.assert_allclose(seconds, 50.0)
    np.testing.assert_allclose(study.settling(cell(1.0, settled=20)), 1.0)


def test_the_factor_is_a_ratio_of_means_and_pairs_the_runs():
    ours = np.array([1.0, 2.0, 3.0, 4.0])
    found = study.faster(ours, 3.0 * ours)
    assert found["ratio"] == pytest.approx(3.0)
    assert found["ci95"] == pytest.approx([3.0, 3.0])  # run by run, it is three times


def test_a_row_tells_the_thresholds_and_compares_at_the_rules():
    rule = {3: cell(0.9, NEVER, NEVER), 4: cell(1.0, 400, 500)}
    ours = {2: cell(0.8, NEVER, NEVER), 3: cell(1.0, 150, NEVER), 4: cell(1.0, 100, 110)}
    row = study.row(25, rule, ours)
    assert (row[RULE]["fewest"], row[OURS]["fewest"], row["equal"]) == (4, 3, 4)
    assert row["faster"]["ratio"] == pytest.approx(4.0)
    assert (row[OURS]["all"], row[OURS]["all_at_equal"]) == (0, 4)
    assert row[OURS]["chi_one_fewer"] == pytest.approx(0.8)


def test_two_shepherds_begin_a_cell_where_the_other_does():
    begun = {name: study.fly(name, 3, 2, runs=2, steps=1) for name in (RULE, OURS)}
    assert begun[RULE]["share"] == begun[OURS]["share"]
