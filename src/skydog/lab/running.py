"""A flight of a site from beginning to end: connect, test, fly, let go."""

import gc
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skydog.flight.supervisor import Mode, Order
from skydog.lab.flightlog import Flight, FlightLog
from skydog.lab.flying import BaseStation
from skydog.lab.orders import Orders
from skydog.lab.outcome import Outcome, View
from skydog.lab.policy import Policy, Seen
from skydog.lab.setup import Setup, setup
from skydog.lab.site import Site
from skydog.lab.wires import connect


@dataclass
class Automatic:
    """An operator for emulated flights: arms and takes off once the checks pass, then waits.

    `finished` is asked in a flight, and lands it; the flight is over once it has landed.
    """

    orders: Orders
    patience: float = 30.0  # s for the checks to pass
    finished: Callable[[BaseStation], bool] = lambda _: False
    _flown: bool = False

    def __call__(self, station: BaseStation) -> bool:
        """Whether the flight is over; asked in every tick."""
        mode = Mode(int(station.memory.supervisor.mode[0]))
        if mode not in (Mode.DISARMED, Mode.READY):
            self._flown = True
            if mode in (Mode.MISSION, Mode.HOLD) and self.finished(station):
                self.orders.give(Order.LAND, "the automatic operator")
        if mode == Mode.EMERGENCY and not any(d.status().flying for d in station.wires.drones):
            self.orders.give(Order.RESET, "the automatic operator")
        if self._flown or self.orders.quits:
            return mode == Mode.DISARMED
        if station.look_out.ready:
            self.orders.give(
                Order.ARM if mode == Mode.DISARMED else Order.TAKE_OFF, "the automatic operator"
            )
        elapsed = station.memory.now - station.began
        if elapsed > self.patience:
            for check in station.look_out.failed:
                station.say(f"not ready: {check}")
            return True
        return False


@dataclass
class Operated:
    """A human at the keys: the flight is over once it has landed, or he quits on the ground."""

    orders: Orders
    _flown: bool = False

    def __call__(self, station: BaseStation) -> bool:
        """Whether the flight is over; asked in every tick."""
        mode = station.memory.supervisor.mode[0]
        self._flown = self._flown or mode not in (Mode.DISARMED, Mode.READY)
        return bool(mode == Mode.DISARMED and (self._flown or self.orders.quits))


def fly(
    site: Site,
    orders: Orders,
    over: Callable[[BaseStation], bool],
    log: Path | None = None,
    site_text: str = "",
    show: Callable[[View], None] | None = None,
    said: Callable[[str], None] | None = None,
    made: Setup | None = None,
    here: Path = Path(),
) -> Outcome:
    """Fly a site until `over` says so, which is asked in every tick.

    Raises `Refusal` for what does not fit together or does not answer; nothing has moved then.
    """
    made = made or setup(site)
    sheep, dogs = len(site.ugv), len(site.uav)
    policy = Policy(made.world, made.shepherd, sheep, dogs)
    try:
        size = float(made.world.arena.size)
        along = np.linspace(0.4, 0.8, sheep) * size
        place = np.stack([along, along[::-1]], axis=1)
        policy.self_test(Seen(0, place, np.full((dogs, 2), 0.3 * size), 0.0 * place))
        wires = connect(site, orders)
        try:
            kept = None
            if log is not None:
                uavs, ugvs = ([robot.name for robot in which] for which in (site.uav, site.ugv))
                flight = Flight(
                    site.mission.sheepdog, made.world, tuple(uavs), tuple(ugvs), site.mission.steps
                )
                kept = FlightLog(log, site_text, made.card, flight)
            try:
                _make_way()
                station = BaseStation(site, made, wires, policy, orders, kept, show, said, here)
                return station.fly(over)
            finally:
                if kept is not None:
                    kept.close()
        finally:
            wires.close()
    finally:
        policy.close()


def _make_way() -> None:
    """Let nothing in this process keep the loop waiting: drawing threads, garbage of old."""
    sys.setswitchinterval(0.0005)  # s for which a thread keeps the interpreter; 5 ms by default
    gc.collect()
    gc.freeze()  # what was imported is not searched for garbage in flight


def as_json(value: Any) -> str:
    """A site as JSON, for the log of a flight that had no site file."""
    import msgspec

    return msgspec.json.encode(value).decode()
