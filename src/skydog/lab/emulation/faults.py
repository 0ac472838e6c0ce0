"""What can go wrong in a flight: a table that a safety officer can read.

`skydog.lab.emulation.campaign` flies it.
"""

import difflib
from dataclasses import dataclass
from math import inf
from typing import Any, Literal, NamedTuple

from skydog.errors import Refusal
from skydog.flight.limits import Limits

Place = Literal["tracker", "robots", "base station", "network", "master", "topic", "file"]


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
    watched: float | None = None  # s that the flight is watched, if not as long as usual
    latches: bool = False  # the first rover obeys its last command for ever, behind a guard
    first: bool = False  # it is there before anything takes off

    @property
    def seconds(self) -> float:
        """For how long the flight is watched before it is landed by an order."""
        usual = 8.0 if self.lasts == inf else self.lasts + 2.0
        return usual if self.watched is None else self.watched


ON, AGAIN = "goes on", "holds, goes on"
LANDS, HELD = "lands", "holds, lands"
REFUSED, GUARD = "refused", "its guard lands it"

STALE = Limits.stale + 0.05  # s: a tick late, and the tracker's own delay
BLIND = Limits.blind + 0.05


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
        "drone-turned",
        "the drone's pattern is seen the wrong way round",
        _tracker("turned", {"uav1"}),
        inf,
        (HELD,),
        STALE,
    ),
    Fault(
        "rover-turned",
        "a rover's pattern is seen the wrong way round",
        _tracker("turned", {"ugv1"}),
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
        "drone-jumps",
        "the drone's pose jumps by 1 m, for good",
        _tracker("jump", {"uav1": (1.0, 0.0, 0.0)}),
        inf,
        (HELD,),
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
        "zeroed", "the drone's pose is all zeros", _tracker("zeroed", {"uav1"}), inf, (HELD,), STALE
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
        watched=3.0,
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
        watched=3.0,
    ),
    Fault(
        "clock-forwards",
        "the clock is put forwards by an hour",
        _base("clock", 3600.0),
        inf,
        (ON,),
        watched=3.0,
    ),
    Fault(
        "clock-backwards",
        "the clock is put back by an hour",
        _base("clock", -3600.0),
        inf,
        (ON,),
        watched=3.0,
    ),
    Fault("stop-file", "somebody makes the stop file", (Cause("file", "STOP"),), inf, (HELD,), 0.2),
    # Robots, and who else commands them.
    Fault(
        "rover-stuck",
        "a rover is stuck",
        (Cause("robots", "stuck", {"ugv1"}),),
        inf,
        (ON,),
        heard="is commanded to drive and does not move",
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
