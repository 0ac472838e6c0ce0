"""The supervisor's table, and a million random sequences of everything that can happen."""

import numpy as np
import pytest

from skydog.flight import supervisor
from skydog.flight.supervisor import EVENTS, TRANSITIONS, Mode, Order

FLYING = (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD)
QUIET = {name: np.array([False]) for name in EVENTS if not name.startswith("operator")} | {
    "ready": np.array([True]),
    "well": np.array([True]),
    "at height": np.array([False]),
    "climbing": np.array([False]),
}


def stepped(mode, order=Order.NONE, held=False, now=5.0, **happens):
    memory = supervisor.Memory(np.array([int(mode)]), np.zeros(1), np.array([held]))
    told = QUIET | {name.replace("_", " "): np.array([value]) for name, value in happens.items()}
    after, change = supervisor.step(memory, np.array([int(order)]), told, now)
    return Mode(after.mode[0]), after, change


def test_every_event_of_the_table_is_one_that_can_happen():
    assert {event for _, event in TRANSITIONS} <= set(EVENTS)


def test_only_a_human_leads_to_an_emergency_and_out_of_it():
    for (before, event), after in TRANSITIONS.items():
        if Mode.EMERGENCY in (before, after):
            assert event.startswith("operator: ")


def test_nothing_but_a_take_off_order_leads_from_the_ground_into_the_air():
    ground = (Mode.DISARMED, Mode.READY, Mode.EMERGENCY)
    ways = {(b, e) for (b, e), a in TRANSITIONS.items() if b in ground and a not in ground}
    assert ways == {(Mode.READY, "operator: take off")}


def test_a_landing_ends_on_the_ground_or_by_a_human_alone():
    ways = {event: after for (mode, event), after in TRANSITIONS.items() if mode == Mode.LANDING}
    assert ways == {
        "landed": Mode.DISARMED,
        "operator: stop": Mode.EMERGENCY,
        "operator: emergency": Mode.EMERGENCY,
    }


@pytest.mark.parametrize("order", [Order.ARM, Order.TAKE_OFF])
@pytest.mark.parametrize("mode", [Mode.DISARMED, Mode.READY])
def test_nothing_arms_or_takes_off_unless_the_checks_pass(mode, order):
    after, _, change = stepped(mode, order, ready=False)
    assert after == Mode.DISARMED
    assert change.refused[0] == order


def test_an_order_that_the_table_does_not_know_is_refused_and_named():
    after, _, change = stepped(Mode.DISARMED, Order.TAKE_OFF)
    assert (after, change.refused[0], change.event[0]) == (Mode.DISARMED, Order.TAKE_OFF, -1)


def test_each_stop_is_a_step_further():
    mode = Mode.MISSION
    for then in (Mode.HOLD, Mode.LANDING, Mode.EMERGENCY):
        mode, _, _ = stepped(mode, Order.STOP)
        assert mode == then
    assert stepped(mode, Order.STOP)[0] == Mode.EMERGENCY


def test_a_hold_ends_by_itself_unless_an_operator_has_asked_for_it():
    assert stepped(Mode.HOLD, at_height=True)[0] == Mode.MISSION
    held = stepped(Mode.MISSION, Order.HOLD)[1]
    assert held.held[0]
    assert stepped(Mode.HOLD, held=True, at_height=True)[0] == Mode.HOLD
    assert stepped(Mode.HOLD, Order.RESUME, held=True, at_height=True)[0] == Mode.MISSION


def test_a_hold_by_itself_becomes_an_operators_when_he_asks_for_it():
    _, after, change = stepped(Mode.HOLD, Order.HOLD, well=False)
    assert after.held[0]
    assert change.refused[0] == Order.NONE


def test_the_graver_of_two_events_counts():
    _, _, change = stepped(Mode.MISSION, eyes_stale=True, eyes_stale_long=True, well=False)
    assert EVENTS[change.event[0]] == "eyes stale long"


def test_an_emergency_stays_until_it_is_reset():
    assert stepped(Mode.EMERGENCY, Order.ARM)[0] == Mode.EMERGENCY
    assert stepped(Mode.EMERGENCY, Order.RESET)[0] == Mode.DISARMED


def test_a_mode_that_is_kept_keeps_when_it_was_entered():
    assert stepped(Mode.MISSION)[1].since[0] == 0.0
    assert stepped(Mode.MISSION, Order.LAND)[1].since[0] == 5.0
