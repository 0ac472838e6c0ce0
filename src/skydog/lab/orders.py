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
from collections import deque
from pathlib import Path
from types import TracebackType

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
    "E emergency  R reset"
)

WORDS = {"hold": Order.HOLD, "land": Order.LAND, "emergency": Order.EMERGENCY}


class Orders:
    """A queue of orders from anywhere: `give` by any thread, `take` by the loop, one at a time."""

    def __init__(self) -> None:
        self._queue: deque[tuple[Order, str]] = deque(maxlen=16)

    def give(self, order: Order, by: str) -> None:
        """An order, and who gave it."""
        if order in (Order.EMERGENCY, Order.STOP, Order.LAND):
            self._queue.appendleft((order, by))
        else:
            self._queue.append((order, by))

    def take(self) -> tuple[Order, str]:
        """The next order; `Order.NONE` if there is none."""
        try:
            return self._queue.popleft()
        except IndexError:
            return Order.NONE, ""


class Keys:
    """Keys of the terminal, while it is one. The terminal is as before afterwards."""

    def __init__(self, orders: Orders):
        self._orders, self._closed = orders, threading.Event()
        self._before: list | None = None

    def __enter__(self) -> "Keys":
        if sys.stdin.isatty():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            threading.Thread(target=self._listen, name="keys", daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._closed.set()
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def _listen(self) -> None:
        while not self._closed.is_set():
            ready, _, _ = select.select([sys.stdin], [], [], 0.1)
            if not ready:
                continue
            key = os.read(sys.stdin.fileno(), 1).decode(errors="replace")
            if not key:
                return
            if key in KEYS:
                self._orders.give(KEYS[key], f"key {key!r}")


class StopFile:
    """While a file exists everything holds, then lands; its first word may ask for more at once.

    The words are hold, land and emergency.
    """

    def __init__(self, path: Path, orders: Orders):
        self._path, self._orders = path, orders
        self._since: float | None = None
        self._landed = False
        self._due = 0.0

    def look(self, now: float) -> None:
        """Look whether it is there, ten times a second at most."""
        if now < self._due:
            return
        self._due = now + 0.1
        if not self._path.exists():
            self._since, self._landed = None, False
            return
        by = f"file {self._path.name}"
        if self._since is None:
            self._since = now
            self._orders.give(self._word(), by)
        elif now - self._since > LANDS_AFTER and not self._landed:
            self._landed = True
            self._orders.give(Order.LAND, by)

    def _word(self) -> Order:
        word = ""
        with contextlib.suppress(OSError, ValueError), self._path.open() as file:
            word = file.read(20).strip().lower()
        return WORDS.get(word, Order.HOLD)


class Gamepad:
    """A dead-man button: let go, everything holds; for two seconds, it lands. Linux alone.

    The first button is held to fly, and held again to go on; the second is the emergency.
    """

    EVENT = struct.Struct("<IhBB")  # time in ms, value, type, number

    def __init__(self, device: str, orders: Orders):
        from skydog.errors import Refusal

        self._orders = orders
        self.held = False
        self._let_go = time.monotonic()
        self._landed = True
        try:
            self._handle = os.open(device, os.O_RDONLY | os.O_NONBLOCK)
        except (OSError, ValueError) as problem:
            why = getattr(problem, "strerror", None) or problem
            raise Refusal(
                f"safety.gamepad {device!r}: {why}; connect it, or leave it out"
            ) from None

    def look(self, now: float) -> None:
        """Read what was pressed since. A gamepad that is gone is let go."""
        try:
            while len(event := os.read(self._handle, self.EVENT.size)) == self.EVENT.size:
                _, value, kind, number = self.EVENT.unpack(event)
                if kind & 0x7F == 1:
                    self._press(number, bool(value), now)
        except BlockingIOError:
            pass
        except OSError:
            self._press(0, False, now)
        if not self.held and now - self._let_go > LANDS_AFTER and not self._landed:
            self._landed = True
            self._orders.give(Order.LAND, "dead-man button")

    def close(self) -> None:
        """Let go of the device."""
        os.close(self._handle)

    def _press(self, number: int, down: bool, now: float) -> None:
        if number == 1 and down:
            self._orders.give(Order.EMERGENCY, "gamepad")
        if number == 0 and down != self.held:
            self.held = down
            self._landed = down is False and self._landed
            if down:
                self._landed = False
                self._orders.give(Order.RESUME, "dead-man button")
            else:
                self._let_go = now
                self._orders.give(Order.HOLD, "dead-man button")
