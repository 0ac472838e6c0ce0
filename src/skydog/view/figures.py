"""Figures for print: learning curves and trajectories, as PNG, SVG and inline markup."""

import hashlib
import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from skydog import files
from skydog.errors import one_line
from skydog.learning.history import Curve
from skydog.study import metrics
from skydog.study.progress import Row
from skydog.view.colours import ROLES
from skydog.view.ground import drawn, obstacles, outline
from skydog.view.style import drawing
from skydog.world import herding
from skydog.world.params import World
from skydog.world.trace import Trace, how_it_ended

SMOOTHED = 10  # rows in a running mean, of 10 episodes each

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

    The line is the running mean of 100 episodes (or of a tenth of all, if that is less); faint
    behind it is the mean of every 10. Several seeds are drawn as their mean and one SD about it,
    as far as the shortest goes.
    """
    rows = math.ceil(len(curves) / 2)
    with drawing():
        figure = Figure(figsize=(3.4 * min(2, len(curves)), 2.4 * rows), layout="constrained")
        panels = figure.subplots(rows, min(2, len(curves)), squeeze=False)
        for axes, (name, seeds) in zip(panels.flat, curves.items(), strict=False):
            _rewards(axes, name, seeds)
        for axes in panels[:, 0]:
            axes.set_ylabel("reward per action")
        for axes in panels.flat[len(curves) :]:
            axes.remove()
    return figure


def learning(rows: dict[int, Row], rule: Row, curves: dict[str, Curve]) -> Figure:
    """How a sheepdog learnt: at the left missions against training steps, at the right rewards.

    `rows` are those of `study.progress` by training steps, with 95 % intervals as bands, and
    `rule` that of the rule dog; `curves` are the learning curves of the two skills, by name.
    """
    with drawing():
        figure = Figure(figsize=(7.2, 4.8), layout="constrained")
        panels = figure.subplots(2, 2, sharex="col")
        success, steps = panels[:, 0]
        thousands = [step / 1000 for step in rows]
        for axes, of in ((success, _percent), (steps, _steps)):
            values, low, high = zip(*map(of, rows.values()), strict=True)
            style = {"color": ROLES["dog"], "marker": "o", "markersize": 2.5, "linewidth": 1.5}
            axes.plot(thousands, values, label="sheepdog", **style)
            axes.fill_between(thousands, low, high, color=ROLES["dog"], alpha=0.15, linewidth=0)
            look = {"color": "#444444", "linewidth": 1, "linestyle": "--"}
            axes.axhline(of(rule)[0], label="rule dog", **look)
            axes.grid(axis="y", color="#E6E6E6", linewidth=0.6)
            axes.set_axisbelow(True)
        success.set_title(f"{rule['cases']} missions, sheep anywhere", loc="left")
        success.set(ylim=(-3, 103), ylabel="missions accomplished (%)")
        seen = [max(1.0, value) for row in (*rows.values(), rule) for value in _steps(row)]
        steps.set_ylim(0.8 * min(seen), 1.25 * max(seen))
        steps.set(yscale="log", ylabel="steps of a mission (log)")
        steps.set_xlabel("training steps of a skill (1000)")
        steps.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        steps.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        steps.yaxis.set_minor_locator(NullLocator())
        steps.legend(loc="upper right")
        for axes, (name, curve) in zip(panels[:, 1], curves.items(), strict=True):
            _rewards(axes, f"lesson: {name}", [curve])
            axes.set_ylabel("reward per action")
        panels[0, 1].set_xlabel("")
    return figure


def transfer(lines: dict[str, dict[str, dict[str, Any]]]) -> Figure:
    """Success and steps against the arena's size, one line a way of getting there.

    `lines` are rows of figures (`evaluate.row`) by the arena's side in metres, by what the line
    is called. The bands are 95 % intervals.
    """
    with drawing():
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


def smoothed(values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """The running mean of each value and those before it: 10, or a tenth of all if that is less."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - min(SMOOTHED, max(1, len(values) // 10)), 0)
    return (sums[last] - sums[first]) / (last - first)


def title(name: str) -> str:
    """The name of a mission over its picture, which may be the name of a file: see `one_line`."""
    return one_line(name)[:80]


