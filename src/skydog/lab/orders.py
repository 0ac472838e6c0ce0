"""The operator's ways to stop a flight: keys, a file, a topic, a gamepad's dead-man button."""

import contextlib
import os
import select
import struct
import sys
import termios
import threading
import time
import tty
from math import inf
from pathlib import Path
from queue import SimpleQueue

from skydog.errors import Refusal
from skydog.flight.supervisor import Order

LANDS_AFTER = 2.0  # s for which a dead-man button is let go, or a stop file is there: land

KEYS = {
    " ": Order.STOP,
    "a": Order.ARM,
    "d": Order.DISARM,
    "t": Order.TAKE_OFF,
    "h": Order.HOLD,
    "r": Order.RESUME,
    "l": Order.LAND,
    "E": Order.EMERGENCY,
    "R": Order.RESET,
}
"""What each key asks for; of the two that are grave, the capital."""

HELP = (
    "space stop (again: land, again: emergency)  a arm  t take off  h hold  r resume  l land  "
    "E emergency  R reset  q quit, on the ground"
)

STOPS = (Order.EMERGENCY, Order.LAND, Order.STOP, Order.HOLD)
"""Orders that are taken before any other, the gravest first."""

REPEATS = 0.1  # s: a terminal repeats a key that is held down faster than this, a hand hardly does
MOST = 16  # orders that wait

WORDS = {"hold": Order.HOLD, "land": Order.LAND, "emergency": Order.EMERGENCY}


class Orders:
    """A queue of orders from anywhere: `give` by any thread or signal, `take` by the loop alone."""

    def __init__(self) -> None:
        self._given: SimpleQueue[tuple[Order, str]] = SimpleQueue()  # no lock: see signal handlers
        self._waiting: list[tuple[Order, str]] = []
        self.quits = False  # whether the operator wants to go, once nothing flies

    def give(self, order: Order, by: str) -> None:
        """An order, and who gave it. One that stops undoes those before it that do not."""
        self._given.put((order, by))

    def forget(self) -> None:
        """Drop all that was given and not taken."""
        while self.take()[0] != Order.NONE:
            pass

    def take(self) -> tuple[Order, str]:
        """The next order; `Order.NONE` if there is none."""
        while not self._given.empty():
            given = self._given.get()
            if given[0] in STOPS:
                self._waiting = [each for each in self._waiting if each[0] in STOPS]
            self._waiting.append(given)
        self._waiting.sort(key=_rank)
        del self._waiting[MOST:]
        return self._waiting.pop(0) if self._waiting else (Order.NONE, "")


def _rank(given: tuple[Order, str]) -> int:
    return STOPS.index(given[0]) if given[0] in STOPS else len(STOPS)


class Keys:
    """Keys of the terminal, while it is one. The terminal is as before afterwards.

    A key that is held down counts once or twice: whoever leans on the space bar cuts no motors.
    """

    def __init__(self, orders: Orders):
        self._orders, self._closed = orders, threading.Event()
        self._before: list | None = None
        self._thread = threading.Thread(target=self._listen, name="keys", daemon=True)

    def __enter__(self) -> "Keys":
        if sys.stdin.isatty():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        if self._before is not None:
            self._thread.join()
            with contextlib.suppress(termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def _listen(self) -> None:
        before, came = "", -inf
        with contextlib.suppress(OSError):  # the terminal is gone
            while not self._closed.is_set():
                ready, _, _ = select.select([sys.stdin], [], [], 0.1)
                if not ready:
                    continue
                key = os.read(sys.stdin.fileno(), 1).decode(errors="replace")
                if not key:
                    return
                now = time.monotonic()
                if key in KEYS and not (key == before and now - came < REPEATS):
                    self._orders.give(KEYS[key], f"key {key!r}")
                if key == "q":
                    self._orders.quits = True
                before, came = key, now


class _Brake:
    """Holds when it is pulled, and lands when it stays so for two seconds."""

    def __init__(self, orders: Orders, by: str, given: Order = Order.NONE):
        self._orders, self._by = orders, by
        self._given, self._since = given, inf

    def pull(self, order: Order, now: float) -> None:
        """It is pulled, and asks for an order."""
        if order != self._given:
            self._given, self._since = order, now
            self._orders.give(order, self._by)
        elif order == Order.HOLD and now - self._since > LANDS_AFTER:
            self._since = inf
            self._orders.give(Order.LAND, self._by)

    def release(self) -> None:
        """It is no longer pulled."""
        self._given = Order.NONE


class StopFile:
    """While a file exists everything holds, then lands; its first word may ask for more at once.

    The words are hold, land and emergency.
    """

    def __init__(self, path: Path, orders: Orders):
        self._path, self._brake = path, _Brake(orders, f"file {path.name}")
        self._due = -inf
        self.problem = ""  # why nothing may take off

    def look(self, now: float) -> None:
        """Look whether it is there, ten times a second at most."""
        if now < self._due:
            return
        self._due = now + 0.1
        if os.path.lexists(self._path):
            self.problem = f"file {self._path.name} is there"
            self._brake.pull(self._word(), now)
        else:
            self.problem = ""
            self._brake.release()

    def _word(self) -> Order:
        words = []
        with contextlib.suppress(OSError, ValueError):
            if self._path.is_file():  # a pipe would keep us waiting
                with self._path.open() as file:
                    words = file.read(20).lower().split()
        return WORDS.get(words[0], Order.HOLD) if words else Order.HOLD


class Gamepad:
    """A dead-man button: let go, everything holds; for two seconds, it lands. Linux alone.

    The first button is held to fly, and held again to go on; the second is the emergency.
    """

    EVENT = struct.Struct("<IhBB")  # time in ms, value, type, number
    BUTTON, AT_START = 1, 0x80  # types; the latter is added where the device tells its state

    def __init__(self, device: str, orders: Orders):
        self._orders = orders
        # Nothing flies yet, so that there is nothing to hold.
        self._brake = _Brake(orders, "dead-man button", given=Order.HOLD)
        self._held = False
        try:
            self._handle = os.open(device, os.O_RDONLY | os.O_NONBLOCK)
        except (OSError, ValueError) as problem:
            why = getattr(problem, "strerror", None) or problem
            raise Refusal(
                f"safety.gamepad {device!r}: {why}; connect it, or leave it out"
            ) from None

    @property
    def problem(self) -> str:
        """Why nothing may take off."""
        return "" if self._held else "the dead-man button is let go"

    def look(self, now: float) -> None:
        """Read what was pressed since. A gamepad that is gone is let go."""
        try:
            while len(event := os.read(self._handle, self.EVENT.size)) == self.EVENT.size:
                _, value, kind, number = self.EVENT.unpack(event)
                if kind & ~self.AT_START == self.BUTTON:
                    self._press(number, bool(value))
            self._held = False
        except BlockingIOError:
            pass
        except OSError:
            self._held = False
        if not self._held:
            self._brake.pull(Order.HOLD, now)

    def close(self) -> None:
        """Let go of the device."""
        os.close(self._handle)

    def _press(self, number: int, down: bool) -> None:
        if number == 1 and down:
            self._orders.give(Order.EMERGENCY, "gamepad")
        if number == 0:
            self._held = down
            if down:
                self._brake.release()
                self._orders.give(Order.RESUME, "dead-man button")
