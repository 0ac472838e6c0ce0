"""The base station in real time: a hundred times a second look, step, send, and note it down."""

import time
from collections import deque
from collections.abc import Callable
from math import inf
from pathlib import Path

import numpy as np

from skydog.flight import base, station
from skydog.flight.base import Sent, Told
from skydog.flight.station import DT
from skydog.flight.supervisor import EVENTS, Mode, Order
from skydog.lab import record
from skydog.lab.adapters import DroneCommand, Status
from skydog.lab.eyes import Eyes, Sighting
from skydog.lab.flightlog import FlightLog, Timing
from skydog.lab.lookout import Lookout
from skydog.lab.orders import Gamepad, Orders, StopFile
from skydog.lab.outcome import Outcome, Times, View
from skydog.lab.policy import Answer, Policy, Seen
from skydog.lab.setup import Setup
from skydog.lab.site import Site, UAVSite
from skydog.lab.wires import Wires
from skydog.world.trace import ACCOMPLISHED, ENDINGS, OUT_OF_TIME, STOPPED

LATE = 0.5 * DT  # s by which a tick may come late before its deadline counts as missed
PATIENCE = 0.004  # s that a tick waits for a decision; one that takes longer comes a tick later
SHOWS = 0.1  # s between views
GIVES_UP = 20.0  # s for which a drone that nobody sees is told to land
SINKS = 0.3  # m/s, meanwhile
IN_AIR = (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD, Mode.LANDING)


