"""The operator's page has the facts, at 80 columns and without colour too."""

import io
import threading
import time
from math import inf

import numpy as np
import pytest
from rich.console import Console

from skydog.flight.base import Sent
from skydog.flight.rovers import Twist
from skydog.flight.station import Commands, Frame
from skydog.flight.supervisor import Change, Mode
from skydog.lab.adapters import Status
from skydog.lab.dashboard import LINES, MAP, Dashboard, page
from skydog.lab.emulation.chain import a_site
from skydog.lab.eyes import Sighting
from skydog.lab.flightlog import Timing
from skydog.lab.outcome import View
from skydog.lab.preflight import Check
from skydog.lab.setup import world
from skydog.lab.site import Mission

PATIENCE = 30.0  # s
SITE = a_site(Mission(sheepdog="strombom", steps=300), 6.0, "dds")


def a_view(mode=Mode.MISSION, **changed):
    frame = Frame(
        np.array([[1.25, 5.0, 1.98]]),
        np.array([[3.3, 4.5], [3.6, 4.0], [4.5, 2.1]]),
        np.zeros(3),
        np.ones(1, bool),
        np.array([True, False, True]),
    )
    none = np.array([-1])
    sent = Sent(
        np.array([int(mode)]),
        np.array([[False]]),
        Commands(
            np.array([[[0.3, 0.4, 0.0]]]),
            np.zeros((1, 1, 2)),
            Twist(np.array([[0.12, 0.0, -0.34]]), np.zeros((1, 3))),
        ),
        np.array([[0.01, 0.01, 0.32, 0.02]]),
        Change(none, none, none),
    )
    view = View(
        now=12.34,
        mode=mode,
        step=45,
        sighting=Sighting(frame, np.zeros(1), (None, None, "frozen", None), (0.0,) * 4),
        sent=sent,
        status=(Status(0.8, True),),
        checks=(Check("uav1 answers", True, "yes"), Check("rate of ugv2", False, "70 Hz", "fix")),
        lines=tuple(f"line {number}" for number in range(20)),
        timing=Timing(np.array([0.32]), 0.0004, 0.0021, 0.0032, 7),
        rates=(100.0, 99.0, 68.0, 100.0),
    )
    return view._replace(**changed)


def drawn(view, width):
    text = io.StringIO()
    console = Console(file=text, width=width, no_color=True)
    console.print(page(view, SITE, world(SITE).arena, width))
    return text.getvalue()


def row(text, name):
    """The line of a robot, with one space between its words."""
    return next(" ".join(line.split()) for line in text.splitlines() if line.startswith(name))


@pytest.mark.parametrize("width", [80, 120])
def test_a_page_has_what_an_operator_must_know(width):
    text = drawn(a_view(), width)
    assert max(map(len, text.splitlines())) <= width
    assert "MISSION   12.3 s   step 45 of 300" in text
    assert "uav1 1.25 5.00 1.98 0.01 s 100 0.50 m/s 80%, flies" in row(text, "uav1")
    assert "ugv2 3.60 4.00 0.32 s frozen 68 0.00 m/s" in row(text, "ugv2")
    assert "ugv3 4.50 2.10 0.02 s 100 -0.34 m/s" in row(text, "ugv3")
    assert "tick late 0.4 ms, pose to command 3.2 ms, decision 2.1 ms, 7 deadlines missed" in text
    assert "space stop" in text
    assert "line 19" in text
    assert f"line {20 - LINES}" in text
    assert f"line {19 - LINES}\n" not in text


@pytest.mark.parametrize("mode", Mode)
def test_the_mode_can_be_read_without_colour(mode):
    assert drawn(a_view(mode), 80).strip().startswith(mode.name.replace("_", " "))


@pytest.mark.parametrize("mode", Mode)
def test_checks_that_fail_are_shown_on_the_ground_alone(mode):
    text = drawn(a_view(mode), 80)
    assert ("rate of ugv2: 70 Hz; fix" in text) == (mode in (Mode.DISARMED, Mode.READY))
    assert "uav1 answers" not in text


def test_many_checks_that_fail_are_counted():
    many = tuple(Check(f"check {number}", False, "no") for number in range(20))
    text = drawn(a_view(Mode.DISARMED, checks=many), 80)
    assert "check 0" in text
    assert "and 14 more" in text


def test_what_was_never_seen_or_does_not_answer_is_said():
    view = a_view(status=(Status(None, None, connected=False),))
    view = view._replace(sent=view.sent._replace(age=np.array([[inf, 0.0, 0.0, 0.0]])))
    assert "never not believed" in drawn(view, 120)
    assert "does not answer" in drawn(view, 120)


def test_a_wide_page_has_a_map_of_the_cage():
    text = drawn(a_view(), 120)
    assert text.count("·") > 50
    assert {"D", "o", "+"} < set("".join(line[-MAP[0] :] for line in text.splitlines()[-20:]))
    assert "·" not in drawn(a_view(), 80)


def test_a_body_outside_the_cage_or_nowhere_is_left_out_of_the_map():
    view = a_view()
    far = view.sighting.frame._replace(dogs=np.array([[-50.0, 1e6, 0.0]]))
    assert "uav1" in drawn(view._replace(sighting=view.sighting._replace(frame=far)), 120)


def wait_for(text, what):
    end = time.monotonic() + PATIENCE
    while what not in text.getvalue():
        assert time.monotonic() < end, text.getvalue()
        time.sleep(0.005)


def test_a_terminal_shows_the_latest_view():
    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=80, no_color=True)
    with Dashboard(console, SITE) as board:
        board.said("not a line of its own")
        board.show(a_view())
        wait_for(text, "MISSION")
        board.show(a_view(Mode.HOLD))
        wait_for(text, "HOLD")
        board.show(a_view(Mode.LANDING, lines=("the last line",)))
    assert "the last line" in text.getvalue()
    assert "not a line of its own" not in text.getvalue()
    assert "dashboard" not in {thread.name for thread in threading.enumerate()}


def test_without_a_terminal_lines_are_printed_as_they_come_and_no_page():
    text = io.StringIO()
    with Dashboard(Console(file=text, width=80), SITE) as board:
        board.show(a_view())
        board.said("a line [of] " + 20 * "words, ")
        wait_for(text, "a line")
        board.said("the last line")
    assert text.getvalue() == "a line [of] " + 20 * "words, " + "\nthe last line\n"


def test_whoever_shows_does_not_wait_for_a_terminal_that_is_stopped():
    class Stopped(io.StringIO):
        goes_on, waits = threading.Event(), threading.Event()

        def write(self, text):
            self.waits.set()
            self.goes_on.wait(PATIENCE)
            return super().write(text)

    text = Stopped()
    with Dashboard(Console(file=text, width=80), SITE) as board:
        board.said("one")
        assert text.waits.wait(PATIENCE)
        board.said("two")
        board.show(a_view())
        text.goes_on.set()
    assert text.getvalue() == "one\ntwo\n"
