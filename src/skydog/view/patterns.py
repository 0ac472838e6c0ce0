"""The figure of El-Fiqi's six patterns: where flocks start, and how two dogs fly around them."""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from skydog.study import metrics
from skydog.view.colours import ROLES
from skydog.view.figures import extent, ground
from skydog.view.style import drawing
from skydog.world.trace import Trace

ACROSS = 3  # panels in a row
BESIDE = {"color": "#444444", "linewidth": 0.8, "linestyle": "--"}  # the path of the other dog


def paths(missions: dict[str, dict[str, Trace]], ours: str, theirs: str) -> Figure:
    """A panel for each pattern: its first mission, flown by two of the dogs by name.

    Sheep are drawn at the start and where `ours` brought them; all panels are to one scale.
    """
    rows = math.ceil(len(missions) / ACROSS)
    shown = [flown[name] for flown in missions.values() for name in (ours, theirs)]
    with drawing():
        figure = Figure(figsize=(7.2, 2.7 * rows + 0.4), layout="compressed")
        panels = figure.subplots(rows, ACROSS, squeeze=False, sharex=True, sharey=True)
        ends = [extent(trace.world, trace.dogs) for trace in shown]
        limits = min(low for low, _ in ends), max(high for _, high in ends)
        for axes, (pattern, flown) in zip(panels.flat, missions.items(), strict=False):
            mine, other = flown[ours], flown[theirs]
            ground(axes, mine.world, limits)
            axes.plot(*np.asarray(other.dogs)[:, 0].T, **BESIDE)
            axes.plot(*np.asarray(mine.dogs)[:, 0].T, color=ROLES["dog"], linewidth=1.2)
            for at, alpha in ((0, 0.9), (-1, 0.3)):
                look = {"color": ROLES["sheep"], "alpha": alpha, "markeredgewidth": 0}
                axes.plot(*np.asarray(mine.sheep)[at].T, "o", markersize=1.8, **look)
            start = np.asarray(mine.dogs)[0, 0]
            axes.plot(*start, "D", color=ROLES["dog"], markersize=4, markerfacecolor="white")
            steps = f"{int(metrics.steps(mine))} and {int(metrics.steps(other))} steps"
            axes.set_title(f"{pattern}: {steps}", loc="left")
        for axes in panels.flat[len(missions) :]:
            axes.remove()
        panels[0, 0].set(xlim=limits, ylim=limits)
        figure.legend(handles=_key(ours, theirs), loc="outside lower center", ncols=5)
    return figure


def _key(ours: str, theirs: str) -> list[Line2D | Patch]:
    dot = {"color": ROLES["sheep"], "marker": "o", "linestyle": "", "markersize": 3}
    return [
        Line2D([], [], color=ROLES["dog"], linewidth=1.2, label=ours),
        Line2D([], [], label=theirs, **BESIDE),
        Line2D([], [], label="sheep, start", **dot),
        Line2D([], [], label="end", alpha=0.3, **dot),
        Patch(facecolor=ROLES["goal"], alpha=0.3, label="goal"),
    ]
