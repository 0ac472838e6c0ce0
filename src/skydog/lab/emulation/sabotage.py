"""The base station's process of a fault campaign: it flies, and breaks as it is told.

The shepherd, the clock and the disk are broken from within; all else is as in any flight.
"""

import contextlib
import multiprocessing
import os
import resource
import signal
import threading
import time
from collections.abc import Callable
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from skydog import processes
from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import running
from skydog.lab.flying import BaseStation
from skydog.lab.orders import Orders
from skydog.lab.setup import setup
from skydog.world.mission import Shepherd
from skydog.world.params import World, traced
from skydog.world.state import State

PATIENCE = 6.0  # s for the pre-flight checks to pass


class Said(NamedTuple):
    """What the base station told of itself, and when."""

    t: float
    what: str
    value: Any


class Breakable:
    """The base station's process, seen from without."""

    def __init__(self, said: Callable[[str], None] | None):
        self.seen: list[Said] = []
        self._said = said
        self._ended = threading.Event()
        context = multiprocessing.get_context("spawn")
        self._wire, self._theirs = context.Pipe()
        self.process = context.Process(
            target=run, args=(self._theirs,), name="base station", daemon=True
        )

    def start(self) -> None:
        """Start it, if it has not: it imports what it needs, and waits for its site."""
        if self.process.pid is None:
            processes.start(self.process)
            self._theirs.close()
            threading.Thread(target=self._listen, name="base station", daemon=True).start()

    def close(self) -> None:
        """End it."""
        if self.process.pid is not None:
            self.process.kill()
            self.process.join()

    @property
    def ended(self) -> bool:
        """Whether it has said its last."""
        return self._ended.is_set()

    def tell(self, *what: Any) -> None:
        """Tell it something, if it lives."""
        with contextlib.suppress(OSError):
            self._wire.send(what)

    def modes(self, since: float = -inf, until: float = inf) -> list[Mode]:
        """The modes that it entered."""
        return [Mode(one.value) for one in self.of("mode", since, until)]

    def of(self, what: str, since: float = -inf, until: float = inf) -> list[Said]:
        """All that it told of a kind."""
        return [one for one in list(self.seen) if one.what == what and since <= one.t < until]

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                one = Said(*self._wire.recv())
                self.seen.append(one)
                if one.what == "line" and self._said is not None:
                    self._said(one.value)
        self._ended.set()


def run(wire: Connection) -> None:
    """Fly the site that comes over the wire, then do as the wire says.

    What comes: first the site and a folder for its log; then "policy", "clock", "disk", with a
    value; "measure"; "land". What goes, each with its time: "line", "mode", "measure", and at last
    "over" with the longest time that something flew blind, or "refused" with the reason.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError):
        site, folder = wire.recv()
        Sabotage(wire, folder).fly(site)


class Sabotage:
    """A flight that breaks as it is told."""

    def __init__(self, wire: Connection, folder: Path):
        self._wire, self._folder = wire, folder
        self._lock = threading.Lock()
        self._policy: str | None = None
        self._lands = False
        self._mode = -1
        self._station: BaseStation | None = None
        self._orders = Orders()
        self._operator = running.Automatic(self._orders, PATIENCE, lambda _: self._lands)
        self._time, self._time_ns = time.time, time.time_ns
        self._shift = 0.0  # s

    def fly(self, site: Any) -> None:
        """Fly a site to the end."""
        made = setup(site)
        made = made._replace(shepherd=self._breakable(made.shepherd))
        threading.Thread(target=self._listen, name="sabotage", daemon=True).start()
        try:
            outcome = running.fly(
                site,
                self._orders,
                self._look,
                self._folder / "log",
                said=lambda line: self._tell("line", line),
                made=made,
                here=self._folder,
            )
            self._tell("over", outcome.times.blind)
        except Refusal as refusal:
            self._tell("refused", str(refusal))

    def _look(self, station: BaseStation) -> bool:
        """In every tick: tell of a new mode, and do what an operator does."""
        self._station = station
        mode = int(station.memory.supervisor.mode[0])
        if mode != self._mode:
            self._mode = mode
            self._tell("mode", mode)
        return self._operator(station)

    def _breakable(self, shepherd: Shepherd) -> Shepherd:
        """The shepherd, behind a call that may hang, or return what is no number."""
        whole = traced(shepherd)

        def broken(world: World, state: State) -> Float[Array, "dogs 2"]:
            moves = whole(world, state)
            shape = jax.ShapeDtypeStruct(moves.shape, moves.dtype)
            return jax.pure_callback(self._break, shape, moves)

        return broken

    def _break(self, moves: Any) -> np.ndarray:
        if self._policy == "hangs":
            threading.Event().wait()
        decided = np.array(moves)
        return np.full_like(decided, np.nan) if self._policy == "nan" else decided

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                what, *value = self._wire.recv()
                if what == "land":
                    self._lands = True
                elif what == "policy":
                    self._policy = value[0]
                elif what == "clock":
                    self._step_clock(value[0] or 0.0)
                elif what == "disk":
                    self._fill_disk()
                elif what == "measure":
                    self._tell("measure", (_memory(), self._packets()))
        self._lands = True  # nobody is there any more

    def _step_clock(self, shift: float) -> None:
        self._shift = shift
        time.time = lambda: self._time() + self._shift
        time.time_ns = lambda: self._time_ns() + round(self._shift * 1e9)

    def _fill_disk(self) -> None:
        """No file may grow beyond the size that the log has now."""
        size = max(file.stat().st_size for file in (self._folder / "log").iterdir())
        _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))

    def _packets(self) -> int:
        source = None if self._station is None else self._station.wires.source
        return getattr(source, "packets", 0)

    def _tell(self, what: str, value: Any) -> None:
        with self._lock, contextlib.suppress(OSError):
            self._wire.send((time.monotonic(), what, value))


def _memory() -> int:
    """Bytes of memory that this process has now."""
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")
