"""The base station's step, whatever poses, decisions and orders it is given."""

from typing import Any

import numpy as np
import pytest

from skydog.flight import altitude, base, profiles
from skydog.flight.base import Base, Decided
from skydog.flight.limits import Limits
from skydog.flight.station import DT, Frame, Station
from skydog.flight.supervisor import EVENTS, Mode, Order

UAV, ROVER = profiles.uav("ardrone2"), profiles.rover("kobuki")
CAGE = (-0.7, 6.7)
LIMITS = Limits(CAGE, CAGE, (-0.5, 3.0), silence=0.6)
ON_PAD, UP = 0.05, altitude.HEIGHT


def a_base(missions=1, uav=UAV, **changes):
    station = Station(uav, ROVER, "reference", None, 0.2, np.asarray(0.5), acceleration=4.0)
    return Base(station, LIMITS, (-0.2, 6.2), (0.0, 6.0), np.full((missions, 1), UP))._replace(
        **changes
    )


def a_frame(missions=1, dog=(2.0, 2.0, UP), sheep=((4.0, 4.0), (5.0, 4.0)), seen=True):
    ones = np.ones((missions, 1, 1))
    return Frame(
        ones * np.array([dog]),
        ones * np.array(sheep),
        np.zeros((missions, len(sheep))),
        np.full((missions, 1), seen),
        np.full((missions, len(sheep)), seen),
    )


STILL = Decided(np.zeros((1, 1, 2)), np.zeros((1, 2, 2)))
PUSHED = Decided(np.full((1, 1, 2), 0.5), np.full((1, 2, 2), 0.3))


class Flight:
    """A base station, and bodies that stand wherever the test puts them."""

    def __init__(self, mode=Mode.MISSION, **frame):
        self.base, self.now = a_base(), 0.0
        self.frame = a_frame(**frame)
        self.memory = base.start(self.base, self.frame, -DT, mode)
        self.memory = self.memory._replace(pad=np.full((1, 1), ON_PAD), hold=np.full((1, 1), UP))
        self.log = []

    def fly(self, seconds, order=Order.NONE, decided=STILL, frame=None, **told):
        """Fly on; the order is given at the beginning."""
        for tick in range(round(seconds / DT)):
            said = base.all_well((1,), 1, Order.NONE if tick else order)._replace(**told)
            self.memory, self.sent = base.step(
                self.base, self.memory, frame or self.frame, said, decided, self.now
            )
            if (event := self.sent.change.event[0]) >= 0:
                self.log.append((round(self.now, 2), EVENTS[event]))
            self.now += DT
        return Mode(self.memory.supervisor.mode[0])


def test_ten_missed_frames_hold_fifty_land_and_rovers_stop_at_the_first():
    flight = Flight()
    assert flight.fly(1.0, decided=PUSHED) == Mode.MISSION
    assert flight.sent.commands.twist.speed.max() > 0.1
    blind = a_frame(seen=False)
    assert flight.fly(0.09, frame=blind) == Mode.MISSION
    assert flight.fly(0.03, frame=blind) == Mode.HOLD
    assert flight.sent.hover.all()
    assert flight.fly(0.3, frame=blind) == Mode.HOLD
    assert np.abs(flight.sent.commands.twist.speed).max() == 0.0
    assert flight.fly(0.1, frame=blind) == Mode.LANDING
    assert flight.sent.commands.velocity[0, 0, 2] < 0.0
    (held, _), (landed, _) = flight.log
    assert [event for _, event in flight.log] == ["eyes stale", "eyes stale long"]
    assert abs(held - 1.1) < 0.02
    assert abs(landed - 1.5) < 0.02


def test_a_mission_goes_on_once_the_poses_are_back():
    flight = Flight()
    flight.fly(0.2)
    flight.fly(0.3, frame=a_frame(seen=False))
    assert flight.fly(0.1) == Mode.MISSION
    assert [event for _, event in flight.log] == ["eyes stale", "well again"]


def test_a_pose_that_jumps_a_metre_is_not_believed():
    flight = Flight()
    flight.fly(0.2)
    away = a_frame(sheep=((4.0, 4.0), (5.0, 5.0)))
    flight.fly(0.3, frame=away)
    np.testing.assert_allclose(flight.memory.station.sheep.position[0, 1], (5.0, 4.0), atol=1e-6)
    assert flight.fly(0.3, frame=away) == Mode.LANDING


