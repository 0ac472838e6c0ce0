"""What the words of a verdict mean, and how a row of ours is held against the paper's."""

from typing import Any, Literal

from skydog.study import paper, statistics
from skydog.study.statistics import Outcome

Verdict = Literal["better", "compatible", "worse"]

RULES = (
    "A figure of ours is better or worse than the paper's if a two-sided test at the 5 % level "
    "finds a difference: Fisher's exact test for success; for steps (GCM) and distance Welch's "
    "t-test, from the mean, the SD and the number of cases of each. More success, fewer steps and "
    "fewer metres are better.",
    "Two figures are compatible if the test finds no difference. It does not show that they are "
    "equal: with 30 cases a small difference stays unseen.",
    "The verdict on a row names every figure that is better or worse; the others are compatible.",
    "A claim of the paper that one shepherd has less or more of something than another is "
    "reproduced if the 95 % interval of the difference between ours, case by case, lies wholly on "
    "the claimed side of zero; not reproduced if it lies wholly on the other; else undecided. For "
    "success the test is McNemar's, for learning curves Student's t-test over the seeds, each at "
    "the 5 % level.",
    "A claim with several comparisons is reproduced if all of them are, and reproduced in part if "
    "some are. If none is, it is not reproduced if one of them is not, else undecided.",
    "A claim of the paper that gives a figure is compatible or, where the test finds a "
    "difference in any row, not reproduced.",
    "A claim of ours, beyond the paper, holds, holds in part, does not hold or is undecided by the "
    "same tests. That success is at least 99 % holds if its 95 % interval lies above.",
    "No test is corrected for how many there are: of 20 tests where nothing differs, one is "
    "expected to find a difference.",
)
"""Every word of a verdict, defined once."""


def verdicts(
    ours: dict[str, Any], printed: dict[str, Any], cases: int = paper.CASES
) -> dict[str, Verdict]:
    """The verdict on each figure of a row: `evaluate.row`'s against `paper.PRINTED`'s.

    `cases` are the paper's. It counts steps until the flock's centre is home.
    """
    tests = {
        "success": success(ours, printed["success"], cases),
        "steps": statistics.welch(ours["steps_gcm"], ours["cases"], printed["steps"], cases),
        "distance": statistics.welch(ours["distance"], ours["cases"], printed["distance"], cases),
    }
    good = {"success": 1, "steps": -1, "distance": -1}
    words: dict[int, Verdict] = {1: "better", 0: "compatible", -1: "worse"}
    return {name: words[good[name] * test.sign] for name, test in tests.items()}


def success(ours: dict[str, Any], share: float, cases: int = paper.CASES) -> Outcome:
    """Whether the success of a row is more than a share that the paper prints of its cases."""
    successes = round(ours["success"] * ours["cases"])
    return statistics.fisher(successes, ours["cases"], round(share * cases), cases)


def verdict(figures: dict[str, Verdict]) -> str:
    """The verdict on a whole row: which of its figures are not compatible, and how."""
    told = [f"{name} {word}" for name, word in figures.items() if word != "compatible"]
    return ", ".join(told) or "compatible"
