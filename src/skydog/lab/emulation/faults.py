"""What can go wrong in a flight: a table that a safety officer can read, and the verdict on a row.

`skydog.lab.emulation.campaign` flies it.
"""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Literal, NamedTuple

from skydog.errors import Refusal
from skydog.flight.limits import Limits
from skydog.flight.supervisor import Mode

Place = Literal["tracker", "robots", "base station", "network", "master", "topic", "file"]

STOPS = 2.0  # s in which rovers must stand once their base station is dead; ours
GROWS = 16.0  # MB by which a process may grow whose memory is flat: what Python's heaps breathe
LATEST = 12.0  # s in which a drone must be on the ground once its base station is dead; ours


class Cause(NamedTuple):
    """A part of a fault: where it is, what there is wrong, and how."""

    where: Place
    what: str
    value: Any = True


@dataclass(frozen=True)
class Fault:
    """A row of the table: what goes wrong, for how long, and what is to come of it."""

    name: str
    what: str  # in plain words
    causes: tuple[Cause, ...]
    lasts: float  # s; inf is for good
    expected: tuple[str, ...]  # any of these is right: see `outcome`
    within: float = inf  # s, by when the supervisor or a guard must have done the first of it
    heard: str = ""  # a part of the line that the operator must read
    watched: float = 0.0  # s that the flight is watched, if longer than usual
    latches: bool = False  # the first rover obeys its last command for ever, behind a guard
    first: bool = False  # it is there before anything takes off

    @property
    def seconds(self) -> float:
        """For how long the flight is watched before it is landed by an order."""
        return max(self.watched, 8.0 if self.lasts == inf else self.lasts + 3.0)


class Row(NamedTuple):
    """What came of a fault. Seconds are counted from its beginning."""

    name: str
    what: str
    expected: str
    outcome: str  # see `outcome`
    did: tuple[str, ...]  # what the base station said, and when
    after: float | None  # s until the first that the supervisor, or a guard, did
    excursion: float  # m beyond the hard fence, of whoever came nearest to it; inside is negative
    blind: float  # s: the longest that something flew, and did not land, on an old pose
    landed: float | None  # s until the drone stood with its motors off
    stood: float | None  # s until the rovers stood for good
    crashed: bool
    readable: bool  # the log, afterwards
    grown: float  # MB of memory that the base station took meanwhile
    packets: int  # that came to it from the tracker's port meanwhile
    as_expected: bool
    problem: str  # what is not, or ""


ON, AGAIN = "goes on", "holds, goes on"
LANDS, HELD = "lands", "holds, lands"
REFUSED, GUARD = "refused", "its guard lands it"

STALE = Limits.stale + 0.05  # s: a tick late, and the tracker's own delay
BLIND = Limits.blind + 0.05
ALL = ("uav1", "ugv1", "ugv2", "ugv3")


def _tracker(what: str, value: Any = True) -> tuple[Cause, ...]:
    return (Cause("tracker", what, value),)


def _base(what: str, value: Any = True) -> tuple[Cause, ...]:
    return (Cause("base station", what, value),)


_SILENT = _tracker("silent")
_KILLED = _base("killed")

