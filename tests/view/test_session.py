from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.view.session import (
    ALONG,
    TOWARD,
    Settings,
    advance,
    new,
    update,
    view,
    with_preset,
)
from skydog.world import mission
from skydog.world.presets import PRESETS, preset

SHEPHERDS = {"strombom": Strombom(), "h-ddpg-4x4": store.load("h-ddpg-4x4")}


def begun(policy="strombom"):
    return advance(new(with_preset(Settings(policy), "paper")), SHEPHERDS, 0)


def places(session, flight=0):
    state = session.flights[flight].state
    return np.asarray(state.sheep), np.asarray(state.dogs)


@pytest.mark.parametrize("policy", SHEPHERDS)
def test_a_session_flies_a_mission_as_rollout_does(policy):
    session = begun(policy=policy)
    state = session.flights[0].state
    trace = mission.rollout(preset("paper"), SHEPHERDS[policy], state, 45)
    for steps in (1, 3, 0, 41):
        session = advance(session, SHEPHERDS, steps)
    sheep, dogs = places(session)
    np.testing.assert_allclose(sheep, trace.sheep[45], atol=1e-5)
    np.testing.assert_allclose(dogs, trace.dogs[45], atol=1e-5)
    assert int(session.flights[0].step) == 45
    assert float(session.flights[0].flown) == pytest.approx(
        float(metrics.distance(trace)), abs=1e-4
    )


def test_noise_is_that_of_a_rollout_with_the_case_as_its_key():
    session = update(begun(), {"preset": "strombom2014", "perception": 1.0, "case": 5})
    session = advance(session, SHEPHERDS, 0)
    trace = mission.rollout(
        session.world, SHEPHERDS["strombom"], session.flights[0].state, 20, jax.random.key(5)
    )
    session = advance(session, SHEPHERDS, 20)
    np.testing.assert_allclose(places(session)[0], trace.sheep[20], rtol=1e-5)


def test_a_mission_ends_where_it_is_accomplished_and_goes_on_when_the_goal_moves_away():
    session = advance(begun(), SHEPHERDS, 1000)
    steps = int(session.flights[0].step)
    assert bool(session.overlays[0].done)
    assert session.rests
    assert steps < 1000
    assert int(advance(session, SHEPHERDS, 5).flights[0].step) == steps
    session = advance(update(session, {"hold": ("goal", 0, (4.0, 4.0))}), SHEPHERDS, 5)
    assert int(session.flights[0].step) == steps + 5


def test_a_goal_stays_where_it_was_dragged_and_a_new_flock_starts_opposite():
    session = advance(update(begun(), {"hold": ("goal", 0, (4.0, 4.0))}), SHEPHERDS, 1)
    for message in ({"reset": True}, {"case": 2}, {"dogs": 2}):
        session = advance(update(session, message), SHEPHERDS, 0)
        assert session.settings.goal == (4.0, 4.0)
        assert view(session)["world"]["goal"] == [4.0, 4.0]
        assert np.asarray(places(session)[0]).max() <= 2.0
    session = update(session, {"arena": 3.0})
    assert session.settings.goal is None
    assert update(session, {"goal": (3.0, 0.0)}).settings.goal == (3.0, 0.0)
    with pytest.raises(Refusal, match="5,0"):
        update(session, {"goal": (5.0, 0.0)})
    assert update(session, {"preset": "strombom2014"}).settings.goal is None


@pytest.mark.parametrize("arena", [4.3, 4.4, 5.7])
def test_a_goal_may_be_dragged_into_every_corner_of_every_arena(arena):
    session = advance(update(begun(), {"arena": arena}), SHEPHERDS, 0)
    session = update(session, {"hold": ("goal", 0, (99.0, 99.0))})
    session = advance(update(session, {"reset": True}), SHEPHERDS, 0)
    assert view(session)["world"]["goal"] == [arena, arena]


def test_a_smaller_goal_leaves_room_in_a_smaller_arena():
    session = update(new(Settings("rule", goal_radius=0.5)), {"arena": 1.5})
    assert float(session.world.arena.goal_radius) == 0.5
    assert float(session.world.arena.size) == 1.5


def test_a_reset_is_the_same_case_again_and_another_case_is_another():
    first = begun()
    flown = advance(first, SHEPHERDS, 9)
    again = advance(update(flown, {"reset": True}), SHEPHERDS, 0)
    other = advance(update(flown, {"case": 2}), SHEPHERDS, 0)
    np.testing.assert_array_equal(places(first)[0], places(again)[0])
    assert (places(first)[0] != places(other)[0]).any()
    assert first.start < again.start