def test_two_rovers_that_swap_their_names_stop_and_the_drone_lands():
    flight = Flight(sheep=((4.0, 4.0), (4.4, 4.0)))
    flight.fly(0.2)
    assert flight.fly(0.7, frame=a_frame(sheep=((4.4, 4.0), (4.0, 4.0)))) == Mode.LANDING


def test_a_policy_that_is_silent_or_has_no_number_holds():
    nothing: list[Any] = [None, Decided(np.full((1, 1, 2), np.nan), np.zeros((1, 2, 2)))]
    for decided in nothing:
        flight = Flight()
        flight.fly(0.2)
        assert flight.fly(0.7, decided=decided) == Mode.HOLD
        assert flight.log[-1][1] == "policy silent"
        assert np.isfinite(flight.sent.commands.velocity).all()


@pytest.mark.parametrize(
    ("told", "event"),
    [
        ({"battery": np.array([[0.1]])}, "battery low"),
        ({"others": np.array([True])}, "second publisher"),
        ({"over": np.array([True])}, "mission over"),
        ({"lost": np.array([True])}, "drone lost"),
        ({"landed": np.array([[True]])}, "drone stands"),
    ],
)
def test_what_ends_a_flight_lands_it(told, event):
    flight = Flight()
    assert flight.fly(0.02, **told) == Mode.LANDING
    assert flight.log[-1][1] == event


def test_a_drone_that_somebody_takes_down_is_not_taken_off_again():
    for before in (Order.NONE, Order.HOLD):
        flight = Flight()
        flight.fly(0.2, before)
        frame = flight.frame
        for height in np.arange(UP, 0.5, -0.02):
            flight.fly(0.02, frame=(frame := a_frame(dog=(2.0, 2.0, height))))
        assert flight.fly(0.5, Order.RESUME, frame=frame) == Mode.LANDING
        assert flight.log[-1][1] == "drone too low"


def test_a_rover_that_turns_about_at_once_is_not_seen():
    flight = Flight()
    flight.fly(0.2)
    flipped = a_frame()._replace(yaw=np.array([[np.pi, 0.0]]))
    assert flight.fly(0.6, frame=flipped) == Mode.LANDING
    assert [event for _, event in flight.log] == ["eyes stale", "eyes stale long"]


def test_a_base_station_that_stood_still_lands():
    flight = Flight()
    flight.fly(0.2)
    flight.now += 0.7
    assert flight.fly(DT) == Mode.LANDING
    assert flight.log[-1][1] == "eyes stale long"


def test_a_drone_beyond_the_fence_sinks_where_it_is_whoever_is_below():
    over = ((6.6, 2.0), (5.0, 4.0))
    flight = Flight(dog=(6.65, 2.0, UP), sheep=over)
    flight.fly(0.1)
    flight.fly(0.5, frame=a_frame(dog=(6.8, 2.0, UP), sheep=over))
    assert flight.sent.mode[0] == Mode.LANDING
    assert flight.sent.commands.velocity[0, 0, 2] < 0.0


def test_a_hold_beyond_the_soft_fence_holds_within_it():
    flight = Flight(dog=(6.5, 2.0, UP))
    flight.fly(0.1, Order.HOLD)
    assert flight.memory.station.dog_setpoint.origin[0, 0, 0] == 6.2


def test_a_drone_that_says_that_it_flies_has_not_landed_however_low_it_is():
    flight = Flight()
    flight.fly(0.1, Order.LAND)
    for height in np.arange(UP, ON_PAD, -0.02):
        flight.fly(0.02, frame=a_frame(dog=(2.0, 2.0, height)), flies=np.array([[True]]))
    down = a_frame(dog=(2.0, 2.0, ON_PAD))
    assert flight.fly(0.5, frame=down, flies=np.array([[True]])) == Mode.LANDING
    assert flight.fly(0.5, frame=down) == Mode.DISARMED


def test_a_drone_that_is_seen_outside_the_cage_lands():
    flight = Flight(dog=(6.65, 2.0, UP))
    flight.fly(0.1)
    assert flight.fly(0.5, frame=a_frame(dog=(6.78, 2.0, UP))) == Mode.LANDING
    assert flight.log[-1][1] == "hard fence"


def test_a_set_point_ends_at_the_soft_fence_and_comes_back_from_beyond_it():
    flight = Flight(dog=(6.15, 2.0, UP))
    outwards = Decided(np.array([[[1.0, 0.0]]]), np.zeros((1, 2, 2)))
    flight.fly(2.0, decided=outwards)
    goal = flight.memory.station.dog_setpoint
    assert (goal.origin + 0.2 * goal.velocity)[0, 0, 0] <= 6.2 + 1e-9


