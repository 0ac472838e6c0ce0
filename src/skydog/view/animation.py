"""Missions as moving pictures, GIF or MP4, and what draws any instant of one. Needs no window."""

import io
import math
import tempfile
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image
from PIL.ImageColor import getrgb

from skydog.errors import Refusal
from skydog.view import ground as drawn
from skydog.view.colours import ROLES, behaviour
from skydog.view.figures import extent, ground, title
from skydog.view.style import drawing
from skydog.world import herding
from skydog.world.params import World
from skydog.world.trace import Trace, last_instant

PIXELS = 480  # the side of a mission's picture
INCHES = 4.8  # that side as matplotlib has it: text and lines grow with the picture
FRAME, END = 80, 1500  # milliseconds that a frame of a GIF and the last of any film stand
FRAMES = 150  # of a GIF, at most: a longer mission shows fewer of its steps
COLOURS, SAMPLES = 64, 8  # of a GIF; pictures that its palette is made of
FEW, TAIL = 10, 60  # of more sheep than `FEW`, trails are the latest `TAIL` instants
RATE = 25  # frames a second of an MP4
STANDS = round(END / 1000 * RATE)  # frames of an MP4 that the last picture stands more
LONGEST = 60 * RATE  # frames of an MP4, at most
WIDEST = 16_384  # pixels that H.264 takes, and few screens show

Picture = UInt8[np.ndarray, "height width 3"]
"""Red, green and blue of every pixel, from the top left."""

Draw = Callable[
    [
        Float[np.ndarray, "instants sheep 2"],
        Float[np.ndarray, "instants dogs 2"],
        Float[np.ndarray, "dogs 2"],
        Bool[np.ndarray, " dogs"],
        str,
        int,
    ],
    Picture,
]
"""Draws an instant: (sheep, dogs, subgoal, drives, title, step) -> picture.

`sheep` and `dogs` are all positions up to now in metres, the latest last, `subgoal` and `drives`
what `herding.gate` gives now; `title` stands at the top left, and the number of the step at the
right.
"""


def gif(traces: dict[str, Trace]) -> bytes:
    """The missions side by side, 480 pixels each, every second step (or fewer) of them.

    Raises `Refusal` for more missions than fit side by side.
    """
    _check_width(traces, "a GIF")
    last = _longest(traces)
    instants = [*range(0, last, max(2, math.ceil(last / FRAMES))), last]
    # One palette for all and no dither: what stands still stays the same, for a third of the bytes.
    palette = _palette(_pictures(traces, instants[:: math.ceil(len(instants) / SAMPLES)]))
    # One after another, since all at once would fill the memory.
    frames = (
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in _pictures(traces, instants)
    )
    film = io.BytesIO()
    durations = [FRAME] * (len(instants) - 1) + [END]
    next(frames).save(film, "GIF", save_all=True, append_images=frames, duration=durations, loop=0)
    return film.getvalue()


def mp4(traces: dict[str, Trace]) -> bytes:
    """The missions side by side, 480 pixels each, as H.264 that any browser plays.

    A frame a step, 25 a second: 2.5 times as fast as it was, where a step is 0.1 s. Missions of
    more than 1500 steps show fewer of them, so that none lasts longer than a minute and the time
    that the last picture stands. Raises `Refusal` if PyAV is missing, and for more missions
    than fit side by side.
    """
    _check_width(traces, "an MP4")
    last = _longest(traces)
    instants = [*range(0, last, max(1, math.ceil(last / LONGEST))), last]
    instants += [last] * STANDS
    return encode(_pictures(traces, instants), PIXELS * len(traces), PIXELS)


def encode(pictures: Iterable[Picture], width: int, height: int) -> bytes:
    """Pictures as H.264, 25 a second. Raises `Refusal` if PyAV is missing; none is drawn then."""
    try:
        import av
    except ImportError:
        raise Refusal("an MP4 needs PyAV; run: pip install 'skydog[video]'") from None
    # A file, since its index can only be put in front (faststart) once all of it is written.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "film.mp4")
        with av.open(path, "w", options={"movflags": "faststart"}) as film:
            stream = film.add_stream("libx264", RATE, options={"crf": "20", "preset": "fast"})
            stream.width, stream.height = width, height
            stream.pix_fmt = "yuv420p"  # all that browsers decode
            stream.time_base = Fraction(1, RATE)
            for picture in pictures:
                film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
            film.mux(stream.encode())
        return path.read_bytes()


def stage(
    world: World,
    sheep: int,
    dogs: int,
    pixels: int = PIXELS,
    limits: tuple[float, float] | None = None,
) -> Draw:
    """What draws a world of so many sheep and dogs, any instant of it, `pixels` high and wide.

    `limits` are the least and the greatest coordinate to show, in metres; without any, the arena
    and as much of the airspace as half its side. What stands still is drawn once.
    """
    with drawing():
        # Slightly more, since what is not whole is cut off.
        figure = Figure(figsize=(INCHES, INCHES), dpi=(pixels + 0.001) / INCHES)
        canvas = FigureCanvasAgg(figure)
        figure.subplots_adjust(left=0.11, right=0.98, bottom=0.1, top=0.92)
        axes = figure.subplots()
        side = max(world.arena.plain_sides)
        beyond = min(float(world.dog.airspace), side / 2)
        limits = limits or extent(world, jnp.array([-beyond, side + beyond]))
        ground(axes, world, limits)
        axes.set(xlim=limits, ylim=limits)
        moving, move = _scene(axes, world, sheep, dogs)
        for artist in moving:
            artist.set_animated(True)
        canvas.draw()
    empty = canvas.copy_from_bbox(figure.bbox)

    def draw(sheep, dogs, subgoal, drives, title, step):
        canvas.restore_region(empty)
        move(sheep, dogs, subgoal, drives, title, step)
        for artist in moving:
            artist.draw(canvas.get_renderer())
        return np.array(canvas.buffer_rgba())[..., :3].copy()

    return draw


