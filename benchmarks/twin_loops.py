"""Draw the loops of the twin, from a decision to a rotor and to a wheel.

python benchmarks/twin_loops.py docs/twin_loops.png
"""

import sys
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle

from skydog.view.colours import ROLES
from skydog.view.style import drawing

WIDTH, HEIGHT = 17.2, 6.7
DOG, SHEEP, BOTH = ROLES["dog"], ROLES["sheep"], "#444444"
UPPER, LOWER, BACK = 4.1, 2.1, 0.55  # the rows of drone, rovers and motion capture


class Box(NamedTuple):
    x: float
    y: float
    text: str
    colour: str
    wide: float = 1.55
    high: float = 1.15


BANDS = [
    ("the shepherd\nevery dt", 0.0, 2.15),
    ("base station\n100 Hz", 2.25, 8.15),
    ("on board\nautopilot 200 Hz", 8.25, 14.15),
    ("physics\nevery 5 ms", 14.25, 17.1),
]

DRONE = [
    Box(3.25, UPPER, "set-point\nEq. 23\nheight 2 m", DOG),
    Box(5.2, UPPER, "SNI, trim,\nfeedforward", DOG),
    Box(7.15, UPPER, "limit of\nspeed", DOG),
    Box(9.25, UPPER, "velocity\nloop*", DOG),
    Box(11.2, UPPER, "attitude\nloop", DOG),
    Box(13.15, UPPER, "mixer", DOG),
    Box(15.65, UPPER, "four rotors,\nmotor lag, drag", DOG, wide=2.2),
]

ROVERS = [
    Box(3.25, LOWER, "set-point\nEq. 23", SHEEP),
    Box(5.2, LOWER, "tracking", SHEEP),
    Box(7.15, LOWER, "limits of\nspeed, turn", SHEEP),
    Box(11.2, LOWER, "speed of\neach wheel", SHEEP),
    Box(15.65, LOWER, "wheels, casters,\nfloor, walls", SHEEP, wide=2.2),
]

DECIDE = Box(
    1.07, (UPPER + LOWER) / 2, "decide:\nvelocity of\nthe drone,\nforce on\nrovers", BOTH, high=3.15
)
CAPTURE = Box(15.65, BACK, "motion\ncapture", BOTH, wide=2.2, high=0.8)
ESTIMATE = Box(5.2, BACK, "estimate of position, velocity, yaw", BOTH, wide=5.6, high=0.8)


def draw() -> Figure:
    with drawing():
        figure = Figure(figsize=(9.6, 9.6 * HEIGHT / WIDTH), layout="constrained")
        axes = figure.subplots()
        axes.set(xlim=(-0.1, WIDTH), ylim=(-0.05, HEIGHT), aspect="equal")
        axes.axis("off")
        for text, left, right in BANDS:
            size = right - left, HEIGHT - 0.1
            axes.add_patch(Rectangle((left, 0.0), *size, facecolor="#F3F3F1", edgecolor="none"))
            middle = (left + right) / 2
            axes.text(middle, HEIGHT - 0.2, text, ha="center", va="top", fontsize=8)
        for row in (DRONE, ROVERS):
            for box in row:
                _put(axes, box)
            for before, after in pairwise(row):
                _right(axes, before, after)
            _right(axes, DECIDE, row[0])
        for box in (DECIDE, CAPTURE, ESTIMATE):
            _put(axes, box)
        for y in (UPPER, LOWER):
            axes.text(8.2, y + 0.72, "radio", ha="center", fontsize=7, color="#444444")
        right = CAPTURE.x + CAPTURE.wide / 2 + 0.2
        _line(axes, [(16.75, UPPER), (right, UPPER), (right, BACK)], (16.75, BACK))
        _line(axes, [(16.75, LOWER), (right, LOWER)])
        _line(axes, [(CAPTURE.x - CAPTURE.wide / 2, BACK)], (ESTIMATE.x + ESTIMATE.wide / 2, BACK))
        top = BACK + ESTIMATE.high / 2
        _line(axes, [(ESTIMATE.x, top)], (ESTIMATE.x, LOWER - 0.575))
        _line(axes, [(4.12, top), (4.12, 3.1), (5.2, 3.1)], (5.2, UPPER - 0.575))
        own = UPPER + 1.0
        _line(axes, [(15.65, UPPER + 0.575), (15.65, own), (9.25, own)], (9.25, UPPER + 0.575))
        _line(axes, [(11.2, own)], (11.2, UPPER + 0.575))
        text = "its own sensors: velocity, tilt, turn rates"
        axes.text(13.4, own + 0.08, text, ha="center", fontsize=7, color="#444444")
        low = LOWER - 0.35
        _line(axes, [(2.475, low)], (DECIDE.x + DECIDE.wide / 2, low), dashes="--")
        _line(axes, [(2.4, BACK), (1.07, BACK)], (1.07, DECIDE.y - DECIDE.high / 2))
    return figure


def _put(axes: Axes, box: Box) -> None:
    corner = box.x - box.wide / 2, box.y - box.high / 2
    style = "round,pad=0,rounding_size=0.15"
    axes.add_patch(
        FancyBboxPatch(
            corner,
            box.wide,
            box.high,
            boxstyle=style,
            facecolor="white",
            edgecolor=box.colour,
            linewidth=1.3,
        )
    )
    axes.text(box.x, box.y, box.text, ha="center", va="center", fontsize=7.5)


def _right(axes: Axes, before: Box, after: Box) -> None:
    _line(axes, [(before.x + before.wide / 2, after.y)], (after.x - after.wide / 2, after.y))


def _line(
    axes: Axes,
    path: list[tuple[float, float]],
    end: tuple[float, float] | None = None,
    dashes: str = "-",
) -> None:
    """A line along a path, and an arrow from its last point to `end`."""
    axes.plot(*zip(*path, strict=True), color="#444444", linewidth=0.9, linestyle=dashes)
    if end is not None:
        axes.add_patch(
            FancyArrowPatch(
                path[-1],
                end,
                arrowstyle="-|>",
                mutation_scale=8,
                shrinkA=0,
                shrinkB=0,
                color="#444444",
                linewidth=0.9,
                linestyle=dashes,
            )
        )


if __name__ == "__main__":
    with drawing():
        draw().savefig(Path(sys.argv[1]), dpi=150)