def test_a_take_off_climbs_to_its_height_and_only_then_the_mission_begins():
    flight = Flight(Mode.READY, dog=(2.0, 2.0, ON_PAD))
    assert flight.fly(0.1, decided=PUSHED) == Mode.READY
    assert np.all(flight.sent.commands.velocity == 0.0)
    assert flight.fly(0.2, Order.TAKE_OFF, decided=PUSHED) == Mode.TAKING_OFF
    assert flight.sent.commands.velocity[0, 0, 2] > 0.3
    np.testing.assert_array_equal(flight.sent.commands.twist.speed, 0.0)
    mode = Mode.TAKING_OFF
    for height in np.arange(ON_PAD, UP + 0.01, 0.02):
        mode = flight.fly(0.03, frame=a_frame(dog=(2.0, 2.0, height)), decided=PUSHED)
    assert mode == Mode.MISSION


def test_a_take_off_that_is_interrupted_low_holds_low_and_then_goes_on():
    flight = Flight(Mode.READY, dog=(2.0, 2.0, ON_PAD))
    flight.fly(0.1, Order.TAKE_OFF)
    frame = flight.frame
    for height in np.arange(ON_PAD, 0.8, 0.01):
        flight.fly(0.02, frame=(frame := a_frame(dog=(2.0, 2.0, height))))
    unseen = frame._replace(sheep_seen=np.array([[False, True]]))
    assert flight.fly(0.2, frame=unseen) == Mode.HOLD
    assert abs(flight.sent.commands.velocity[0, 0, 2]) < 0.2
    assert flight.fly(0.1, frame=frame) == Mode.TAKING_OFF


def test_a_landing_drone_flies_aside_from_a_rover_before_it_sinks():
    over = ((2.1, 2.0), (5.0, 4.0))
    flight = Flight(sheep=over)
    flight.fly(0.1, Order.LAND)
    assert flight.memory.supervisor.mode[0] == Mode.LANDING
    assert flight.sent.mode[0] == Mode.HOLD
    assert flight.memory.station.dog_setpoint.origin[0, 0, 0] < 2.1 - UAV.body.radius
    aside = a_frame(dog=(1.3, 2.0, UP), sheep=over)
    for share in np.linspace(0.0, 1.0, 60):
        flight.fly(0.02, frame=a_frame(dog=(2.0 - 0.7 * share, 2.0, UP), sheep=over))
    flight.fly(0.1, frame=aside)
    assert flight.sent.mode[0] == Mode.LANDING
    assert flight.sent.commands.velocity[0, 0, 2] < 0.0


def test_a_drone_beside_a_wall_flies_into_the_arena_before_it_lands():
    flight = Flight(dog=(-0.1, 3.0, UP))
    flight.fly(0.1, Order.LAND)
    assert flight.sent.mode[0] == Mode.HOLD
    assert flight.memory.station.dog_setpoint.origin[0, 0, 0] > UAV.body.radius + base.CLEAR
    for x in np.linspace(-0.1, 0.65, 60):
        flight.fly(0.02, frame=a_frame(dog=(x, 3.0, UP)))
    assert flight.sent.mode[0] == Mode.LANDING


def test_a_rover_that_rolls_on_when_told_to_stand_lands_the_drone():
    flight = Flight()
    flight.fly(0.5, Order.HOLD)
    mode = Mode.HOLD
    for tick in range(200):
        x = 4.0 + 0.3 * DT * tick
        mode = flight.fly(DT, frame=a_frame(sheep=((x, 4.0), (5.0, 4.0))))
    assert mode == Mode.LANDING
    assert flight.log[-1][1] == "a rover runs away"


def test_a_landed_drone_is_disarmed_and_nothing_is_sent_to_it():
    flight = Flight()
    flight.fly(0.1, Order.LAND)
    for height in np.arange(UP, ON_PAD, -0.02):
        flight.fly(0.02, frame=a_frame(dog=(2.0, 2.0, height)))
    assert flight.fly(0.5, frame=a_frame(dog=(2.0, 2.0, ON_PAD))) == Mode.DISARMED
    np.testing.assert_array_equal(flight.sent.commands.velocity, 0.0)


def test_an_emergency_stops_everything_at_once():
    flight = Flight()
    flight.fly(1.0, decided=PUSHED)
    flight.fly(DT, Order.EMERGENCY)
    assert flight.sent.mode[0] == Mode.EMERGENCY
    np.testing.assert_array_equal(flight.sent.commands.velocity, 0.0)
    np.testing.assert_array_equal(flight.sent.commands.twist.speed, 0.0)
