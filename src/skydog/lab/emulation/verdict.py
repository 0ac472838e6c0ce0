"""The verdict on a fault: what the supervisor made of it, and whether all was as it is to be."""

from collections.abc import Iterable, Sequence
from math import inf
from typing import NamedTuple

from skydog.flight.limits import Limits
from skydog.flight.supervisor import Mode
from skydog.lab.emulation.faults import named

STOPS = 2.0  # s in which rovers must stand once their base station is dead; ours
GROWS = 16.0  # MB by which a process may grow whose memory is flat: what Python's heaps breathe
LATEST = 16.0  # s for a landing: as long as it looks for a place without rovers, and the way down


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
    landing: float | None  # s of it that the landing took
    stood: float | None  # s until the rovers stood for good
    crashed: bool
    readable: bool  # the log, afterwards
    grown: float  # MB of memory that the base station took meanwhile
    packets: int  # that came to it from the tracker's port meanwhile
    as_expected: bool
    problem: str  # what is not, or ""


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
        f"the landing took {_seconds(row.landing)}": not (row.landing or 0.0) <= LATEST,
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