def _pictures(traces: dict[str, Trace], instants: list[int]) -> Iterator[Picture]:
    """The missions side by side, at each of the instants; one that ended stands.

    Sheep that were not recorded at an instant stand where they were recorded before.
    """
    missions = []
    for name, trace in traces.items():
        seen = [np.asarray(part) for part in (trace.sheep, trace.dogs, trace.subgoal, trace.drives)]
        recorded = np.arange(len(trace.time)) if trace.recorded is None else trace.recorded
        limits = extent(trace.world, trace.dogs, trace.subgoal)
        draw = stage(trace.world, seen[0].shape[1], seen[1].shape[1], limits=limits)
        missions.append((draw, last_instant(trace), seen, title(name), np.asarray(recorded)))
    for instant in instants:
        panels = []
        for draw, end, (sheep, dogs, subgoal, drives), name, recorded in missions:
            now = min(instant, end)
            known = int(np.searchsorted(recorded, now, "right"))
            paths = sheep[:known], dogs[: now + 1]
            panels.append(draw(*paths, subgoal[now], drives[now], name, now))
        yield np.concatenate(panels, axis=1)


def _palette(pictures: Iterable[Picture]) -> Image.Image:
    """The commonest colours of some pictures, and those of all roles; an image without pixels."""
    common = Image.fromarray(np.concatenate(list(pictures))).quantize(COLOURS).getpalette() or []
    exact = [channel for colour in ("#FFFFFF", *ROLES.values()) for channel in getrgb(colour)]
    palette = Image.new("P", (0, 0))
    palette.putpalette(exact + common)
    return palette


def _check_width(traces: dict[str, Trace], film: str) -> None:
    if len(traces) > WIDEST // PIXELS:
        raise Refusal(
            f"{film} shows at most {WIDEST // PIXELS} missions, got {len(traces)}; "
            "name fewer, or write a page (.html)"
        )


def _longest(traces: dict[str, Trace]) -> int:
    return max(last_instant(trace) for trace in traces.values())


def _scene(
    axes: Axes, world: World, sheep: int, dogs: int
) -> tuple[list[Any], Callable[..., None]]:
    """What moves on a ground, from the back to the front, and what moves it to an instant."""
    name = axes.set_title("", loc="left", parse_math=False)
    clock = axes.set_title("", loc="right", bbox={"edgecolor": "none", "pad": 2})
    lowest, highest = axes.get_xlim()
    span = highest - lowest
    spread = drawn.drawn(float(herding.gathered_radius(world, sheep)), span)
    gathered = Circle((0, 0), spread, fill=False, edgecolor="#444444", linestyle="--")
    seen = drawn.drawn(drawn.sensing(world) or 0.0, span)
    sights = [Circle((0, 0), seen, alpha=0.08, color=ROLES["dog"]) for _ in range(dogs)]
    for circle in (gathered, *sights):
        axes.add_patch(circle)
    trails = [_line(axes, color=ROLES["sheep"], linewidth=0.8, alpha=0.5) for _ in range(sheep)]
    flights = [_line(axes, color=ROLES["dog"], linewidth=1.2) for _ in range(dogs)]
    ways = [_line(axes, linewidth=2) for _ in range(dogs)]
    dots = {"markersize": 6, "linestyle": ""}
    crosses = _line(axes, marker="x", color=ROLES["subgoal"], markeredgewidth=2, **dots)
    flock_now = _line(axes, marker="o", color=ROLES["sheep"], **dots)
    dogs_now = _line(axes, marker="D", color=ROLES["dog"], **dots)

    tail = TAIL if sheep > FEW else 0  # all of it

    def move(sheep, dogs, subgoal, drives, title: str, step: int) -> None:
        name.set_text(title)
        flock_now.set_data(*sheep[-1].T)
        dogs_now.set_data(*dogs[-1].T)
        crosses.set_data(*subgoal.T)
        gathered.center = tuple(sheep[-1].mean(axis=0))
        for which, trail in enumerate(trails):
            trail.set_data(*sheep[-tail:, which].T)
        for which, (flight, way, sight) in enumerate(zip(flights, ways, sights, strict=True)):
            flight.set_data(*dogs[:, which].T)
            way.set_data(*np.stack([dogs[-1, which], subgoal[which]]).T)
            way.set_color(behaviour(bool(drives[which])))
            sight.center = tuple(dogs[-1, which])
        together = bool(drives.all())
        clock.set_text(f"{'driving' if together else 'collecting'}, step {step}")
        clock.set_backgroundcolor(behaviour(together))

    order = [gathered, *sights, *trails, *flights, *ways, crosses, flock_now, dogs_now, name, clock]
    return order, move


def _line(axes: Axes, **style: Any) -> Line2D:
    return axes.plot([], [], **style)[0]
