"""The ways to stop a flight: a queue, keys, a file, a dead-man button."""

import os
import pty
import struct
import sys
import termios
import time

import pytest

from skydog.errors import Refusal
from skydog.flight.supervisor import Order
from skydog.lab import orders as ways
from skydog.lab.orders import KEYS, LANDS_AFTER, MOST, Gamepad, Keys, Orders, StopFile

PATIENCE = 30.0  # s


@pytest.fixture
def orders():
    return Orders()


def taken(orders):
    """All orders that wait, in the order in which they are taken."""
    found = []
    while (order := orders.take()[0]) != Order.NONE:
        found.append(order)
    return found


def test_orders_are_taken_in_turn_and_then_there_is_none(orders):
    orders.give(Order.ARM, "one")
    orders.give(Order.TAKE_OFF, "another")
    assert orders.take() == (Order.ARM, "one")
    assert orders.take() == (Order.TAKE_OFF, "another")
    assert orders.take() == (Order.NONE, "")


def test_what_stops_is_taken_first_the_gravest_before_all(orders):
    given = (Order.ARM, Order.HOLD, Order.STOP, Order.LAND, Order.EMERGENCY, Order.RESET)
    for order in given:
        orders.give(order, "")
    assert taken(orders) == [
        Order.EMERGENCY,
        Order.LAND,
        Order.STOP,
        Order.HOLD,
        Order.RESET,
    ]


def test_a_hold_undoes_the_resume_that_came_before_it_and_not_the_one_after(orders):
    orders.give(Order.RESUME, "")
    orders.give(Order.HOLD, "")
    orders.give(Order.RESUME, "")
    assert taken(orders) == [Order.HOLD, Order.RESUME]


def test_a_flood_of_orders_loses_no_stop(orders):
    orders.give(Order.LAND, "")
    for _ in range(10 * MOST):
        orders.give(Order.ARM, "")
    assert taken(orders) == [Order.LAND] + [Order.ARM] * (MOST - 1)


@pytest.fixture
def terminal(monkeypatch):
    """A terminal: what is typed, and the file that stands for the standard input."""
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "wb", 0) as typed, os.fdopen(theirs, "rb", 0) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield typed


def wait_for(orders, count=1):
    """The next orders, each of which must come."""
    found = []
    end = time.monotonic() + PATIENCE
    while len(found) < count:
        assert time.monotonic() < end, f"only {found} came"
        if (order := orders.take()[0]) != Order.NONE:
            found.append(order)
        time.sleep(0.001)
    return found


def test_each_key_gives_its_order_and_another_none(terminal, orders):
    with Keys(orders):
        for key, order in KEYS.items():
            terminal.write(b"x" + key.encode())
            assert wait_for(orders) == [order]


def test_a_key_that_is_held_down_counts_once(terminal, orders, monkeypatch):
    monkeypatch.setattr(ways, "REPEATS", PATIENCE)  # however slowly the test runs
    with Keys(orders):
        terminal.write(b"hhhE")
        assert sorted(wait_for(orders, 2)) == [Order.HOLD, Order.EMERGENCY]
        assert taken(orders) == []


def test_q_says_that_the_operator_wants_to_go(terminal, orders):
    with Keys(orders):
        terminal.write(b"qa")
        wait_for(orders)
    assert orders.quits


def test_the_terminal_is_as_before_and_its_thread_ends(terminal, orders):
    before = termios.tcgetattr(sys.stdin)
    keys = Keys(orders)
    with keys:
        assert termios.tcgetattr(sys.stdin)[3] & termios.ICANON == 0
    assert termios.tcgetattr(sys.stdin) == before
    assert not keys._thread.is_alive()


def test_without_a_terminal_there_are_no_keys(orders, monkeypatch):
    with open(os.devnull) as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        with Keys(orders) as keys:
            assert not keys._thread.is_alive()


def test_a_stop_file_holds_and_then_lands_until_it_is_gone(tmp_path, orders):
    path = tmp_path / "STOP"
    stop = StopFile(path, orders)
    stop.look(0.0)
    assert (taken(orders), stop.problem) == ([], "")
    path.touch()
    for tenth in range(1, 11):
        stop.look(0.1 * tenth)
    assert (taken(orders), stop.problem) == ([Order.HOLD], "file STOP is there")
    for tenth in range(11, 60):
        stop.look(0.1 * tenth)
    assert taken(orders) == [Order.LAND]
    path.unlink()
    stop.look(6.0)
    assert stop.problem == ""
    path.touch()
    stop.look(6.2)
    assert taken(orders) == [Order.HOLD]


