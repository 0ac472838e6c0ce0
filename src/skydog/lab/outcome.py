"""What there is to see of a flight while it lasts, and what it leaves."""

from typing import NamedTuple

from skydog.flight.base import Sent
from skydog.flight.supervisor import Mode
from skydog.lab.adapters import Status
from skydog.lab.eyes import Sighting
from skydog.lab.flightlog import Timing
from skydog.lab.preflight import Check


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
