"""Numbers about numbers: mean, spread and interval."""

import numpy as np
from jaxtyping import Float
from scipy import stats


def summary(values: Float[np.ndarray, " cases"]) -> dict[str, float | list[float]]:
    """Mean, sample SD and the bootstrap 95 % interval of the mean (BCa, 9,999 resamples).

    Values that do not vary have themselves as interval. The unit is that of `values`.
    """
    mean = float(np.mean(values))
    if len(values) < 2 or np.ptp(values) == 0.0:
        return {"mean": mean, "sd": 0.0, "ci95": [mean, mean]}
    interval = stats.bootstrap((values,), np.mean, rng=0).confidence_interval
    return {
        "mean": mean,
        "sd": float(np.std(values, ddof=1)),
        "ci95": [float(interval.low), float(interval.high)],
    }