@pytest.mark.parametrize(
    ("word", "order"),
    [
        ("hold", Order.HOLD),
        ("LAND\n", Order.LAND),
        ("emergency now", Order.EMERGENCY),
        ("what?", Order.HOLD),
        ("\udcff", Order.HOLD),
    ],
)
def test_the_first_word_of_a_stop_file_may_ask_for_more(tmp_path, orders, word, order):
    (tmp_path / "STOP").write_bytes(word.encode(errors="surrogateescape"))
    StopFile(tmp_path / "STOP", orders).look(0.0)
    assert taken(orders) == [order]


def test_a_word_that_is_written_after_the_file_was_made_is_heard(tmp_path, orders):
    path = tmp_path / "STOP"
    stop = StopFile(path, orders)
    path.touch()
    stop.look(0.0)
    path.write_text("land")
    stop.look(0.2)
    assert taken(orders) == [Order.LAND, Order.HOLD]


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo, lambda path: path.symlink_to("nowhere")])
def test_a_stop_file_that_cannot_be_read_holds(tmp_path, orders, make):
    make(tmp_path / "STOP")
    StopFile(tmp_path / "STOP", orders).look(0.0)
    assert taken(orders) == [Order.HOLD]


class Pad:
    """The other end of a gamepad: a pipe."""

    def __init__(self, path, orders):
        os.mkfifo(path)
        self.gamepad = Gamepad(str(path), orders)
        self._pipe = os.open(path, os.O_WRONLY)
        self.gamepad.look(0.0)

    def press(self, number, down=True, kind=1):
        assert self._pipe is not None
        os.write(self._pipe, struct.pack("<IhBB", 0, int(down), kind, number))

    def unplug(self):
        if self._pipe:
            os.close(self._pipe)
        self._pipe = None


@pytest.fixture
def pad(tmp_path, orders):
    made = Pad(tmp_path / "js0", orders)
    yield made
    made.unplug()
    made.gamepad.close()


def test_nothing_is_stopped_by_a_button_that_was_never_held(pad, orders):
    pad.gamepad.look(10.0)
    assert taken(orders) == []
    assert pad.gamepad.problem == "the dead-man button is let go"


def test_a_button_that_was_held_before_we_looked_is_held(pad, orders):
    pad.press(0, kind=0x81)
    pad.gamepad.look(1.0)
    assert pad.gamepad.problem == ""


@pytest.mark.parametrize("unplugged", [False, True])
def test_a_button_that_is_let_go_holds_and_after_two_seconds_lands(pad, orders, unplugged):
    pad.press(0)
    pad.gamepad.look(1.0)
    assert taken(orders) == [Order.RESUME]
    pad.gamepad.look(100.0)
    assert taken(orders) == []
    pad.unplug() if unplugged else pad.press(0, down=False)
    pad.gamepad.look(101.0)
    assert taken(orders) == [Order.HOLD]
    pad.gamepad.look(101.0 + LANDS_AFTER - 0.1)
    assert taken(orders) == []
    pad.gamepad.look(101.0 + LANDS_AFTER + 0.1)
    assert taken(orders) == [Order.LAND]
    pad.gamepad.look(200.0)
    assert taken(orders) == []


def test_a_button_that_is_held_again_goes_on(pad, orders):
    for down in (True, False, True):
        pad.press(0, down)
        pad.gamepad.look(1.0)
    assert taken(orders) == [Order.HOLD, Order.RESUME]
    pad.gamepad.look(100.0)
    assert taken(orders) == []


def test_a_button_that_is_touched_between_two_looks_holds(pad, orders):
    pad.press(0)
    pad.press(0, down=False)
    pad.gamepad.look(1.0)
    assert taken(orders) == [Order.HOLD]


def test_the_second_button_is_the_emergency_and_others_are_nothing(pad, orders):
    pad.press(0)
    pad.press(3)
    pad.press(0, down=False, kind=2)  # an axis
    pad.press(1)
    pad.gamepad.look(1.0)
    pad.press(1, down=False)
    pad.gamepad.look(1.1)
    assert taken(orders) == [Order.EMERGENCY]
    assert pad.gamepad.problem == ""


def test_a_gamepad_that_is_not_there_is_refused(tmp_path, orders):
    with pytest.raises(Refusal, match=r"safety\.gamepad .*No such file"):
        Gamepad(str(tmp_path / "js7"), orders)