class BaseStation:
    """One flight: from motion capture to motors.

    `show` is given a `View` ten times a second, `said` every line as it happens. `here` is the
    folder of the stop file.
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
        self.began = time.monotonic()
        self.step = 0
        self.look_out = Lookout(site, made, wires, self.say)
        self._show, self._said = show, said
        self._eyes = Eyes(site, wires.source)
        self._names = [robot.name for robot in (*site.uav, *site.ugv)]
        self._period = round(float(made.world.arena.dt) / DT) * DT
        self._stop_file = StopFile(here / site.safety.stop_file, orders)
        self._gamepad = Gamepad(site.safety.gamepad, orders) if site.safety.gamepad else None
        self._lines: deque[str] = deque(maxlen=1000)
        self._times = Times([], [], [], 0, 0.0)
        self._show_due = self._asked = -inf
        self._alarmed = self._over = self._waits = False
        self._airborne = 0.0  # s
        self._ticked = inf  # s: when the tick before was
        self._problem: str | None = None
        self._how = STOPPED
        self._force = np.zeros((len(site.ugv), 2), np.float32)  # of the latest that was flown

    def fly(self, until: Callable[["BaseStation"], bool]) -> Outcome:
        """Fly until `until` says so: it is asked in every tick, and heard when nothing flies."""
        first = self._wait_for_bodies()
        if first is None:
            return self._outcome()
        self.orders.forget()  # whoever typed ahead has not seen what would take off
        due = time.monotonic()
        self.memory = base.start(self.made.base, _batch(first), due)
        try:
            while True:
                # A new frame begins a tick, near its time; without one, time does.
                self.wires.source.wait(due + 0.2 * DT)
                now = time.monotonic()
                if now < due - 0.5 * DT:  # a tracker that is faster than we
                    time.sleep(due - 0.5 * DT - now)
                    now = time.monotonic()
                late = now - due
                due = now + DT if abs(late) > DT else due + DT + 0.1 * late
                try:
                    mode = self._tick(now, late)
                except Exception:  # whatever it is: nothing may stay in the air without us
                    self._abandon()
                    raise
                if until(self) and mode == Mode.DISARMED:
                    return self._outcome()
                if self.orders.quits and self.memory.now - self.look_out.last_seen > GIVES_UP:
                    self.say("no drone has been seen for a long time: skydog ends")
                    return self._outcome()
        finally:
            if self._gamepad is not None:
                self._gamepad.close()

    def _abandon(self) -> None:
        """Land every drone by its own means, and stop every rover."""
        still = (0.0, 0.0, 0.0)
        command = DroneCommand(
            Mode.LANDING, True, (0.0, 0.0, -SINKS), (0.0, 0.0), still, still, 0.0
        )
        end = time.monotonic() + GIVES_UP
        while time.monotonic() < end:
            for drone in self.wires.drones:
                drone.send(command, time.monotonic())
            if self.site.mission.flock != "own":
                for rover in self.wires.rovers:
                    rover.send(0.0, 0.0, time.monotonic())
            if all(drone.status().flying is False for drone in self.wires.drones):
                return
            time.sleep(2 * DT)

    def say(self, text: str) -> None:
        """Note something down, on the screen and in the log."""
        line = f"{time.monotonic() - self.began:7.2f} s  {text}"
        self._lines.append(line)
        if self._said is not None:
            self._said(line)
        if self.log is not None:
            self.log.event(text)

    def _wait_for_bodies(self) -> Sighting | None:
        """The first look at which every body was seen; None if the operator leaves before."""
        told = -inf
        while not self.orders.quits:
            self.wires.source.wait(time.monotonic() + 0.1)
            sighting = self._eyes.look(time.monotonic())
            seen = zip(self._names, sighting.came, strict=True)
            missing = [name for name, came in seen if came == -inf]
            if not missing:
                return sighting
            if time.monotonic() - told > 5.0:
                told = time.monotonic()
                self.say(f"waiting for motion capture to show {', '.join(missing)}")
        return None

    def _tick(self, now: float, late: float) -> Mode:
        """One tick: look, decide if it is time, step, send, and tell."""
        sighting = self._eyes.look(now)
        status = tuple(drone.status() for drone in self.wires.drones)
        stopped = self._look_for_stops(now)
        before = self.memory.supervisor.mode[0]
        grounded = before in (Mode.DISARMED, Mode.READY)
        failing = self.policy.problem or ""
        self.look_out.look(now, sighting, status, grounded, failing, stopped)
        if now - self._asked >= self._period - 0.2 * DT:
            self._ask(now)
        answer = self.policy.answer(PATIENCE) if self._waits else None
        order, by = self._order(stopped)
        moves = None if answer is None else answer.moves
        self.memory, sent = base.step(
            self.made.base, self.memory, _batch(sighting), self._told(status, order), moves, now
        )
        self._send(sent, sighting, now)
        newest = max(sighting.came)
        latency = time.monotonic() - newest if None in sighting.why else np.nan
        mode = Mode(int(self.memory.supervisor.mode[0]))
        self._note(sent, sighting, order, by, now)
        if answer is not None:
            self._waits = False
            self._times.decide.append(answer.took)
            if before == mode == Mode.MISSION:
                self._take(answer, sighting, now)
        self._keep_time(sent, mode, late, latency)
        timing = Timing(
            sent.age[0],
            late,
            self._times.decide[-1] if self._times.decide else 0.0,
            latency,
            self._times.missed,
        )
        if self.log is not None:
            bodies = dict(self.wires.source.bodies())
            record.tick(self.log, self._names, self.memory, sent, sighting, bodies, timing, now)
        if self._show is not None and now >= self._show_due:
            self._show_due = now + SHOWS
            self._show(self._view(now, mode, sighting, sent, status, timing))
        return mode

    def _look_for_stops(self, now: float) -> str:
        """Let every way to stop be heard; says which of them forbids a take-off."""
        self.wires.stop.look(now)
        self._stop_file.look(now)
        if self._gamepad is None:
            return self._stop_file.problem
        self._gamepad.look(now)
        return self._stop_file.problem or self._gamepad.problem

    def _order(self, stopped: str) -> tuple[Order, str]:
        """The next order; none that starts anything while a stop is pulled."""
        order, by = self.orders.take()
        if stopped and order in (Order.ARM, Order.TAKE_OFF, Order.RESUME):
            self.say(f"{_plain(order.name)} by {by} refused: {stopped}")
            return Order.NONE, ""
        return order, by

    def _told(self, status: tuple[Status, ...], order: Order) -> Told:
        """What the supervisor is told besides poses and decisions."""
        return Told(
            np.array([int(order)]),
            np.array([self.look_out.ready]),
            np.array([[self._battery(*each) for each in zip(self.site.uav, status, strict=True)]]),
            np.array([any(self.look_out.others.values())]),
            np.array([[said.flying is False for said in status]]),
            np.array([[said.flying is True for said in status]]),
            np.array([any(said.emergency or not said.connected for said in status)]),
            np.array([self._over]),
        )

    def _battery(self, uav: UAVSite, said: Status) -> float:
        """The share that is left: as the drone says, or by the minutes that it lasts."""
        if said.battery is None:
            return 1.0 - self._airborne / (60.0 * uav.battery_minutes)
        return said.battery if said.battery == said.battery else 0.0

    def _ask(self, now: float) -> None:
        """Let the shepherd decide, at the mission's own rate."""
        due = self._asked + self._period
        self._asked = due if now - due < self._period else now
        known = self.memory.station
        flock = station.flock(self.made.base.station, known)[0]
        self.policy.ask(Seen(self.step, flock, known.dogs.position[0, :, :2], self._force))
        self._waits = True

    def _take(self, answer: Answer, sighting: Sighting, now: float) -> None:
        """What a decision that was flown means for the mission: its record, its step, its end."""
        if self._over:
            return
        self._force = answer.decision.force
        over = answer.accomplished or self.step >= self.site.mission.steps
        if self.log is not None:
            instant = record.decision(
                self.made.base, self.memory, answer, sighting, self.step, over
            )
            self.log.decision(instant, now)
        if over:
            self._over = True
            self._how = ACCOMPLISHED if answer.accomplished else OUT_OF_TIME
            self.say(f"the mission is over after {self.step} steps: {ENDINGS[self._how]}")
        else:
            self.step += 1

    def _send(self, sent: Sent, sighting: Sighting, now: float) -> None:
        """Tell every robot."""
        known, mode = self.memory.station, Mode(int(sent.mode[0]))
        goal, height = known.dog_setpoint.origin[0], self.made.base.height[0]
        for number, drone in enumerate(self.wires.drones):
            x, y, z = known.dogs.position[0, number].tolist()
            vx, vy, vz = sent.commands.velocity[0, number].tolist()
            roll, pitch = sent.commands.tilt[0, number].tolist()
            to_x, to_y = goal[number].tolist()
            command = DroneCommand(
                mode,
                bool(sent.hover[0, number]),
                (vx, vy, vz),
                (roll, pitch),
                (to_x, to_y, float(height[number])),
                (x, y, z),
                float(sighting.dog_yaw[number]),
            )
            drone.send(command, now)
        if self.site.mission.flock == "own":
            return
        twist = sent.commands.twist
        for number, (rover, robot) in enumerate(zip(self.wires.rovers, self.site.ugv, strict=True)):
            speed = _within(float(twist.speed[0, number]), robot.speed)
            rover.send(speed, _within(float(twist.turn_rate[0, number]), robot.turn_rate), now)

    def _note(self, sent: Sent, sighting: Sighting, order: Order, by: str, now: float) -> None:
        """Tell of a transition, of an order that was refused, and of whatever else is wrong."""
        change = sent.change
        before = Mode(int(change.before[0]))
        if change.refused[0]:
            failed = self.look_out.failed if order in (Order.ARM, Order.TAKE_OFF) else []
            why = "; ".join(str(check) for check in failed[:3])
            called = _plain(order.name)
            self.say(f"{called} by {by} refused while {_plain(before.name)}{why and ': ' + why}")
        if change.event[0] >= 0:
            mode, event = Mode(int(self.memory.supervisor.mode[0])), EVENTS[int(change.event[0])]
            reason = by if event.startswith("operator") else ""
            if event.startswith("eyes"):
                oldest = int(np.argmax(sent.age[0]))
                why = sighting.why[oldest] or "it jumped"
                reason = f"{self._names[oldest]} not seen for {sent.age[0, oldest]:.2f} s: {why}"
                if now - self._ticked > self.made.base.limits.blind:
                    reason = f"the base station stood still for {now - self._ticked:.2f} s"
            told = f"{event} ({reason})" if reason else event
            self.say(f"{_plain(before.name)} → {_plain(mode.name)}: {told}")
            if self.log is not None:
                self.log.transition(mode, event, reason, now)
        problem = self.policy.problem or (self.log.problem if self.log is not None else None)
        if problem is not None and problem != self._problem:
            self._problem = problem
            self.say(problem)
        self.look_out.stuck(self.memory)

    def _keep_time(self, sent: Sent, mode: Mode, late: float, latency: float) -> None:
        """Note how time was kept, and call the operator for what only a human can mend."""
        self._times.jitter.append(late)
        if latency == latency:
            self._times.latency.append(latency)
        # A base station that stood still was as blind as with its eyes shut.
        oldest = max(float(sent.age.max()), self.memory.now - self._ticked)
        self._ticked = self.memory.now
        self._airborne += DT if mode in IN_AIR else 0.0
        flies_on = mode in IN_AIR and mode != Mode.LANDING
        self._times = self._times._replace(
            missed=self._times.missed + (late > LATE),
            blind=max(self._times.blind, oldest) if flies_on else self._times.blind,
        )
        limits = self.made.base.limits
        blind = mode in IN_AIR and oldest > limits.alarm
        if blind and not self._alarmed:
            lost = [
                n for n, age in zip(self._names, sent.age[0], strict=True) if age > limits.alarm
            ]
            self.say(
                f"ALARM: {', '.join(lost)} not seen. If it does not land, press E to cut its motors"
            )
        self._alarmed = blind

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
            tuple(self.look_out.checks),
            tuple(self._lines)[-12:],
            timing,
            self.look_out.rates(now),
        )

    def _outcome(self) -> Outcome:
        how = ENDINGS[self._how]
        if self.log is not None:
            self.log.ended(0, how, self.site.mission.steps, time.monotonic())
        return Outcome(how, self.step, self._times, tuple(self._lines))


def _batch(sighting: Sighting) -> station.Frame:
    """The frame as a batch of one."""
    return station.Frame(*(part[None] for part in sighting.frame))


def _within(value: float, most: float | None) -> float:
    return value if most is None else max(-most, min(value, most))


def _plain(name: str) -> str:
    return name.lower().replace("_", " ")
