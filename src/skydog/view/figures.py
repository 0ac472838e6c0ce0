"""Figures for print: learning curves and trajectories, as PNG, SVG and inline markup."""

import hashlib
import io
import math
import re
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle

from skydog import files
from skydog.learning.train import Curve
from skydog.study import metrics
from skydog.view.colours import ROLES
from skydog.world import herding
from skydog.world.params import World
from skydog.world.trace import Trace, how_it_ended

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.edgecolor": "#444444",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "svg.hashsalt": "skydog",  # the same figure is the same file
}


# Of lines that stand for no role: Okabe and Ito's colours again, told apart in grey too.
LINES = (
    ("#0072B2", "-"),
    ("#D55E00", "--"),
    ("#009E73", "-."),
    ("#CC79A7", ":"),
    ("#E69F00", "--"),
    ("#444444", ":"),
)


def learning_curves(curves: dict[str, list[Curve]]) -> Figure:
    """Reward per action against episodes, a panel for each name of a skill, two in a row.

    Several seeds are drawn as their mean and one SD about it, as far as the shortest goes.
    """
    rows = math.ceil(len(curves) / 2)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4 * min(2, len(curves)), 2.4 * rows), layout="constrained")
        panels = figure.subplots(rows, min(2, len(curves)), squeeze=False)
        for axes, (name, seeds) in zip(panels.flat, curves.items(), strict=False):
            axes.set_title(name, loc="left")
            axes.set_xlabel("episode")
            axes.grid(axis="y", color="#E6E6E6", linewidth=0.6)
            axes.set_axisbelow(True)
            skill = "drive" if "drive" in name else "collect"
            _learnt(axes, [seed for seed in seeds if len(seed[0])], ROLES[skill])
        for axes in panels[:, 0]:
            axes.set_ylabel("reward per action\n(every 10 episodes)")
        for axes in panels.flat[len(curves) :]:
            axes.remove()
    return figure


def transfer(lines: dict[str, dict[str, dict[str, Any]]]) -> Figure:
    """Success and steps against the arena's size, one line a way of getting there.

    `lines` are rows of figures (`evaluate.row`) by the arena's side in metres, by what the line
    is called. The bands are 95 % intervals.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 2.9), layout="constrained")
        success, steps = figure.subplots(1, 2)
        for (name, rows), (colour, style) in zip(lines.items(), LINES, strict=False):
            sizes = [float(size) for size in rows]
            look = {"color": colour, "linestyle": style, "linewidth": 1.4, "markersize": 3}
            shares = [100 * row["success"] for row in rows.values()]
            success.plot(sizes, shares, marker="o", label=name, **look)
            steps.plot(sizes, [row["steps"]["mean"] for row in rows.values()], marker="o", **look)
            bands = (
                (success, [[100 * end for end in row["success_ci95"]] for row in rows.values()]),
                (steps, [row["steps"]["ci95"] for row in rows.values()]),
            )
            for axes, ends in bands:
                low, high = zip(*ends, strict=True)
                axes.fill_between(sizes, low, high, color=colour, alpha=0.12, linewidth=0)
        for axes, label in ((success, "missions accomplished (%)"), (steps, "steps")):
            axes.set(xlabel="side of the arena (m)", ylabel=label)
            axes.grid(color="#E6E6E6", linewidth=0.6)
            axes.set_axisbelow(True)
        success.set_ylim(-3, 103)
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def trajectories(traces: dict[str, Trace]) -> Figure:
    """The paths of sheep, flock and dogs, one panel a shepherd, in metres.

    The shepherds' names are the keys; all are drawn to one scale.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.3 + 2.9 * len(traces), 4.5), layout="compressed")
        panels = figure.subplots(1, len(traces), squeeze=False, sharex=True, sharey=True)[0]
        for axes, (name, trace) in zip(panels, traces.items(), strict=True):
            ground(axes, trace.world)
            _paths(axes, trace)
            turn = f"turns by {float(metrics.turn(trace)):.0f}° a step"
            axes.set_title(f"{name}\n{outcome(trace)}\n{turn}", loc="left", parse_math=False)
        ends = [extent(trace.world, trace.dogs) for trace in traces.values()]
        limits = min(low for low, _ in ends), max(high for _, high in ends)
        panels[0].set(xlim=limits, ylim=limits)
        figure.legend(handles=_key(), loc="outside lower center", ncols=min(6, 3 * len(traces)))
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write `path`.png, at 150 dpi, and `path`.svg: the same bytes for the same figure."""
    for suffix in ("png", "svg"):
        files.write_bytes(path.with_name(f"{path.name}.{suffix}"), _rendered(figure, suffix))


def svg(figure: Figure) -> str:
    """The figure as markup to stand inside a page, where no other figure has its ids."""
    drawn = _rendered(figure, "svg").decode()
    markup = drawn[drawn.index("<svg") :]
    mark = "f" + hashlib.sha256(markup.encode()).hexdigest()[:8]
    return re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{mark}-", markup)


def ground(axes: Axes, world: World) -> None:
    """Draw what stands still: the arena's walls and the part of the goal disc within them."""
    arena = world.arena
    size, radius = float(arena.size), float(arena.goal_radius)
    goal = tuple(herding.goal(arena).tolist())
    walls = Rectangle((0, 0), size, size, fill=False, edgecolor=ROLES["arena"])
    disc = Circle(goal, radius, facecolor=ROLES["goal"], alpha=0.15)
    rim = Circle(goal, radius, fill=False, edgecolor=ROLES["goal"], linewidth=0.8)
    for patch in (disc, rim, walls):
        axes.add_patch(patch)
    disc.set_clip_path(walls)
    rim.set_clip_path(walls)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.label_outer()