@given(
    who=st.sampled_from(["dog", "sheep", "goal"]),
    x=st.floats(-1e6, 1e6, allow_nan=False),
    y=st.floats(-1e6, 1e6, allow_nan=False),
)
def test_who_is_dragged_stays_where_it_may_be(who, x, y):
    session = advance(update(begun(), {"hold": (who, 0, (x, y))}), SHEPHERDS, 2)
    sent = view(session)
    arena = session.world.arena
    beyond = float(session.world.dog.airspace) if who == "dog" else 0.0
    there = np.clip([x, y], -beyond, float(arena.size) + beyond)
    found = {
        "dog": sent["flights"][0]["dogs"][0],
        "sheep": sent["flights"][0]["sheep"][0],
        "goal": sent["world"]["goal"],
    }[who]
    np.testing.assert_allclose(found, there, atol=1e-3)


def test_who_is_dragged_is_where_the_hand_is_at_once_and_flies_no_distance():
    session = update(begun(), {"paused": True})
    session = update(session, {"hold": ("dog", 0, (3.0, 3.5))})
    np.testing.assert_allclose(places(session)[1], [[3.0, 3.5]])
    session = advance(update(session, {"hold": None}), SHEPHERDS, 0)
    np.testing.assert_allclose(places(session)[1], [[3.0, 3.5]])
    assert float(session.flights[0].flown) == 0.0


def test_a_player_flies_no_faster_than_a_dog_and_stops_where_it_is_sent():
    session = update(begun(), {"mode": "fly", "fly": (ALONG, (1.0, -0.5))})
    _, before = places(session)
    _, after = places(advance(session, SHEPHERDS, 1))
    np.testing.assert_allclose(after - before, [[0.1, -0.05]], atol=1e-6)
    session = advance(update(session, {"fly": (TOWARD, (1.23, 2.34))}), SHEPHERDS, 200)
    np.testing.assert_allclose(places(session)[1], [[1.23, 2.34]], atol=1e-5)


def test_the_players_dog_hovers_until_told_and_the_other_dogs_help():
    session = advance(update(begun(), {"dogs": 3, "mode": "fly"}), SHEPHERDS, 0)
    moved = np.abs(places(advance(session, SHEPHERDS, 3))[1] - places(session)[1]).max(axis=1)
    assert moved[0] == 0.0
    assert (moved[1:] > 0.0).all()


def test_a_race_waits_for_the_players_first_move_and_both_fly_the_same_case():
    session = advance(update(begun(), {"mode": "race"}), SHEPHERDS, 5)
    assert session.waits
    assert [int(flight.step) for flight in session.flights] == [0, 0]
    np.testing.assert_array_equal(places(session, 0)[0], places(session, 1)[0])
    watched = advance(begun(), SHEPHERDS, 30)
    session = advance(update(session, {"fly": (ALONG, (0.0, 1.0))}), SHEPHERDS, 30)
    np.testing.assert_allclose(places(session, 1)[0], places(watched)[0], atol=1e-6)
    assert (places(session, 0)[1] != places(session, 1)[1]).any()


def test_a_slider_compiles_nothing_anew():
    traced = []

    def still(world, state):
        traced.append(state)
        return 0.0 * state.dogs

    shepherds = {"still": still}
    session = advance(new(Settings("still")), shepherds, 1)
    once = len(traced)
    for message in (
        {"arena": 9.0, "noise": 0.2},
        {"perception": 0.1, "actuation": 0.3, "speed": 16.0},
        {"hold": ("goal", 0, (2.0, 1.0))},
        {"hold": ("dog", 0, (2.0, 1.0))},
        {"mode": "race", "case": 77},
        {"fly": (TOWARD, (2.0, 1.0))},
    ):
        session = advance(update(session, message), shepherds, 3)
    assert len(traced) == once


def test_an_arena_stays_as_it_was_chosen_while_the_flock_fits():
    session = update(update(begun(), {"preset": "strombom2014"}), {"arena": 40.0})
    for message in ({"noise": 0.1}, {"sheep": 5}, {"case": 3}):
        session = update(session, message)
        assert float(session.world.arena.size) == 40.0


def test_a_flock_that_outgrows_its_arena_gets_a_wider_one():
    session = update(update(begun(), {"arena": 6.0}), {"sheep": 60})
    assert float(session.world.arena.size) > 2 * float(session.world.arena.goal_radius) - 1e-3
    session = update(session, {"sheep": 3})
    assert float(session.world.arena.size) == 4.0


def test_every_preset_has_its_own_noise_and_a_speed_to_watch():
    for name in PRESETS:
        session = update(begun(), {"preset": name})
        flock: Any = preset(name).flock
        assert session.settings.noise == flock.noise
        steps = session.settings.speed / preset(name).arena.dt
        assert 5.0 <= steps <= 20.0


@pytest.mark.parametrize(
    ("message", "remedy"),
    [
        ({"arena": 1.5}, "try 4"),
        ({"hold": ("dog", 5, (1.0, 1.0))}, "has 1 dog"),
        ({"mode": "race", "hold": ("dog", 0, (1.0, 1.0))}, "fly the dog instead"),
    ],
)
def test_what_a_world_does_not_have_is_refused(message, remedy):
    session = advance(update(begun(), {"mode": message.get("mode", "watch")}), SHEPHERDS, 0)
    with pytest.raises(Refusal, match=remedy):
        update(session, message)