def trajectories(traces: dict[str, Trace]) -> Figure:
    """The paths of sheep, flock and dogs, one panel a shepherd, in metres.

    The shepherds' names are the keys; all are drawn to one scale.
    """
    with drawing():
        figure = Figure(figsize=(0.3 + 2.9 * len(traces), 4.5), layout="compressed")
        panels = figure.subplots(1, len(traces), squeeze=False, sharex=True, sharey=True)[0]
        ends = [extent(trace.world, trace.dogs) for trace in traces.values()]
        limits = min(low for low, _ in ends), max(high for _, high in ends)
        for axes, (name, trace) in zip(panels, traces.items(), strict=True):
            ground(axes, trace.world, limits)
            paths_of(axes, trace)
            turn = f"turns by {float(metrics.turn(trace)):.0f}° a step"
            axes.set_title(f"{title(name)}\n{outcome(trace)}\n{turn}", loc="left", parse_math=False)
        panels[0].set(xlim=limits, ylim=limits)
        figure.legend(handles=key(), loc="outside lower center", ncols=min(6, 3 * len(traces)))
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


def ground(axes: Axes, world: World, limits: tuple[float, float]) -> None:
    """Draw what stands still: the arena's walls and the part of the goal disc within them.

    `limits` are the least and the greatest coordinate to show, in metres.
    """
    arena = world.arena
    radius = drawn(float(arena.goal_radius), limits[1] - limits[0])
    goal = tuple(herding.goal(arena).tolist())
    walls = Rectangle((0, 0), *arena.plain_sides, fill=False, edgecolor=ROLES["arena"])
    disc = Circle(goal, radius, facecolor=ROLES["goal"], alpha=0.15)
    rim = Circle(goal, radius, fill=False, edgecolor=ROLES["goal"], linewidth=0.8)
    solid = [Polygon(outline(each), color=ROLES["arena"]) for each in obstacles(world)]
    for patch in (disc, rim, walls, *solid):
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
    highest = max(*world.arena.plain_sides, float(flown.max()))
    margin = 0.04 * (highest - lowest)
    return lowest - margin, highest + margin


def outcome(trace: Trace) -> str:
    """What came of a mission, in a line: its steps and the metres flown."""
    steps, distance = int(metrics.steps(trace)), float(metrics.distance(trace))
    how = how_it_ended(trace)
    failed = {"accomplished": "", "out of time": "not accomplished, "}.get(how, f"{how}, ")
    return f"{failed}{steps} steps, {distance:.1f} m flown"


def _percent(row: Row) -> tuple[float, float, float]:
    """The share of successes and its interval, in per cent."""
    low, high = row["success_ci95"]
    return 100 * row["success"], 100 * low, 100 * high


def _steps(row: Row) -> tuple[float, float, float]:
    """The mean steps and their interval."""
    return row["steps"]["mean"], *row["steps"]["ci95"]


def _rewards(axes: Axes, name: str, seeds: list[Curve]) -> None:
    """One panel of learning curves, of the skill in `name`."""
    axes.set_title(name, loc="left")
    axes.set_xlabel("episode")
    axes.grid(axis="y", color="#E6E6E6", linewidth=0.6)
    axes.set_axisbelow(True)
    colour = ROLES["drive" if "drive" in name else "collect"]
    seeds = [seed for seed in seeds if len(seed[0])]
    if not seeds:
        return
    shortest, _ = min(seeds, key=lambda seed: seed[0][-1])
    rewards = np.stack([np.interp(shortest, episode, reward) for episode, reward in seeds])
    axes.plot(shortest, rewards.mean(axis=0), color=colour, linewidth=0.6, alpha=0.45)
    smooth = np.stack([smoothed(reward) for reward in rewards])
    mean = smooth.mean(axis=0)
    axes.plot(shortest, mean, color=colour, linewidth=1.8)
    if len(seeds) > 1:
        sd = smooth.std(axis=0, ddof=1)
        axes.fill_between(shortest, mean - sd, mean + sd, color=colour, alpha=0.3, linewidth=0)
        axes.set_title(f"mean and SD of {len(seeds)} seeds", loc="right", fontsize=8)


def paths_of(axes: Axes, trace: Trace) -> None:
    """Draw the paths of sheep, flock and dogs, and where they start and end."""
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


def key() -> list[Line2D | Patch]:
    """What the legend of `paths_of` says."""
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
    with drawing():
        figure.savefig(
            drawn,
            format=suffix,
            dpi=150,
            bbox_inches="tight",
            pad_inches=0.05,
            metadata=dict.fromkeys(undated),
        )
    return drawn.getvalue()
