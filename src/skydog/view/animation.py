"""A mission as an animated GIF, for a README or a slide."""

import io
import math
from collections.abc import Callable
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image

from skydog.study import metrics
from skydog.view.colours import ROLES, behaviour
from skydog.view.figures import STYLE, extent, ground
from skydog.world import herding
from skydog.world.mission import Trace

FRAME, END = 80, 1500  # milliseconds that a frame and the last one stand
FRAMES = 150  # at most: a longer mission shows fewer of its steps


def gif(traces: dict[str, Trace]) -> bytes:
    """The missions side by side, 480 pixels each, every second step (or fewer) of them."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8 * len(traces), 4.8), dpi=100)
        canvas = FigureCanvasAgg(figure)
        figure.subplots_adjust(left=0.11 / len(traces), right=0.98, bottom=0.1, top=0.92)
        panels = figure.subplots(1, len(traces), squeeze=False)[0]
        moves = [_scene(axes, *item) for axes, item in zip(panels, traces.items(), strict=True)]
        last = max(int(metrics.steps(trace)) for trace in traces.values())
        frames = []
        for instant in [*range(0, last, max(2, math.ceil(last / FRAMES))), last]:
            for move in moves:
                move(instant)
            canvas.draw()
            frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    film = io.BytesIO()
    durations = [FRAME] * (len(frames) - 1) + [END]
    frames[0].save(film, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)
    return film.getvalue()


def _scene(axes: Axes, name: str, trace: Trace) -> Callable[[int], None]:
    """Draw a mission; return what moves the drawing to an instant of it."""
    sheep, dogs, subgoal = map(np.asarray, (trace.sheep, trace.dogs, trace.subgoal))
    drives = np.asarray(trace.drives)
    end = int(metrics.steps(trace))
    flock = trace.world.flock
    limits = extent(trace, trace.dogs, trace.subgoal)
    ground(axes, trace)
    axes.set(xlim=limits, ylim=limits)
    axes.set_title(name, loc="left", parse_math=False)
    clock = axes.set_title("", loc="right", bbox={"edgecolor": "none", "pad": 2})

    spread = float(herding.gathered_radius(flock, sheep.shape[1]))
    gathered = Circle((0, 0), spread, fill=False, edgecolor="#444444", linestyle="--")
    axes.add_patch(gathered)
    sights = [Circle((0, 0), float(flock.sensing), alpha=0.08, color=ROLES["dog"]) for _ in dogs[0]]
    for sight in sights:
        axes.add_patch(sight)
    trails = [_line(axes, color=ROLES["sheep"], linewidth=0.8, alpha=0.5) for _ in sheep[0]]
    flights = [_line(axes, color=ROLES["dog"], linewidth=1.2) for _ in dogs[0]]
    ways = [_line(axes, linewidth=2) for _ in dogs[0]]
    dots = {"markersize": 6, "linestyle": "", "zorder": 3}
    crosses = _line(axes, marker="x", color=ROLES["subgoal"], markeredgewidth=2, **dots)
    flock_now = _line(axes, marker="o", color=ROLES["sheep"], **dots)
    dogs_now = _line(axes, marker="D", color=ROLES["dog"], **dots)

    def move(instant: int) -> None:
        now = min(instant, end)
        flock_now.set_data(*sheep[now].T)
        dogs_now.set_data(*dogs[now].T)
        crosses.set_data(*subgoal[now].T)
        gathered.center = tuple(sheep[now].mean(axis=0))
        for which, trail in enumerate(trails):
            trail.set_data(*sheep[: now + 1, which].T)
        for which, (flight, way, sight) in enumerate(zip(flights, ways, sights, strict=True)):
            flight.set_data(*dogs[: now + 1, which].T)
            way.set_data(*np.stack([dogs[now, which], subgoal[now, which]]).T)
            way.set_color(behaviour(bool(drives[now, which])))
            sight.center = tuple(dogs[now, which])
        together = bool(drives[now].all())
        clock.set_text(f"{'driving' if together else 'collecting'}, step {now}")
        clock.set_backgroundcolor(behaviour(together))

    return move


def _line(axes: Axes, **style: Any) -> Line2D:
    return axes.plot([], [], **style)[0]
