"""Numbers about numbers: mean, spread and interval."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

RESAMPLES = 9_999  # of a bootstrap


def summary(values: Float[np.ndarray, " cases"]) -> dict[str, Any]:
    """Mean, sample SD and the bootstrap 95 % interval of the mean (BCa, `RESAMPLES`).

    Values that do not vary have themselves as interval. The unit is that of `values`.
    """
    mean = float(np.mean(values))
    if len(values) < 2 or np.ptp(values) == 0.0:
        return {"mean": mean, "sd": 0.0, "ci95": [mean, mean]}
    # In batches that fit a processor's cache: five times as fast for 1,000 cases.
    resampled = stats.bootstrap((values,), np.mean, n_resamples=RESAMPLES, rng=0, batch=100)
    interval = resampled.confidence_interval
    return {
        "mean": mean,
        "sd": float(np.std(values, ddof=1)),
        "ci95": [float(interval.low), float(interval.high)],
    }


def share(successes: int, cases: int) -> tuple[float, list[float]]:
    """The share of successes, and its 95 % interval (Wilson 1927), which 30 of 30 has too."""
    interval = stats.binomtest(successes, cases).proportion_ci(method="wilson")
    return successes / cases, [float(interval.low), float(interval.high)]


def paired(
    ours: Float[np.ndarray, " cases"], theirs: Float[np.ndarray, " cases"]
) -> dict[str, Any]:
    """The `summary` of the differences, ours less theirs, case by case."""
    return summary(ours - theirs)
