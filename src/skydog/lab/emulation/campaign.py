"""The fault campaign: each fault of the table flown through the whole chain, in real time."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from math import inf
from pathlib import Path

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import bag, flightlog
from skydog.lab.emulation import packets
from skydog.lab.emulation.chain import Chain, a_site
from skydog.lab.emulation.faults import GUARD, REFUSED, Cause, Fault, named
from skydog.lab.emulation.room import DRIVEN, Report, Start, Wrong
from skydog.lab.emulation.sabotage import Breakable
from skydog.lab.emulation.tracker import Faults
from skydog.lab.emulation.verdict import Row, judged, outcome
from skydog.lab.site import Mission, Site

BEGINS = 3.0  # s into the mission
PATIENCE = 60.0  # s for a flight to take off, to land, or to end
SAMPLE = 0.01  # s
TELLS = 0.1  # s
MOST = 8  # lines of what the base station said
ARENA = 6.0  # m
SHEEP = ((3.3, 4.5), (3.6, 4.0), (4.5, 2.1))
START = Start(dogs=((1.0, 5.0),), sheep=SHEEP, size=ARENA, goal=(0.0, 0.0, 2.0), disturb="lab")

Say = Callable[[str], None]

# Another node that drives a robot, 20 times a second for as long as its standard input is open.
INTRUDER = """
import sys, rospy
from geometry_msgs.msg import Twist, Vector3
rospy.init_node("intruder", disable_signals=True, disable_rosout=True)
said = rospy.Publisher(sys.argv[1], Twist, queue_size=1)
print("here", flush=True)
import select
while not select.select([sys.stdin], [], [], 0.05)[0]:
    said.publish(Twist(Vector3(0.1, 0.0, 0.0), Vector3()))
"""


def campaign(
    names: Collection[str],
    out: Path,
    said: Say | None = None,
    progress: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Fly the faults of these names one after another, with their logs in a folder each.

    `said` is given every line of every base station, `progress` every row when it is known. Ctrl-C
    ends the campaign with the rows that there are.
    """
    for name in names:
        _free(out / named(name).name)
    rows: list[Row] = []
    bases = [Breakable(said) for _ in names]
    with contextlib.suppress(KeyboardInterrupt), contextlib.ExitStack() as held:
        for base in bases:
            held.callback(base.close)
        for number, name in enumerate(names):
            rows.append(_fly(named(name), out / name, *bases[number : number + 2]))
            if progress is not None:
                progress(rows[-1])
    return rows


def fly(name: str, out: Path, said: Say | None = None) -> Row:
    """Fly one fault, with its log in a folder that it makes.

    Raises `Refusal` for a name that is none, and for a folder that is there already.
    """
    fault = named(name)
    with contextlib.closing(Breakable(said)) as base:
        return _fly(fault, _free(out), base)


def _fly(fault: Fault, out: Path, base: Breakable, following: Breakable | None = None) -> Row:
    """Fly a fault by a base station. The following one does its imports while this one lands."""
    out.mkdir(parents=True)
    base.start()
    start = replace(START, latches=frozenset({"ugv1"} if fault.latches else ()))
    with contextlib.ExitStack() as held:
        chain = held.enter_context(Chain(_site(fault), start))
        flight = _Flight(fault, out, chain, base, held)
        if fault.first:
            flight.begin()
        base.tell(chain.site, out)
        if not fault.first:
            flight.until(lambda: Mode.MISSION in base.modes() or base.ended, PATIENCE)
            if Mode.MISSION in base.modes() and not flight.until(lambda: base.ended, BEGINS):
                flight.begin()
        flight.watch()
        if following is not None:
            following.start()
        flight.land()
        return judged(flight.row())


def _free(folder: Path) -> Path:
    if folder.exists():
        raise Refusal(f"{folder} is there already; choose another folder for the campaign")
    return folder


def _site(fault: Fault) -> Site:
    site = a_site(Mission(steps=300), ARENA)
    if not fault.latches:
        return site
    guarded = replace(site.ugv[0], guard=True, topic="/ugv1/cmd_vel_in", stops_by_itself=False)
    return replace(site, ugv=(guarded, *site.ugv[1:]))


