"""The figure of the scenes: the paths of a mission in each."""

import math

from matplotlib.figure import Figure

from skydog.study import metrics
from skydog.view.figures import extent, ground, key, paths_of
from skydog.view.style import drawing
from skydog.world.trace import Trace

ACROSS = 3  # panels in a row


def paths(missions: dict[str, Trace]) -> Figure:
    """A panel for each scene, all to one scale: the paths of sheep and dogs. Metres."""
    rows = math.ceil(len(missions) / ACROSS)
    with drawing():
        figure = Figure(figsize=(7.2, 2.6 * rows + 0.4), layout="compressed")
        panels = figure.subplots(rows, ACROSS, squeeze=False, sharex=True, sharey=True)
        ends = [extent(trace.world, trace.dogs) for trace in missions.values()]
        limits = min(low for low, _ in ends), max(high for _, high in ends)
        for axes, (scene, trace) in zip(panels.flat, missions.items(), strict=False):
            ground(axes, trace.world, limits)
            paths_of(axes, trace)
            axes.set_title(f"{scene}: {int(metrics.steps(trace))} steps", loc="left")
        for axes in panels.flat[len(missions) :]:
            axes.remove()
        panels[0, 0].set(xlim=limits, ylim=limits)
        figure.legend(handles=key(), loc="outside lower center", ncols=6)
    return figure
