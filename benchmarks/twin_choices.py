"""What two choices of the twin change: how rovers are steered, and the time step of the physics.

    python benchmarks/twin_choices.py [--cases 100]

All missions are those of h-ddpg-6x6 on tum-simulator at full speed, from one set of spaced starts.
"""

import argparse

import jax
import numpy as np
from jaxtyping import Float

from skydog.flight import profiles, station
from skydog.shepherds import store
from skydog.study import evaluate
from skydog.study.report import figure, markdown_table, share
from skydog.twin import Twin, starts
from skydog.twin.missions import Flight
from skydog.twin.record import Record
from skydog.world.mission import MAX_STEPS
from skydog.world.presets import preset
from skydog.world.state import State
from skydog.world.vectors import norm

DOG, SECONDS = "h-ddpg-6x6", 2.0
WAYS = ("reference", "track", "turn")
TIMESTEPS = (0.005, 0.0025, 0.001)  # s
WORLD = preset("paper-physical")


class Watched(Flight):
    """A flight that notes what is decided on beside what is true, and what rovers make of it."""

    def fly(self):
        self.apart: list[Float[np.ndarray, " rovers"]] = []
        self.asked, self.made = 0.0, 0.0
        return super().fly()

    def _record(self, truth, decided, done, over) -> Record:
        away = station.flock(self.station, self.memory.station) - truth.sheep
        self.apart.append(np.linalg.norm(away, axis=-1)[~over].ravel())
        return super()._record(truth, decided, done, over)

    def _advance(self, decided, flying) -> None:
        before = self.plant.truth().sheep[flying]
        super()._advance(decided, flying)
        moved = self.plant.truth().sheep[flying] - before
        wanted = self.station.period * self.station.speed * decided.force[flying]
        size = np.linalg.norm(wanted, axis=-1)
        along = np.sum(moved * wanted, axis=-1) / np.maximum(size, 1e-9)
        self.asked += size.sum()
        self.made += along.sum()


def by_steering(begins: State) -> str:
    """A line for each way of steering rovers, and one for the kinematic world."""
    dog, key = store.load(DOG), jax.random.key(0)
    head = ["rovers", "success", "steps", "shown to the shepherd: off by", "way made"]
    flown = evaluate.measure(evaluate.fly(WORLD, dog, begins))
    rows = [["as points (kinematic)", *_figures(flown), "0", "100 %"]]
    for way in WAYS:
        flight = Watched(Twin(steering=way), WORLD, dog, begins, MAX_STEPS, key)
        flown = evaluate.measure(flight.fly())
        apart = np.concatenate(flight.apart)
        told = f"{100 * apart.mean():.1f} cm, at most {100 * apart.max():.0f} cm"
        made = f"{flight.made / flight.asked:.0%}".replace("%", " %")
        rows.append([way, *_figures(flown), told, made])
    return markdown_table(head, rows)


def by_timestep(begins: State) -> str:
    """A line for each time step of the physics."""
    dog, key = store.load(DOG), jax.random.key(0)
    steps = round(SECONDS / float(WORLD.arena.dt))
    finest = Twin(timestep=min(TIMESTEPS))(WORLD, dog, begins, steps, key)
    rows = []
    for timestep in TIMESTEPS:
        twin = Twin(timestep=timestep)
        short = twin(WORLD, dog, begins, steps, key)
        cells = [f"{1000 * timestep:g} ms"]
        for who in ("dogs", "sheep"):
            off = norm(getattr(short, who)[:, -1] - getattr(finest, who)[:, -1])
            cells.append(f"{1000 * float(off.max()):.1f} mm")
        flown = evaluate.measure(twin(WORLD, dog, begins, MAX_STEPS, key))
        rows.append([*cells, *_figures(flown)])
    after = f"at most, after {SECONDS:g} s"
    head = ["time step", f"a drone is off {after}", f"a rover {after}", "success", "steps"]
    return markdown_table(head, rows)


def _figures(measured) -> list[str]:
    row = evaluate.figures(measured)
    return [share(row["success"], row["cases"]), figure(row["steps"], ".0f")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    cases = parser.parse_args().cases
    uav, rover = profiles.uav("tum-simulator"), profiles.rover("kobuki")
    begins = starts.draw(WORLD, cases, "spaced", uav, rover)
    print(by_steering(begins))
    print()
    print(by_timestep(begins))


if __name__ == "__main__":
    main()
