"""The figure of a comparison of shepherds."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skydog.study.comparison import Comparison
from skydog.view.colours import ROLES
from skydog.view.style import drawing

LONGEST = 32  # characters of a name
SCATTER = 0.25  # how far above and below its line a mission's mark may lie


def figure(comparison: Comparison) -> Figure:
    """Success, steps of every mission, and the differences to the first; a line a shepherd.

    Bars are 95 % intervals.
    """
    names = list(comparison.rows)
    with drawing():
        drawn = Figure(figsize=(7.2, 1.2 + 0.42 * len(names)), layout="constrained")
        success, steps, less = drawn.subplots(1, 3, sharey=True, width_ratios=(1, 2, 2))
        draw = np.random.default_rng(0)
        for line, name in enumerate(names):
            row = comparison.rows[name]
            low, high = row["success_ci95"]
            _mark(success, line, 100 * row["success"], 100 * low, 100 * high)
            each = comparison.missions[name]["steps"]
            beside = line + draw.uniform(-SCATTER, SCATTER, len(each))
            steps.plot(each, beside, ".", ms=2, color=ROLES["arena"], alpha=0.5, rasterized=True)
            _mark(steps, line, row["steps"]["mean"], *row["steps"]["ci95"])
            if name in comparison.differences:
                gain = comparison.differences[name]["steps"]
                _mark(less, line, gain["mean"], *gain["ci95"])
        less.axvline(0.0, color=ROLES["arena"], lw=0.8)
        success.set(xlabel="success (%)", xlim=(-3, 103))
        steps.set(xlabel="steps", xlim=(0, None))
        less.set(xlabel=f"steps, less {comparison.first:.{LONGEST}}")
        success.set_yticks(range(len(names)), [name[-LONGEST:] for name in names])
        success.set_ylim(len(names) - 0.5, -0.5)
    return drawn


def _mark(axes: Axes, line: int, mean: float, low: float, high: float) -> None:
    axes.plot([low, high], [line, line], color=ROLES["sheep"], lw=1.6)
    axes.plot([mean], [line], "o", ms=4.5, color=ROLES["dog"])