class _Flight:
    """A flight in which something goes wrong, and all that is known of it."""

    def __init__(
        self,
        fault: Fault,
        folder: Path,
        chain: Chain,
        base: Breakable,
        held: contextlib.ExitStack,
    ):
        self.fault, self.folder, self.chain, self.base = fault, folder, chain, base
        self._held = held
        self._before = self.began = self._ordered = inf  # s
        self._ends = inf
        self._reports: list[Report] = []
        self._intruder: "subprocess.Popen[str] | None" = None
        self._problem = ""

    def begin(self) -> None:
        """Let it go wrong."""
        if not self.fault.first:
            self.base.tell("measure")
        self._before = time.monotonic()
        for cause in self.fault.causes:
            self._set(cause)
        self.began = time.monotonic()
        self._ends = self.began + self.fault.lasts

    def until(self, event: Callable[[], bool], seconds: float) -> bool:
        """Wait for an event, and look at the room meanwhile. False if it does not come."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            report = self.chain.report()
            if report is not None and (not self._reports or report.t != self._reports[-1].t):
                self._reports.append(report)
            if time.monotonic() >= self._ends:
                self._ends = inf
                for cause in self.fault.causes:
                    self._unset(cause)
            if event():
                return True
            time.sleep(SAMPLE)
        return False

    def watch(self) -> None:
        """Watch what comes of it, for as long as the table says or until it is over."""
        if self.fault.first:
            self.until(lambda: self.base.ended, PATIENCE)
        elif self._killed:
            self.until(lambda: self._landed() is not None and self._stood() is not None, PATIENCE)
        elif self.began < inf:
            self.until(lambda: self.base.ended, self.fault.seconds)
        else:
            self._problem = "it did not come to its mission"

    def land(self) -> None:
        """Land it if it still flies, and wait until everything is over."""
        self._ordered = time.monotonic()
        if self._intruder is not None:
            _end(self._intruder)
        self.base.tell("measure")
        self.base.tell("land")
        if not self._killed and not self.until(lambda: self.base.ended, PATIENCE):
            self._problem = self._problem or "it does not end"
        self.until(lambda: self._landed() is not None and self._stood() is not None, 3.0)
        self.base.process.join(5.0)
        if self.base.process.is_alive():
            self._problem = self._problem or "the process of the base station does not end"

    def row(self) -> Row:
        """All that is known, without a verdict."""
        fault, base = self.fault, self.base
        told = {one.what: one.value for one in base.seen if one.what in ("over", "refused")}
        modes = base.of("mode", self._before, self._ordered)
        lines = base.of("line", self._before, self._ordered)
        did = tuple(f"{one.t - self.began:.2f} s: {_plain(one.value)}" for one in lines[:MOST])
        by_guard = self._guarded()
        if fault.first:
            after, came = None, "takes off" if Mode.TAKING_OFF in base.modes() else REFUSED
        elif by_guard is not None:
            after, came = by_guard, GUARD
            did = (*did, f"{by_guard:.2f} s: its guard lands it")
        else:
            first = modes[:1] or [one for one in lines if fault.heard and fault.heard in one.value]
            after = first[0].t - self.began if first else None
            came = outcome(Mode(one.value) for one in modes)
        blind = max(
            told.get("over", inf if self._killed and by_guard is None else 0.0), by_guard or 0.0
        )
        problem = self._problem or told.get("refused", "")
        if not (self._killed or fault.first or "over" in told):
            problem = problem or "the base station has died"
        sizes = [one.value for one in base.of("measure")]
        grown, got = (
            ((sizes[-1][0] - sizes[0][0]) / 1e6, sizes[-1][1] - sizes[0][1])
            if len(sizes) > 1
            else (0.0, 0)
        )
        last = self._reports[-1] if self._reports else None
        return Row(
            fault.name,
            fault.what,
            " or ".join(fault.expected),
            came,
            did,
            after,
            max(last.beyond, last.rover_beyond) if last else inf,
            blind,
            self._landed(),
            self._landing(),
            self._stood(),
            last is None or last.crashed,
            self._readable(),
            grown,
            got,
            False,
            problem,
        )

    @property
    def _killed(self) -> bool:
        return any(cause.what == "killed" for cause in self.fault.causes)

    def _since(self) -> list[Report]:
        return [one for one in self._reports if one.t > self._before]

    def _landed(self) -> float | None:
        """Seconds until the motors were off, to stay so."""
        return _lasting(self._since(), lambda one: all(one.off), self.began)

    def _landing(self) -> float | None:
        """Seconds that the landing took."""
        began = [one.t for one in self.base.of("mode") if one.value == Mode.LANDING]
        began += [self.began + after for after in (self._guarded(),) if after is not None]
        landed = self._landed()
        return None if landed is None or not began else self.began + landed - min(began)

    def _stood(self) -> float | None:
        """Seconds until the rovers stood, to stay so."""
        return _lasting(self._since(), lambda one: max(map(abs, one.speeds)) < DRIVEN, self.began)

    def _guarded(self) -> float | None:
        """Seconds until a drone was landed that its base station does not land."""
        by_base = [one.t for one in self.base.of("mode") if one.value == Mode.LANDING]
        sinks = min((min(one.sinks) for one in self._since()), default=inf)
        # A base station tells of its mode just after its drone was told.
        if sinks == inf or self.fault.first or (by_base and by_base[0] <= sinks + TELLS):
            return None
        return sinks - self.began

    def _readable(self) -> bool:
        """Whether the log of the flight can be read; of one that was killed, once it is whole."""
        log = self.folder / "log"
        try:
            if self._killed:
                flightlog.recover(log)
            if self.fault.first:
                return any(True for _ in bag.messages(bag.find(log)))
            flightlog.load(log)
        except Refusal:
            return False
        return True

    def _set(self, cause: Cause) -> None:
        if cause.where == "tracker":
            self.chain.change("faults", cause.what, cause.value)
        elif cause.where == "robots":
            self.chain.change("wrong", cause.what, cause.value)
        elif cause.what == "killed":
            self.base.process.kill()
            self.base.process.join()
        elif cause.what == "stopped":
            _signal(self.base.process.pid, signal.SIGSTOP)
        elif cause.where == "base station":
            self.base.tell(cause.what, cause.value)
        elif cause.where == "master":
            self.chain.restart_master()
        elif cause.where == "file":
            (self.folder / cause.what).touch()
        elif cause.where == "topic":
            self._intruder = _intruder(self.chain.site.ros1.master, cause.what)
            self._held.callback(_end, self._intruder)
        elif cause.where == "network":
            self._held.enter_context(packets.Flood(self.chain.site, cause.value))

    def _unset(self, cause: Cause) -> None:
        usual = {"tracker": Faults(), "robots": Wrong()}
        if cause.where in ("tracker", "robots"):
            kind = "faults" if cause.where == "tracker" else "wrong"
            self.chain.change(kind, cause.what, getattr(usual[cause.where], cause.what))
        elif cause.what == "stopped":
            _signal(self.base.process.pid, signal.SIGCONT)
        elif cause.where == "base station":
            self.base.tell(cause.what, None)
        elif cause.where == "topic" and self._intruder is not None:
            _end(self._intruder)


def _intruder(master: str, topic: str) -> "subprocess.Popen[str]":
    """Another node that drives the robot of a topic, from now on."""
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", INTRUDER, topic],
        env={**os.environ, "ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    process.stdout.readline()
    return process


def _end(process: "subprocess.Popen[str]") -> None:
    process.kill()
    with contextlib.suppress(ValueError):  # it was ended before
        process.communicate()


def _signal(process: int | None, number: signal.Signals) -> None:
    assert process is not None
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, number)


def _lasting(reports: list[Report], is_so: Callable[[Report], bool], began: float) -> float | None:
    """Seconds until what was so until the end; None if it is not so at the end."""
    since = None
    for report in reversed(reports):
        if not is_so(report):
            break
        since = report.t
    return None if since is None else max(0.0, since - began)


def _plain(line: str) -> str:
    """A line of the base station, without its own time."""
    return re.sub(r"^\s*[\d.]+ s\s+", "", line)
