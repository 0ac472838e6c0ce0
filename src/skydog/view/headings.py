"""The figure of a fit: how far each way to predict is off, the further ahead."""

import numpy as np
from matplotlib.figure import Figure

from skydog.study.options import Results
from skydog.view.figures import LINES
from skydog.view.style import drawing


def heading_errors(found: Results) -> Figure:
    """Heading error against seconds ahead, a line each way; bands from fold to fold.

    `found` is what `study.fit_report.results` gives.
    """
    ahead = found["ahead_s"]
    with drawing():
        figure = Figure(figsize=(4.6, 3.0), layout="constrained")
        axes = figure.subplots()
        for (name, each), (colour, style) in zip(
            found["heading_error"].items(), LINES, strict=False
        ):
            folds = np.array(each["folds"])
            look = {"color": colour, "linestyle": style, "linewidth": 1.5, "markersize": 3}
            axes.plot(ahead, folds.mean(axis=0), marker="o", label=name, **look)
            low, high = folds.min(axis=0), folds.max(axis=0)
            axes.fill_between(ahead, low, high, color=colour, alpha=0.12, linewidth=0)
        axes.set(xlabel="ahead (s)", ylabel="heading error, 1 - cos")
        axes.set_xticks(ahead)
        axes.set_ylim(bottom=0.0)
        axes.grid(color="#E6E6E6", linewidth=0.6)
        axes.set_axisbelow(True)
        figure.legend(loc="outside lower center", ncols=2)
    return figure