def extent(world: World, *paths: Float[Array, "*instants 2"]) -> tuple[float, float]:
    """The least and the greatest coordinate to show, in metres: the arena and the paths."""
    flown = np.concatenate([np.ravel(path) for path in paths])
    lowest = min(0.0, float(flown.min()))
    highest = max(float(world.arena.size), float(flown.max()))
    margin = 0.04 * (highest - lowest)
    return lowest - margin, highest + margin


def outcome(trace: Trace) -> str:
    """What came of a mission, in a line: its steps and the metres flown."""
    steps, distance = int(metrics.steps(trace)), float(metrics.distance(trace))
    how = how_it_ended(trace)
    failed = {"accomplished": "", "out of time": "not accomplished, "}.get(how, f"{how}, ")
    return f"{failed}{steps} steps, {distance:.1f} m flown"


def _learnt(axes: Axes, seeds: list[Curve], colour: str) -> None:
    if not seeds:
        return
    shortest, _ = min(seeds, key=lambda seed: seed[0][-1])
    rewards = np.stack([np.interp(shortest, episode, reward) for episode, reward in seeds])
    mean = rewards.mean(axis=0)
    axes.plot(shortest, mean, color=colour, linewidth=1.5)
    if len(seeds) > 1:
        sd = rewards.std(axis=0, ddof=1)
        axes.fill_between(shortest, mean - sd, mean + sd, color=colour, alpha=0.3, linewidth=0)
        axes.set_title(f"mean and SD of {len(seeds)} seeds", loc="right", fontsize=8)


def _paths(axes: Axes, trace: Trace) -> None:
    sheep, dogs = np.asarray(trace.sheep), np.asarray(trace.dogs)
    for path in np.swapaxes(sheep, 0, 1):
        axes.plot(*path.T, color=ROLES["sheep"], linewidth=0.7, alpha=0.45)
    centre = sheep.mean(axis=1) if trace.centre is None else np.asarray(trace.centre)
    axes.plot(*centre.T, color=ROLES["sheep"], linewidth=1.8)
    for path in np.swapaxes(dogs, 0, 1):
        axes.plot(*path.T, color=ROLES["dog"], linewidth=1.2)
    for role, paths, marker in (("sheep", sheep, "o"), ("dog", dogs, "D")):
        style = {"marker": marker, "linestyle": "", "markersize": 4, "zorder": 3}
        axes.plot(*paths[0].T, color=ROLES[role], markerfacecolor="white", **style)
        axes.plot(*paths[-1].T, color=ROLES[role], **style)


def _key() -> list[Line2D | Patch]:
    sheep, dog = ROLES["sheep"], ROLES["dog"]
    hollow = {"marker": "o", "color": "#444444", "linestyle": "", "markersize": 4}
    return [
        Line2D([], [], color=sheep, linewidth=0.7, alpha=0.45, label="each sheep"),
        Line2D([], [], color=sheep, linewidth=1.8, label="flock's centre"),
        Line2D([], [], color=dog, linewidth=1.2, label="dog"),
        Line2D([], [], markerfacecolor="white", label="start", **hollow),
        Line2D([], [], label="end", **hollow),
        Patch(facecolor=ROLES["goal"], alpha=0.3, label="goal"),
    ]


def _rendered(figure: Figure, suffix: str) -> bytes:
    undated = {"png": ["Software"], "svg": ["Date", "Creator", "Format", "Type"]}[suffix]
    drawn = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(
            drawn,
            format=suffix,
            dpi=150,
            bbox_inches="tight",
            pad_inches=0.05,
            metadata=dict.fromkeys(undated),
        )
    return drawn.getvalue()
