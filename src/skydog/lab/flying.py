"""The base station in real time: a hundred times a second look, step, send, and note it down."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skydog.flight import base, station
from skydog.flight.base import Sent, Told
from skydog.flight.station import DT
from skydog.flight.supervisor import EVENTS, Mode, Order
from skydog.lab.adapters import DroneCommand, Status
from skydog.lab.eyes import Eyes, Sighting
from skydog.lab.flightlog import Decision, FlightLog, Timing
from skydog.lab.orders import Gamepad, Orders, StopFile
from skydog.lab.policy import Answer, Policy, Seen
from skydog.lab.preflight import Check, checks
from skydog.lab.setup import Setup
from skydog.lab.site import Site
from skydog.lab.wires import Wires

LATE = 0.5 * DT  # s by which a tick may come late before its deadline counts as missed
PATIENCE = 0.004  # s that a tick waits for a decision; one that takes longer comes a tick later
GATE = 0.2  # s between looks at the pre-flight gate
OTHERS = 1.0  # s between looks for second publishers
STUCK = 3.0  # s for which a rover is told to drive and does not, before the operator hears of it
IN_AIR = (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD, Mode.LANDING)


class View(NamedTuple):
    """What there is to see of a flight, for a dashboard."""

    now: float  # s since the flight began
    mode: Mode
    step: int
    sighting: Sighting
    sent: Sent
    status: tuple[Status, ...]
    checks: tuple[Check, ...]
    lines: tuple[str, ...]  # what happened, the latest last
    timing: Timing
    rates: tuple[float, ...]


class Times(NamedTuple):
    """How a flight kept its time. Seconds, one entry a tick; of decisions, one a decision."""

    jitter: list[float]
    latency: list[float]
    decide: list[float]
    missed: int
    blind: float  # s: the longest that something flew, and did not land, on an old pose


class Outcome(NamedTuple):
    """How a flight ended."""

    how: str  # of `skydog.world.trace.ENDINGS`
    steps: int
    times: Times
    lines: tuple[str, ...]


class BaseStation:
    """One flight: from motion capture to motors.

    `show` is given a `View` ten times a second; `said` every line as it happens.
    """

    def __init__(
        self,
        site: Site,
        made: Setup,
        wires: Wires,
        policy: Policy,
        orders: Orders,
        log: FlightLog | None,
        show: Callable[[View], None] | None = None,
        said: Callable[[str], None] | None = None,
        here: Path = Path(),
    ):
        self.site, self.made, self.wires, self.policy = site, made, wires, policy
        self.orders, self.log = orders, log
        self._show, self._said = show, said
        self._eyes = Eyes(site, wires.source)
        self._names = [robot.name for robot in (*site.uav, *site.ugv)]
        self._ticks = round(float(made.world.arena.dt) / DT)
        self._stop_file = StopFile(here / site.safety.stop_file, orders)
        self._gamepad = Gamepad(site.safety.gamepad, orders) if site.safety.gamepad else None
        self._lines: deque[str] = deque(maxlen=1000)
        self._came: list[deque[float]] = [deque(maxlen=200) for _ in self._names]
        self._jitter: list[float] = []
        self._latency: list[float] = []
        self._decide: list[float] = []
        self._missed = 0
        self._blind = 0.0
        self._checks: list[Check] = []
        self._others: dict[str, tuple[str, ...]] = {}
        self._gate_due = self._others_due = self._show_due = -inf
        self._stuck = [inf] * len(site.ugv)
        self._alarmed = self._over = False
        self._ending = "stopped by the supervisor"
        self._pending: Seen | None = None
        self.step = 0
        self.begun = False
        self.began = time.monotonic()

    def fly(self, until: Callable[["BaseStation"], bool]) -> Outcome:
        """Run until `until` says so, which is asked in every tick and heard when nothing flies."""
        first = self._wait_for_bodies()
        self.memory = base.start(self.made.base, _batch(first), time.monotonic())
        due = time.monotonic()
        last_ask = -inf
        while True:
            # A new frame begins a tick, as near to its time as that comes; without one, time does.
            self.wires.source.wait(due + 0.2 * DT)
            now = time.monotonic()
            if now < due - 0.5 * DT:  # a tracker that is faster than we
                time.sleep(due - 0.5 * DT - now)
                now = time.monotonic()
            late = now - due
            self._missed += late > LATE
            self._jitter.append(late)
            due = now + DT if abs(late) > DT else due + DT + 0.1 * late
            if now - last_ask >= self._ticks * DT - 0.2 * DT:
                last_ask = (
                    now if now - last_ask > 2 * self._ticks * DT else last_ask + (self._ticks * DT)
                )
                self._ask()
            mode = self._tick(now, late)
            if until(self) and mode == Mode.DISARMED:
                return self._outcome()

    def say(self, text: str) -> None:
        """Note something down, on the screen and in the log."""
        line = f"{time.monotonic() - self.began:7.2f} s  {text}"
        self._lines.append(line)
        if self._said is not None:
            self._said(line)
        if self.log is not None:
            self.log.event(text)

    @property
    def ready(self) -> bool:
        """Whether the pre-flight gate passes."""
        return bool(self._checks) and all(check.passes for check in self._checks)

    @property
    def failed(self) -> list[Check]:
        """The pre-flight checks that do not pass."""
        return [check for check in self._checks if not check.passes]

    def _wait_for_bodies(self) -> Sighting:
        """The first look at which every body was seen; until then there is nothing to do."""
        told = -inf
        while True:
            self.wires.source.wait(time.monotonic() + 0.1)
            sighting = self._eyes.look(time.monotonic())
            missing = [
                n for n, came in zip(self._names, sighting.came, strict=True) if came == -inf
            ]
            if not missing:
                return sighting
            if time.monotonic() - told > 5.0:
                told = time.monotonic()
                self.say(f"waiting for motion capture to show {', '.join(missing)}")

    def _tick(self, now: float, late: float) -> Mode:
        sighting = self._eyes.look(now)
        self._why = sighting.why
        for came, seen in zip(self._came, sighting.came, strict=True):
            if not came or came[-1] != seen:
                came.append(seen)
        status = tuple(drone.status() for drone in self.wires.drones)
        self._watch(now, sighting, status)
        order, by = self.orders.take()
        answer = self.policy.answer(PATIENCE if self._pending is not None else 0.0)
        told = Told(
            np.array([int(order)]),
            np.array([self.ready]),
            np.array([[1.0 if said.battery is None else said.battery for said in status]]),
            np.array([any(self._others.values())]),
            np.array([[said.flying is False for said in status]]),
            np.array([self._over]),
        )
        flown = self.memory.supervisor.mode[0] == Mode.MISSION
        moves = None if answer is None else answer.moves
        self.memory, sent = base.step(
            self.made.base, self.memory, _batch(sighting), told, moves, now
        )
        self._send(sent, sighting, now)
        sent_at = time.monotonic()
        newest = max(sighting.came)
        self._latency.append(sent_at - newest if any(w is None for w in sighting.why) else np.nan)
        self._note(sent, order, by, now)
        mode = Mode(int(self.memory.supervisor.mode[0]))
        if answer is not None:
            self._take(answer, sighting, flown and mode == Mode.MISSION, now)
        self._alarm(sent, mode)
        timing = Timing(
            float(sent.age.max()),
            late,
            self._decide[-1] if self._decide else 0.0,
            self._latency[-1],
            self._missed,
        )
        self._log_tick(sighting, sent, timing, now)
        if self._show is not None and now >= self._show_due:
            self._show_due = now + 0.1
            self._show(self._view(now, mode, sighting, sent, status, timing))
        return mode

    def _ask(self) -> None:
        known = self.memory.station
        self._pending = Seen(
            self.step,
            station.flock(self.made.base.station, known)[0],
            known.dogs.position[0, :, :2],
        )
        self.policy.ask(self._pending)

    def _take(self, answer: Answer, sighting: Sighting, flying: bool, now: float) -> None:
        """What a decision means for the mission: its step, its record, its end."""
        self._pending = None
        self._decide.append(answer.took)
        if not flying:
            return
        self.begun = True
        done = answer.accomplished or self.step >= self.site.mission.steps
        if answer.accomplished:
            self._ending = "accomplished"
        elif done:
            self._ending = "out of time"
        self._record(answer, sighting, done, now)
        if done and not self._over:
            self._over = True
            self.say(f"the mission is over after {self.step} steps: {self._ending}")
        if not done:
            self.step += 1

    def _record(self, answer: Answer, sighting: Sighting, done: bool, now: float) -> None:
        if self.log is None or self._over:
            return
        decided, known = answer.decision, self.memory.station
        end = known.dog_setpoint.origin + (
            self.made.base.station.period * known.dog_setpoint.velocity
        )
        height = self.made.base.height
        dogs = known.dogs.position[0]
        attitude = np.zeros_like(dogs)
        attitude[:, 2] = sighting.dog_yaw
        command = np.asarray(decided.velocity)
        self.log.decision(
            Decision(
                0,
                self.step,
                known.sheep.position[0].copy(),
                dogs[:, :2].copy(),
                np.asarray(decided.subgoal),
                np.asarray(decided.drives),
                np.zeros_like(command) if done else command,
                np.asarray(decided.force),
                answer.accomplished,
                dogs[:, 2].copy(),
                attitude,
                np.concatenate([end[0], height[0][:, None]], axis=1),
                known.yaw.position[0, :, 0].copy(),
                known.twist.speed[0].copy(),
                known.twist.turn_rate[0].copy(),
            ),
            now,
        )

    def _send(self, sent: Sent, sighting: Sighting, now: float) -> None:
        known, mode = self.memory.station, Mode(int(sent.mode[0]))
        goal, height = known.dog_setpoint.origin[0], self.made.base.height[0]
        for number, drone in enumerate(self.wires.drones):
            x, y, z = known.dogs.position[0, number]
            velocity, tilt = sent.commands.velocity[0, number], sent.commands.tilt[0, number]
            drone.send(
                DroneCommand(
                    mode,
                    bool(sent.hover[0, number]),
                    (float(velocity[0]), float(velocity[1]), float(velocity[2])),
                    (float(tilt[0]), float(tilt[1])),
                    (float(goal[number, 0]), float(goal[number, 1]), float(height[number])),
                    (float(x), float(y), float(z)),
                    float(sighting.dog_yaw[number]),
                ),
                now,
            )
        if self.site.mission.flock == "own":
            return
        for number, (rover, robot) in enumerate(zip(self.wires.rovers, self.site.ugv, strict=True)):
            speed = float(sent.commands.twist.speed[0, number])
            turn = float(sent.commands.twist.turn_rate[0, number])
            most, sharpest = robot.speed or inf, robot.turn_rate or inf
            rover.send(max(-most, min(speed, most)), max(-sharpest, min(turn, sharpest)), now)

    def _watch(self, now: float, sighting: Sighting, status: Sequence[Status]) -> None:
        """Look at what need not be looked at in every tick."""
        self._stop_file.look(now)
        if self._gamepad is not None:
            self._gamepad.look(now)
        if now >= self._others_due:
            self._others_due = now + OTHERS
            linked = zip(self._names, (*self.wires.drones, *self.wires.rovers), strict=True)
            found = {name: wire.others() for name, wire in linked}
            for name, who in found.items():
                if who and who != self._others.get(name, ()):
                    self.say(f"{', '.join(who)} commands {name} too")
            self._others = found
        grounded = self.memory.supervisor.mode[0] in (Mode.DISARMED, Mode.READY)
        if grounded and now >= self._gate_due:
            self._gate_due = now + GATE
            seconds = self.site.mission.steps * float(self.made.world.arena.dt) + 30.0
            self._checks = checks(
                self.site,
                self.made.base,
                seconds,
                sighting,
                self.rates(now),
                status,
                self._others,
                self.policy.problem or "",
                now,
            )

    def rates(self, now: float) -> tuple[float, ...]:
        """The poses a second of each body, over the last second."""
        return tuple(float(sum(now - at <= 1.0 for at in came)) for came in self._came)

    def _note(self, sent: Sent, order: Order, by: str, now: float) -> None:
        """Tell of a transition, or of an order that was refused."""
        change = sent.change
        if change.refused[0]:
            why = ""
            if order in (Order.ARM, Order.TAKE_OFF) and not self.ready:
                why = ": " + "; ".join(str(check) for check in self.failed[:3])
            before = Mode(int(change.before[0])).name.lower()
            self.say(f"{order.name.lower()} by {by} refused while {before}{why}")
        if change.event[0] < 0:
            return
        mode = Mode(int(self.memory.supervisor.mode[0]))
        event = EVENTS[int(change.event[0])]
        oldest = int(np.argmax(sent.age[0]))
        reason = by if event.startswith("operator") else ""
        if event.startswith("eyes"):
            why = self._why[oldest] or "it jumped"
            reason = f"{self._names[oldest]} not seen for {sent.age[0, oldest]:.2f} s: {why}"
        before = Mode(int(change.before[0])).name.lower().replace("_", " ")
        then = mode.name.lower().replace("_", " ")
        self.say(f"{before} → {then}: {event}{f' ({reason})' if reason else ''}")
        if self.log is not None:
            self.log.transition(mode, event, reason, now)

    def _alarm(self, sent: Sent, mode: Mode) -> None:
        """Call the operator for what only a human can mend."""
        oldest = float(sent.age.max())
        if mode in IN_AIR and mode != Mode.LANDING:
            self._blind = max(self._blind, oldest)
        blind = mode in IN_AIR and oldest > self.made.base.limits.alarm
        if blind and not self._alarmed:
            self.say("ALARM: nobody sees it; it lands blind. Cut its motors by E if it does not")
        self._alarmed = blind
        told, known = sent.commands.twist, self.memory.station.sheep.velocity[0]
        for number, name in enumerate(self._names[len(self.site.uav) :]):
            now = self.memory.now
            drives = abs(told.speed[0, number]) > 0.05 and np.hypot(*known[number]) < 0.01
            since = self._stuck[number]
            self._stuck[number] = (
                min(since, now) if drives and since != -inf else (inf if not drives else since)
            )
            if drives and since != -inf and now - since > STUCK:
                self.say(f"{name} is told to drive and does not move")
                self._stuck[number] = -inf

    def _log_tick(self, sighting: Sighting, sent: Sent, timing: Timing, now: float) -> None:
        if self.log is None:
            return
        log, known, twist = self.log, self.memory.station, sent.commands.twist
        dogs = len(self.site.uav)
        for number, name in enumerate(self._names[:dogs]):
            x, y, z = known.dogs.position[0, number].tolist()
            log.pose(name, (x, y, z), _level(float(sighting.dog_yaw[number])), now)
            vx, vy, vz = sent.commands.velocity[0, number].tolist()
            log.command(name, (vx, vy, vz), (0.0, 0.0, 0.0), now)
        for number, name in enumerate(self._names[dogs:]):
            x, y = known.sheep.position[0, number].tolist()
            log.pose(name, (x, y, 0.0), _level(float(known.yaw.position[0, number, 0])), now)
            speed = float(twist.speed[0, number])
            log.command(name, (speed, 0.0, 0.0), (0.0, 0.0, float(twist.turn_rate[0, number])), now)
        bodies = self.wires.source.bodies()
        for name, why in zip(self._names, sighting.why, strict=True):
            if why is None and name in bodies:
                log.seen(name, bodies[name].position, bodies[name].attitude, now)
        log.timing(timing, now)

    def _view(
        self,
        now: float,
        mode: Mode,
        sighting: Sighting,
        sent: Sent,
        status: tuple[Status, ...],
        timing: Timing,
    ) -> View:
        return View(
            now - self.began,
            mode,
            self.step,
            sighting,
            sent,
            status,
            tuple(self._checks),
            tuple(self._lines)[-12:],
            timing,
            self.rates(now),
        )

    def _outcome(self) -> Outcome:
        if self.log is not None:
            self.log.ended(0, self._ending, self.site.mission.steps, time.monotonic())
        latency = [value for value in self._latency if np.isfinite(value)]
        times = Times(self._jitter, latency, self._decide, self._missed, self._blind)
        return Outcome(self._ending, self.step, times, tuple(self._lines))


def _batch(sighting: Sighting) -> station.Frame:
    """The frame as a batch of one."""
    return station.Frame(*(part[None] for part in sighting.frame))


def _level(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
