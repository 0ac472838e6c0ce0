"""What the operator sees of a flight: a page in the terminal; where there is none, plain lines."""

import threading
from collections import deque

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from skydog.flight.supervisor import Mode
from skydog.lab.adapters import Status
from skydog.lab.orders import HELP
from skydog.lab.outcome import View
from skydog.lab.setup import world
from skydog.lab.site import Site
from skydog.world.params import Arena

RATE = 4.0  # pages a second
LINES = 8  # of what happened
CHECKS = 6  # of those that do not pass
MAP = (24, 12)  # characters, which are twice as high as wide
WIDE = 100  # characters of a terminal in which the map fits beside the robots

COLOURS = {
    Mode.DISARMED: "white",
    Mode.READY: "cyan",
    Mode.TAKING_OFF: "blue",
    Mode.MISSION: "green",
    Mode.HOLD: "yellow",
    Mode.LANDING: "magenta",
    Mode.EMERGENCY: "red",
}


class Dashboard:
    """Shows a flight of a site. Use it with `with`.

    Its caller never waits: a thread of its own draws and prints. On a console that is no terminal
    it prints what is `said`, line by line, and no page.
    """

    def __init__(self, console: Console, site: Site):
        self._console, self._site, self._arena = console, site, world(site).arena
        self._view: View | None = None
        self._lines: deque[str] = deque()
        self._closed = threading.Event()
        self._pages = console.is_terminal and not console.is_dumb_terminal
        self._thread = threading.Thread(target=self._run, name="dashboard", daemon=True)

    def __enter__(self) -> "Dashboard":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._thread.join(2.0)  # a terminal that was told to wait may keep it for ever

    def show(self, view: View) -> None:
        """Show this from now on."""
        self._view = view

    def said(self, line: str) -> None:
        """Print a line that happened, where no page shows it."""
        if not self._pages:
            self._lines.append(line)

    def _run(self) -> None:
        if not self._pages:
            self._print()
            return
        with Live(console=self._console, auto_refresh=False) as live:
            going = True
            while going:
                going = not self._closed.wait(1.0 / RATE)
                if self._view is not None:
                    width = self._console.width
                    live.update(page(self._view, self._site, self._arena, width), refresh=True)

    def _print(self) -> None:
        going = True
        while going:
            going = not self._closed.wait(0.1)
            while self._lines:
                line = self._lines.popleft()
                self._console.print(line, markup=False, highlight=False, soft_wrap=True)


def page(view: View, site: Site, arena: Arena, width: int) -> RenderableType:
    """A view as a page, the most important first: a low terminal cuts its end."""
    mode = view.mode.name.replace("_", " ")
    heading = Text.assemble(
        (f" {mode} ", f"bold reverse {COLOURS[view.mode]}"),
        f"  {view.now:.1f} s   step {view.step} of {site.mission.steps}",
    )
    robots = _robots(view, site)
    if width >= WIDE:
        beside = Table.grid(padding=(0, 3, 0, 0))
        beside.add_row(robots, _map(view, site, arena))
        robots = beside
    happened = Text("\n".join(view.lines[-LINES:]), overflow="fold")
    return Group(
        heading, *_gate(view), happened, Text(), robots, _timing(view), Text(HELP, style="dim")
    )


def _gate(view: View) -> list[Text]:
    """The pre-flight checks that do not pass, while they matter."""
    if view.mode not in (Mode.DISARMED, Mode.READY):
        return []
    failed = [check for check in view.checks if not check.passes]
    lines = [Text(f"✗ {check}", style="red", overflow="fold") for check in failed[:CHECKS]]
    if len(failed) > CHECKS:
        lines.append(Text(f"✗ and {len(failed) - CHECKS} more", style="red"))
    if view.checks and not failed:
        lines.append(Text(f"✓ all {len(view.checks)} checks pass", style="green"))
    return lines


def _robots(view: View, site: Site) -> Table:
    """A line for each robot: metres, the pose's age, poses a second, the speed it is told."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for name in ("robot", "x m", "y m", "z m", "pose", "Hz", "speed", "says"):
        number = name not in ("robot", "pose", "says")
        table.add_column(name, justify="right" if number else "left", no_wrap=number)
    frame, commands = view.sighting.frame, view.sent.commands
    places = [*frame.dogs, *frame.sheep]
    told = [*np.linalg.norm(commands.velocity[0], axis=-1), *commands.twist.speed[0]]
    says = [*map(_says, view.status), *[""] * len(site.ugv)]
    for number, robot in enumerate((*site.uav, *site.ugv)):
        x, y, *z = (f"{along:.2f}" for along in places[number])
        age, why = float(view.sent.age[0, number]), view.sighting.why[number]
        pose = Text(f"{age:.2f} s" if np.isfinite(age) else "never")
        if age > site.safety.stale:
            pose = Text(f"{pose} {why or 'not believed'}", style="bold red")
        speed = f"{told[number]:.2f} m/s"
        rate = f"{view.rates[number]:.0f}"
        table.add_row(robot.name, x, y, *(z or [""]), pose, rate, speed, says[number])
    return table


def _says(status: Status) -> str:
    """What a drone says of itself."""
    if not status.connected:
        return "does not answer"
    words = ["EMERGENCY"] if status.emergency else []
    if status.battery is not None:
        words.append(f"{status.battery:.0%}")
    if status.flying is not None:
        words.append("flies" if status.flying else "on the ground")
    return ", ".join(words)


def _timing(view: View) -> Text:
    late, latency, decide = (
        f"{1e3 * value:.1f} ms" if np.isfinite(value) else "none"
        for value in (view.timing.jitter, view.timing.latency, view.timing.decide)
    )
    return Text(
        f"tick late {late}, pose to command {latency}, decision {decide}, "
        f"{view.timing.missed} deadlines missed"
    )


def _map(view: View, site: Site, arena: Arena) -> Text:
    """The cage from above: D is a drone, o a rover, + the goal's disc, · the rest of the arena."""
    across, up = MAP
    (left, right), (bottom, top) = site.cage.x, site.cage.y
    x = left + (np.arange(across) + 0.5) * (right - left) / across
    y = top - (np.arange(up) + 0.5) * (top - bottom) / up
    size = float(arena.size)
    x, y = np.meshgrid(x, y)
    inside = (x >= 0.0) & (x <= size) & (y >= 0.0) & (y <= size)
    goal = np.hypot(x - float(arena.goal_x), y - float(arena.goal_y)) <= float(arena.goal_radius)
    drawn = np.where(inside, np.where(goal, "+", "·"), " ")
    frame = view.sighting.frame
    for sign, places in (("o", frame.sheep), ("D", frame.dogs[:, :2])):
        for at in places:
            column = int((at[0] - left) / (right - left) * across)
            row = int((top - at[1]) / (top - bottom) * up)
            if 0 <= column < across and 0 <= row < up:
                drawn[row, column] = sign
    return Text("\n".join("".join(row) for row in drawn))
