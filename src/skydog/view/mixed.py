"""The figure of mixed flocks: success against the share of the sheep that are of another kind."""

import math

from matplotlib.figure import Figure

from skydog.study.options import Results
from skydog.view.figures import LINES
from skydog.view.style import drawing

ACROSS = 3  # panels in a row


def shares(kinds: Results) -> Figure:
    """A panel for each kind, a line for each shepherd; the bands are Wilson 95 % intervals.

    `kinds` are the rows of each shepherd by share, by kind (`study.mixed.fly_all`).
    """
    rows = math.ceil(len(kinds) / ACROSS)
    with drawing():
        figure = Figure(figsize=(7.2, 2.2 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, ACROSS, squeeze=False, sharex=True, sharey=True)
        for axes, (kind, by_share) in zip(panels.flat, kinds.items(), strict=False):
            at = [100 * float(share) for share in by_share]
            for name, (colour, style) in zip(next(iter(by_share.values())), LINES, strict=False):
                found = [by[name] for by in by_share.values()]
                look = {"color": colour, "linestyle": style, "linewidth": 1.4, "markersize": 3}
                axes.plot(
                    at, [100 * row["success"] for row in found], marker="o", label=name, **look
                )
                low, high = zip(*(row["success_ci95"] for row in found), strict=True)
                band = [[100 * end for end in ends] for ends in (low, high)]
                axes.fill_between(at, *band, color=colour, alpha=0.12, linewidth=0)
            axes.set_title(kind, loc="left")
            axes.set(ylim=(-4, 104))
            axes.grid(axis="y", color="#E6E6E6", linewidth=0.6)
            axes.set_axisbelow(True)
        for axes in panels.flat[len(kinds) :]:
            axes.remove()
        for axes in panels[:, 0]:
            axes.set_ylabel("success (%)")
        for axes in panels[-1]:
            axes.set_xlabel("share of the flock (%)")
        handles, names = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=len(names))
    return figure
