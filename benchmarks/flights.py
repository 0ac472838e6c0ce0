"""What the peers of the twin fly, and the check that they flew it."""

import sys
from collections.abc import Callable, Iterator
from math import dist
from typing import Any, NamedTuple

import slices

SECONDS = 5.0  # simulated, about, of a flight: one step of a metre, from rest to rest
FAR, NEAR = 0.85, 0.15  # metres from the goal: at least so far before, at most so far after


class Flight(NamedTuple):
    """One step of a metre, of one drone in each of some worlds."""

    steps: int  # of physics, in all worlds together
    simulated: float  # seconds, in all worlds together
    began: list[list[float]]  # metres: x, y, z in each world
    ended: list[list[float]]
    goal: list[float]

    def miss(self) -> float:
        """Metres from the goal to the farthest end; without a flight there the worker ends."""
        least = min(dist(began, self.goal) for began in self.began)
        most = max(dist(ended, self.goal) for ended in self.ended)
        if least < FAR or not most < NEAR:
            sys.exit(f"flew from {self.began} to {self.ended} instead of {self.goal}")
        return most


def serve(asked: Iterator[dict[str, Any]], fly: Callable[[], Flight], **versions: str) -> None:
    """Fly as often as asked for, in timed slices; the first flight compiles and is not timed."""
    fly().miss()
    slices.answer(python=sys.version.split()[0], **versions)
    for request in asked:
        watch = slices.Watch()
        flights = [fly() for _ in range(request["repeats"])]
        watch.answer(
            sum(flight.steps for flight in flights),
            simulated=sum(flight.simulated for flight in flights),
            miss=max(flight.miss() for flight in flights),
        )
