"""The rule by which a row of ours is held against the paper's."""

from typing import Any, Literal

import numpy as np
from scipy import stats

from skydog.study import paper, statistics

Verdict = Literal["better", "reproduced", "not reproduced"]

RULE = (
    "The rule: each of success, steps until the flock's centre is home, and distance is held "
    "against the paper's. Ours has its 95 % interval over the cases, the paper's the one that "
    f"its mean and SD of {paper.CASES} cases give (Student's t; Wilson's for success). Where the "
    "two overlap, the figure is reproduced; where ours lies wholly on the good side (more "
    "success, fewer steps, fewer metres) it is better; on the bad side, not reproduced. A row is "
    "not reproduced if any figure is not, else better if any is, else reproduced."
)


def verdicts(ours: dict[str, Any], printed: dict[str, Any]) -> dict[str, Verdict]:
    """The verdict on each figure of a row: `evaluate.row`'s against `paper.PRINTED`'s."""
    successes = round(printed["success"] * paper.CASES)
    theirs = statistics.share(successes, paper.CASES)[1]
    return {
        "success": _held(_mirrored(ours["success_ci95"]), _mirrored(theirs)),
        # The paper counts until the flock's centre is home.
        "steps": _held(ours["steps_gcm"]["ci95"], _interval(printed["steps"])),
        "distance": _held(ours["distance"]["ci95"], _interval(printed["distance"])),
    }


def verdict(figures: dict[str, Verdict]) -> Verdict:
    """The verdict on a whole row, from those on its figures."""
    for word in ("not reproduced", "better"):
        if word in figures.values():
            return word
    return "reproduced"


def _held(ours: list[float], theirs: list[float]) -> Verdict:
    """Whether an interval lies below another one, overlaps it, or lies above."""
    if ours[1] < theirs[0]:
        return "better"
    return "not reproduced" if ours[0] > theirs[1] else "reproduced"


def _mirrored(interval: list[float]) -> list[float]:
    return [-interval[1], -interval[0]]


def _interval(printed: dict[str, Any]) -> list[float]:
    reach = stats.t.ppf(0.975, paper.CASES - 1) * printed["sd"] / np.sqrt(paper.CASES)
    return [printed["mean"] - float(reach), printed["mean"] + float(reach)]