_TABLE = (
    # The tracker.
    Fault("silent-0.1", "the tracker is silent for 0.1 s", _SILENT, 0.1, (ON, AGAIN)),
    Fault("silent-0.3", "the tracker is silent for 0.3 s", _SILENT, 0.3, (AGAIN,), STALE),
    Fault("silent-1", "the tracker is silent for 1 s", _SILENT, 1.0, (HELD,), STALE),
    Fault("silent-5", "the tracker is silent for 5 s", _SILENT, 5.0, (HELD,), STALE, "ALARM"),
    Fault(
        "drone-occluded-0.3",
        "the drone is occluded for 0.3 s",
        _tracker("hidden", {"uav1"}),
        0.3,
        (AGAIN,),
        STALE,
    ),
    Fault(
        "drone-occluded",
        "the drone is occluded for good",
        _tracker("hidden", {"uav1"}),
        inf,
        (HELD,),
        STALE,
        "ALARM",
    ),
    Fault(
        "rover-occluded",
        "a rover is occluded for good",
        _tracker("hidden", {"ugv1"}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "swapped-rovers",
        "two rovers far apart are mistaken for one another",
        _tracker("swapped", ("ugv1", "ugv3")),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "swapped-neighbours",
        "two rovers side by side are mistaken for one another",
        _tracker("swapped", ("ugv1", "ugv2")),
        inf,
        (ON, HELD),  # nearer than the gate can tell, each may be believed to be the other
    ),
    Fault(
        "swapped-drone-rover",
        "the drone and a rover are mistaken for one another",
        _tracker("swapped", ("uav1", "ugv1")),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "drone-frozen",
        "the drone's pose is frozen",
        _tracker("frozen", {"uav1"}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "rover-frozen",
        "a rover's pose is frozen",
        _tracker("frozen", {"ugv1"}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "all-frozen",
        "the tracker sends one frame for ever",
        (Cause("tracker", "stuck"), Cause("tracker", "frozen", set(ALL))),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "drone-jumps",
        "the drone's pose jumps by 1 m, for good",
        _tracker("jump", {"uav1": (1.0, 0.0, 0.0)}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "drone-jumps-0.3",
        "the drone's pose jumps by 1 m, for 0.3 s",
        _tracker("jump", {"uav1": (0.0, 0.0, -1.0)}),
        0.3,
        (AGAIN,),
        STALE,
    ),
    Fault(
        "rover-jumps",
        "a rover's pose jumps by 1 m, for good",
        _tracker("jump", {"ugv1": (0.0, -1.0, 0.0)}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "zeroed",
        "the drone's pose is all zeros",
        _tracker("zeroed", {"uav1"}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "packets-damaged",
        "a fifth of packets is cut, doubled, late; random bytes go ahead of half",
        (
            Cause("tracker", "truncate", 0.2),
            Cause("tracker", "duplicate", 0.2),
            Cause("tracker", "reorder", 0.2),
            Cause("tracker", "garbage", 0.5),
        ),
        5.0,
        (ON, AGAIN),
    ),
    Fault(
        "packets-flood",
        "100,000 random and damaged packets come besides the tracker's",
        (Cause("network", "flood", 100_000),),
        7.0,
        (ON, AGAIN),
    ),
    # The base station, and what it needs.
    Fault(
        "master-restarted",
        "the ROS master is killed and restarted",
        (Cause("master", "restarted"),),
        inf,
        (ON,),
        watched=5.0,
    ),
    Fault(
        "policy-nan",
        "the sheepdog decides on what is no number for 2 s",
        _base("policy", "nan"),
        2.0,
        (AGAIN,),
        1.0,
    ),
    Fault(
        "policy-hangs",
        "the sheepdog hangs for good",
        _base("policy", "hangs"),
        inf,
        (HELD,),
        1.0,
        watched=13.0,
    ),
    Fault("base-killed", "the base station is killed", _KILLED, inf, (GUARD,), BLIND),
    Fault(
        "base-stopped",
        "the base station stands still for 3 s",
        _base("stopped"),
        3.0,
        (GUARD, LANDS),
        BLIND,
    ),
    Fault(
        "disk-full",
        "the disk is full",
        _base("disk", "full"),
        inf,
        (ON,),
        heard="cannot write",
        watched=5.0,
    ),
    Fault(
        "clock-forwards",
        "the clock is put forwards by an hour",
        _base("clock", 3600.0),
        inf,
        (ON,),
        watched=5.0,
    ),
    Fault(
        "clock-backwards",
        "the clock is put back by an hour",
        _base("clock", -3600.0),
        inf,
        (ON,),
        watched=5.0,
    ),
    Fault("stop-file", "somebody makes the stop file", (Cause("file", "STOP"),), inf, (HELD,), 0.2),
    # Robots, and who else commands them.
    Fault(
        "rover-stuck",
        "a rover is stuck",
        (Cause("robots", "stuck", {"ugv1"}),),
        inf,
        (ON,),
        heard="is told to drive and stands",
    ),
    Fault(
        "rover-latches",
        "a rover obeys its last command for ever, and the tracker is silent",
        _SILENT,
        inf,
        (HELD,),
        STALE,
        latches=True,
    ),
    Fault(
        "rover-latches-base-killed",
        "a rover obeys its last command for ever, and the base station is killed",
        _KILLED,
        inf,
        (GUARD,),
        BLIND,
        latches=True,
    ),
    Fault(
        "battery-low",
        "the drone's battery is at 10 %",
        (Cause("robots", "battery", 0.1),),
        inf,
        (LANDS,),
        0.5,
    ),
    Fault(
        "second-publisher-first",
        "somebody else commands a rover before take-off",
        (Cause("topic", "/ugv1/cmd_vel"),),
        inf,
        (REFUSED,),
        heard="nobody else",
        first=True,
    ),
    Fault(
        "second-publisher-rover",
        "somebody else commands a rover in flight",
        (Cause("topic", "/ugv1/cmd_vel"),),
        6.0,
        (LANDS,),
        2.0,
        "commands ugv1 too",
    ),
    Fault(
        "second-publisher-drone",
        "somebody else commands the drone in flight",
        (Cause("topic", "/cmd_vel_in"),),
        6.0,
        (LANDS,),
        2.0,
        "commands uav1 too",
    ),
    Fault(
        "second-publisher-behind",
        "somebody else commands the drone, behind its guard",
        (Cause("topic", "/cmd_vel"),),
        6.0,
        (LANDS,),
        2.0,
        "commands uav1 too",
    ),
)

FAULTS: dict[str, Fault] = {fault.name: fault for fault in _TABLE}
"""Every fault by its name."""


def named(name: str) -> Fault:
    """The fault of a name. Raises `Refusal` if there is none."""
    if name not in FAULTS:
        near = difflib.get_close_matches(name, FAULTS, 1)
        hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join(FAULTS)}"
        raise Refusal(f"there is no fault {name!r:.60}; {hint}")
    return FAULTS[name]


def outcome(modes: Iterable[Mode]) -> str:
    """What the supervisor did with a flight, in the words of the table, by the modes it entered."""
    entered = list(modes)
    words = ["cuts the motors"] * (Mode.EMERGENCY in entered)
    words += ["holds"] * (Mode.HOLD in entered) + ["lands"] * (Mode.LANDING in entered)
    if not entered or entered[-1] in (Mode.MISSION, Mode.TAKING_OFF):
        words.append("goes on")
    return ", ".join(words)


def judged(row: Row) -> Row:
    """The row with its verdict: whether everything was as it is to be, or what was not."""
    fault = named(row.name)
    killed = any(cause.what == "killed" for cause in fault.causes)
    found = {
        f"it {row.outcome}": row.outcome not in fault.expected,
        f"{row.excursion:.2f} m beyond the fence": not row.excursion < 0.0,
        f"blind for {row.blind:.2f} s": not row.blind <= Limits.blind,
        "the drone crashed": row.crashed,
        "the log cannot be read": not row.readable,
        "the drone does not stand on the ground": row.landed is None,
        "a rover does not stand": row.stood is None,
        f"the first after {_seconds(row.after)}": not (row.after or 0.0) <= fault.within
        or (row.after is None and fault.within < inf),
        f"the operator does not read {fault.heard!r}": bool(fault.heard)
        and not _heard(fault.heard, row.did),
        f"memory grew by {row.grown:.0f} MB": not row.grown <= GROWS,
        f"on the ground after {_seconds(row.landed)}": killed and not (row.landed or 0) <= LATEST,
        f"rovers stand after {_seconds(row.stood)}": killed and not (row.stood or 0) <= STOPS,
    }
    for cause in fault.causes:
        if cause.what == "flood":
            found[f"only {row.packets:,} packets came"] = row.packets < cause.value
    problems = [row.problem] * bool(row.problem) + [what for what, wrong in found.items() if wrong]
    return row._replace(as_expected=not problems, problem="; ".join(problems))


def table(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """The head and the lines of the campaign's table."""
    head = [
        "fault",
        "what goes wrong",
        "expected",
        "what came of it",
        "first reaction",
        "longest blind",
        "furthest, beyond the fence",
        "on the ground after",
        "log",
        "verdict",
    ]
    body = [
        [
            row.name,
            row.what,
            row.expected,
            row.outcome,
            _seconds(row.after),
            _seconds(row.blind),
            f"{row.excursion:+.2f} m",
            _seconds(row.landed),
            "readable" if row.readable else "lost",
            "as expected" if row.as_expected else row.problem,
        ]
        for row in rows
    ]
    return head, body


def _seconds(value: float | None) -> str:
    return "—" if value is None else f"{value:.2f} s"


def _heard(part: str, lines: Iterable[str]) -> bool:
    return any(part in line for line in lines)
