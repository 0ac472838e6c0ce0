"""What is looked at less often than poses: the pre-flight gate, other publishers, stuck rovers."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from math import inf

import numpy as np

from skydog.flight.base import Memory
from skydog.flight.station import DT
from skydog.lab.adapters import Status
from skydog.lab.eyes import Sighting
from skydog.lab.preflight import Check, checks
from skydog.lab.setup import Setup
from skydog.lab.site import Site
from skydog.lab.wires import Wires

GATE = 0.2  # s between looks at the pre-flight gate
OTHERS = 1.0  # s between looks for second publishers
# A rover is stuck that is told to drive so far in all, and is still within so much of where it was.
TOLD, STANDS = 0.5, 0.05  # m; ours
TAKES_OFF = 30.0  # s of battery for take-off and landing


class Lookout:
    """Looks now and then, and says what it finds."""

    def __init__(self, site: Site, made: Setup, wires: Wires, say: Callable[[str], None]):
        self.checks: list[Check] = []
        self.others: dict[str, tuple[str, ...]] = {}
        self.last_seen = time.monotonic()  # s: when anybody was seen
        self._site, self._made, self._wires, self._say = site, made, wires, say
        self._names = [robot.name for robot in (*site.uav, *site.ugv)]
        # Rovers with a flock of their own are commanded by others, and not by us.
        self._ours = (*site.uav, *(site.ugv if site.mission.flock == "base station" else ()))
        self._came: list[deque[float]] = [deque(maxlen=1000) for _ in self._names]
        self._gate_due = self._others_due = -inf
        self._where = np.full((len(site.ugv), 2), np.nan)  # m: where each was when it last moved
        self._told = np.zeros(len(site.ugv))  # m that each was told to drive since
        self._seconds = site.mission.steps * float(made.world.arena.dt) + TAKES_OFF

    @property
    def ready(self) -> bool:
        """Whether the pre-flight gate passes."""
        return bool(self.checks) and all(check.passes for check in self.checks)

    @property
    def failed(self) -> list[Check]:
        """The pre-flight checks that do not pass."""
        return [check for check in self.checks if not check.passes]

    def look(
        self,
        now: float,
        sighting: Sighting,
        status: Sequence[Status],
        grounded: bool,
        policy: str,
        stopped: str,
    ) -> None:
        """Look at what is due.

        `policy` is what the shepherd complains of, `stopped` which stop is pulled; "" is none.
        """
        self.last_seen = max(self.last_seen, *sighting.came)
        for came, latest in zip(self._came, sighting.came, strict=True):
            if not came or came[-1] != latest:
                came.append(latest)
        if now >= self._others_due:
            self._others_due = now + OTHERS
            self._look_for_others()
        if grounded and now >= self._gate_due:
            self._gate_due = now + GATE
            self.checks = checks(
                self._site,
                self._made.base,
                self._seconds,
                sighting,
                self.rates(now),
                status,
                self.others,
                policy,
                now,
                stopped,
            )
            self.checks += [
                Check(f"guard of {robot.name}", bool(there), "runs" if there else "is not seen")
                for robot in self._ours
                if robot.guard and (there := self._wires.guarded(robot)) is not None
            ]

    def rates(self, now: float) -> tuple[float, ...]:
        """The poses of each body in the last second, drones first."""
        return tuple(float(sum(now - at <= 1.0 for at in came)) for came in self._came)

    def stuck(self, memory: Memory) -> None:
        """Say which rover is told to drive and does not move: once, until it moves again."""
        here = memory.station.sheep.position[0]
        with np.errstate(invalid="ignore"):
            stands = np.hypot(*(here - self._where).T) <= STANDS
        self._where = np.where(stands[:, None], self._where, here)
        before = self._told
        self._told = np.where(stands, before + DT * np.abs(memory.station.twist.speed[0]), 0.0)
        for number in np.flatnonzero((before <= TOLD) & (self._told > TOLD)):
            name = self._names[len(self._site.uav) + number]
            self._say(f"{name} is commanded to drive and does not move")

    def _look_for_others(self) -> None:
        wires = (*self._wires.drones, *self._wires.rovers)
        linked = zip(self._ours, wires, strict=False)
        found = {robot.name: wire.others() for robot, wire in linked}
        for robot in self._ours:
            if robot.guard:
                found[robot.name] += self._wires.behind(robot)
        for name, who in found.items():
            if who and who != self.others.get(name, ()):
                self._say(f"{', '.join(who)} commands {name} too")
        self.others = found
