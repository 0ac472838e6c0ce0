"""How each drone answers a step, flown in the twin: `step_responses.py --help`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float
from matplotlib.figure import Figure
from tyro.conf import arg

from skydog.flight import autopilot, profiles, setpoints, station
from skydog.flight.setpoints import Setpoint
from skydog.flight.station import DT, Commands, Memory
from skydog.study.report import markdown_table
from skydog.twin import Twin, plant
from skydog.twin.missions import Flight
from skydog.view import figures
from skydog.view.style import drawing
from skydog.world.presets import preset
from skydog.world.state import start

SPEED, AWAY = 0.5, 1.0  # m/s and m
SETTLED = 0.05  # m
EVERYONE = np.array([0])

Fly = Callable[[Flight, Memory, int], tuple[Memory, Commands]]
"""A tick of the base station, by its number: what it remembers and sends."""

Flown = dict[str, Float[np.ndarray, " ticks"]]


def hovering(name: str) -> Flight:
    """A mission of a drone that has taken off and holds its height, without disturbances."""
    begin = start(jnp.array([[5.0, 5.0]]), jnp.array([[2.0, 3.0]]))
    begin = jax.tree.map(lambda leaf: leaf[None], begin)
    still = lambda world, state: jnp.zeros_like(state.dogs)  # noqa: E731 - a shepherd
    flight = Flight(Twin(name, threads=1), preset("paper-physical"), still, begin, 1, None)
    flight._take_off()
    return flight


def flown(name: str, seconds: float, fly: Fly) -> Flown:
    """What a drone flies along x, tick by tick: metres, m/s, radians of tilt."""
    flight = hovering(name)
    memory = flight.memory.station
    places, tilts = [], []
    for tick in range(round(seconds / DT) + 1):
        truth = flight.plant.truth()
        places.append(truth.dogs[0, 0, 0])
        tilts.append(truth.attitude[0, 0, 1])
        memory = station.see(memory, flight.luck.frame(truth, None))
        memory, sent = fly(flight, memory, tick)
        heard = flight.luck.hear(sent, None)
        tilt = None if flight.uav.velocity.on_board else heard.tilt
        steps = round(DT / plant.DT)
        flight.plant.step(heard.velocity, tilt, flight.luck.trim, steps, EVERYONE)
    place = np.array(places) - places[0]
    return {"position": place, "velocity": np.gradient(place, DT), "tilt": np.array(tilts)}


def by_velocity(flight: Flight, memory: Memory, tick: int) -> tuple[Memory, Commands]:
    """The velocity loop alone is commanded `SPEED`."""
    memory, sent = station.act(flight.station, memory, 0.0, flight.height)
    level = np.array([[[SPEED, 0.0]]])
    velocity = np.concatenate([level, sent.velocity[..., 2:]], axis=-1)
    change, zero = (level / DT if tick == 0 else 0.0 * level), np.zeros_like(level)
    seen = memory.dogs.velocity[..., :2]
    tilt = autopilot.tilt(flight.uav, level, change, seen, zero, zero[..., 0])
    return memory, sent._replace(velocity=velocity, tilt=tilt)


def by_decision(flight: Flight, memory: Memory, tick: int) -> tuple[Memory, Commands]:
    """A shepherd decides `SPEED`: the set-point runs on at it."""
    if tick == 0:
        here = memory.dog_setpoint.origin
        memory = memory._replace(dog_setpoint=Setpoint(here, np.array([[[SPEED, 0.0]]])))
    return station.act(flight.station, memory, tick * DT, flight.height)


def by_position(flight: Flight, memory: Memory, tick: int) -> tuple[Memory, Commands]:
    """The set-point jumps by `AWAY`, and stands."""
    if tick == 0:
        there = memory.dog_setpoint.origin + np.array([AWAY, 0.0])
        memory = memory._replace(dog_setpoint=setpoints.stand(there))
    return station.act(flight.station, memory, 0.0, flight.height)


def reaches(series: Float[np.ndarray, " ticks"], level: float) -> float:
    """When a series is at a level for the first time, in seconds."""
    return float(np.flatnonzero(series >= level)[0] * DT)


@dataclass(frozen=True)
class Step:
    """A step that is flown, and what is drawn of it."""

    title: str
    by: Fly
    seconds: float
    what: str  # of `Flown`
    to: float


STEPS = [
    Step(f"{SPEED:g} m/s to the velocity loop", by_velocity, 3.0, "velocity", SPEED),
    Step(f"{SPEED:g} m/s by a set-point that runs", by_decision, 3.0, "velocity", SPEED),
    Step(f"a set-point that jumps by {AWAY:g} m", by_position, 10.0, "position", AWAY),
]


def measured(by_loop: Flown, by_point: Flown, jump: Flown) -> dict[str, str]:
    """What came of each step of a drone, by what is measured."""
    share, place = by_loop["velocity"] / SPEED, jump["position"] / AWAY
    behind = SPEED * DT * np.arange(len(by_point["position"])) - by_point["position"]
    off = np.flatnonzero(np.abs(place - 1.0) * AWAY > SETTLED)
    return {
        "velocity loop: 63 % of the speed after": f"{reaches(share, 1 - np.exp(-1)):.2f} s",
        "90 % after": f"{reaches(share, 0.9):.2f} s",
        "overshoot": f"{100 * max(0.0, share.max() - 1.0):.0f} %",
        "largest tilt": f"{np.degrees(np.abs(by_loop['tilt']).max()):.1f}°",
        "set-point that runs: 63 % of its speed after": (
            f"{reaches(by_point['velocity'] / SPEED, 1 - np.exp(-1)):.2f} s"
        ),
        "furthest behind it": f"{behind.max():.2f} m",
        "set-point that jumps: 90 % of the way after": f"{reaches(place, 0.9):.1f} s",
        "overshoot, of the way": f"{100 * max(0.0, place.max() - 1.0):.0f} %",
        f"within {100 * SETTLED:g} cm after": f"{(off[-1] + 1) * DT:.1f} s",
    }


def table(flights: dict[str, list[Flown]]) -> str:
    """What came of each step, a column for a drone."""
    columns = {name: measured(*steps) for name, steps in flights.items()}
    rows = [[what, *(told[what] for told in columns.values())] for what in columns["ardrone2"]]
    return markdown_table(["", *columns], rows)


def figure(flights: dict[str, list[Flown]]) -> Figure:
    """The three steps side by side, a line for a drone."""
    with drawing():
        drawn = Figure(figsize=(9.0, 2.9), layout="constrained")
        panels = drawn.subplots(1, len(STEPS))
        for number, (axes, step) in enumerate(zip(panels, STEPS, strict=True)):
            axes.axhline(step.to, color="#808080", linewidth=0.8)
            for (name, found), (colour, dashes) in zip(
                flights.items(), figures.LINES, strict=False
            ):
                series = found[number][step.what]
                shown = slice(None, round(step.seconds / DT) + 1)
                time = DT * np.arange(len(series))
                axes.plot(time[shown], series[shown], color=colour, linestyle=dashes, label=name)
            axes.set_title(step.title, loc="left")
            unit = {"velocity": "m/s", "position": "m"}[step.what]
            axes.set(xlabel="time (s)", ylabel=f"{step.what} ({unit})", xlim=(0.0, step.seconds))
            axes.set_ylim(bottom=0.0)
            axes.grid(color="#E6E6E6", linewidth=0.6)
            axes.set_axisbelow(True)
        handles, names = panels[0].get_legend_handles_labels()
        drawn.legend(handles, names, loc="outside lower center", ncols=3)
    return drawn


def main(out: Annotated[Path | None, arg(metavar="FILE.png")] = None) -> None:
    """Fly three steps with every drone that ships, and print a table of what came of them.

    Example: .venv/bin/python benchmarks/step_responses.py --out docs/twin_steps.png

    Args:
        out: Where to draw the steps, if given.
    """
    flights = {
        name: [flown(name, 2.0 * step.seconds, step.by) for step in STEPS]
        for name in profiles.ship("uav")
    }
    print(table(flights))
    if out is not None:
        with drawing():
            figure(flights).savefig(out, dpi=150)


if __name__ == "__main__":
    tyro.cli(main)
