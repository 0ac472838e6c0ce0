"""The base station's loop, without physics: robots that do as they are told."""

from dataclasses import replace

import numpy as np
import pytest

from skydog.flight import altitude, profiles, setpoints, station
from skydog.flight.station import DT, Frame, Station

UAV, ROVER = profiles.uav("tum-simulator"), profiles.rover("kobuki")
PERIOD = 0.1
STATION = Station(UAV, ROVER, "reference", None, PERIOD, np.asarray(0.5))
BEHIND = setpoints.stand(np.array([[[4.25, 4.0]]]))  # what a test's wall is before
AIRSPACE, ARENA = (-0.2, 6.2), (0.0, 6.0)


def a_frame(dogs=((2.0, 2.0, 2.0),), sheep=((4.0, 4.0),), yaw=(0.0,), seen=True):
    dogs, sheep = np.array([dogs], float), np.array([sheep], float)
    return Frame(
        dogs,
        sheep,
        np.array([yaw], float),
        np.full(dogs.shape[:2], seen),
        np.full(sheep.shape[:2], seen),
    )


def height(frame):
    return np.full(frame.dogs.shape[:2], altitude.HEIGHT)


def decided(memory, dog=(0.0, 0.0), sheep=(0.0, 0.0), stage=STATION):
    return station.take(
        stage, memory, np.array([[dog]], float), np.array([[sheep]], float), AIRSPACE, ARENA
    )


def test_the_feedforward_adds_its_share_of_the_setpoints_velocity_and_changes_no_feedback():
    memory = decided(station.start(STATION, a_frame()), dog=(0.5, -0.2))
    found = {}
    for share in (0.0, 1.0):
        uav = replace(UAV, position=replace(UAV.position, feedforward=share))
        found[share] = station.act(STATION._replace(uav=uav), memory, 0.05, height(a_frame()))
    (without, bare), (with_it, fed) = found[0.0], found[1.0]
    np.testing.assert_allclose(fed.velocity - bare.velocity, [[[0.5, -0.2, 0.0]]], atol=1e-12)
    np.testing.assert_array_equal(without.lag, with_it.lag)
    np.testing.assert_array_equal(without.trim, with_it.trim)


def test_a_set_point_slides_and_one_that_an_obstacle_parts_from_its_rover_starts_there_anew():
    def slide(before, after):  # a wall at x = 4.2
        return np.where((before[..., :1] < 4.2) & (after[..., :1] >= 4.2), before, after)

    def taken(memory):
        moves = np.zeros((1, 1, 2)), np.array([[[1.0, 0.5]]])
        found = station.take(STATION, memory, *moves, AIRSPACE, ARENA, slide).sheep_setpoint
        return found.origin[0, 0], setpoints.at(found, PERIOD)[0, 0]

    memory = station.start(STATION, a_frame(yaw=(np.pi,)))
    for origin, end in (taken(memory), taken(memory._replace(sheep_setpoint=BEHIND))):
        np.testing.assert_allclose(end - origin, (0.1, 0.05))
    np.testing.assert_allclose(taken(memory)[0], (4.0 - ROVER.tracking.ahead, 4.0))
    np.testing.assert_allclose(taken(memory._replace(sheep_setpoint=BEHIND))[0], (4.0, 4.0))


def test_a_drone_on_a_set_point_that_stands_is_commanded_nothing():
    _, sent = station.act(STATION, station.start(STATION, a_frame()), 0.0, height(a_frame()))
    np.testing.assert_allclose(sent.velocity, 0.0, atol=1e-12)
    np.testing.assert_allclose(sent.tilt, 0.0, atol=1e-12)
    np.testing.assert_allclose(sent.twist.turn_rate, 0.0, atol=1e-12)


@pytest.mark.parametrize("far", [0.3, 50.0])
def test_a_drone_is_sent_towards_its_set_point_and_no_faster_than_its_profile_has_it(far):
    memory = station.start(STATION, a_frame())
    memory = memory._replace(
        dog_setpoint=setpoints.stand(memory.dog_setpoint.origin + far * np.array([0.6, 0.8]))
    )
    _, sent = station.act(STATION, memory, 0.0, height(a_frame()))
    level = sent.velocity[0, 0, :2]
    expected = min(UAV.position.delta * far, UAV.velocity.largest)
    # Of the trim estimator there is a hundredth of a second in it.
    np.testing.assert_allclose(level, expected * np.array([0.6, 0.8]), rtol=2e-3)


def test_no_set_point_leaves_the_airspace_or_the_arena():
    memory = station.start(STATION, a_frame(dogs=[[6.15, -0.15, 2.0]], sheep=[[5.98, 0.01]]))
    for _ in range(5):
        memory = decided(memory, dog=(1.0, -1.0), sheep=(0.5, -0.5))
        for setpoint, (least, most) in (
            (memory.dog_setpoint, AIRSPACE),
            (memory.sheep_setpoint, ARENA),
        ):
            for elapsed in (0.0, PERIOD / 2, PERIOD):
                at = setpoints.at(setpoint, elapsed)
                assert np.all((at >= least - 1e-9) & (at <= most + 1e-9))


def test_a_drone_on_its_way_keeps_its_set_point_until_it_is_there():
    waits = STATION._replace(tolerance=0.05)
    memory = decided(station.start(STATION, a_frame()), dog=(1.0, 0.0), stage=waits)
    before = setpoints.at(memory.dog_setpoint, PERIOD)
    assert station.waiting(waits, memory).all()
    after = decided(memory, dog=(0.0, 1.0), stage=waits)
    np.testing.assert_allclose(setpoints.at(after.dog_setpoint, PERIOD), before)
    there = memory._replace(dogs=memory.dogs._replace(position=np.array([[[*before[0, 0], 2.0]]])))
    assert not station.waiting(waits, there).any()
    moved = decided(there, dog=(0.0, 1.0), stage=waits)
    further = setpoints.at(moved.dog_setpoint, PERIOD) - before
    np.testing.assert_allclose(further, [[[0.0, 0.1]]])
    assert not station.waiting(STATION, memory).any()  # without a tolerance nobody waits


def test_a_yaw_that_passes_half_a_turn_is_seen_to_turn_on():
    memory = station.start(STATION, a_frame(yaw=[3.1]))
    for count in range(1, 60):
        frame = a_frame(yaw=[(3.1 + 0.02 * count + np.pi) % (2 * np.pi) - np.pi])
        memory = station.see(memory, frame)
    assert memory.yaw.velocity[0, 0, 0] == pytest.approx(2.0, abs=1e-3)
    assert memory.yaw.position[0, 0, 0] == pytest.approx(3.1 + 0.02 * 59, abs=1e-3)


def test_what_is_not_seen_moves_on_and_what_a_blind_frame_says_is_not_believed():
    memory = station.start(STATION, a_frame())
    blind = a_frame(dogs=[[9.0, 9.0, 9.0]], sheep=[[9.0, 9.0]], yaw=[2.0], seen=False)
    after = station.see(memory, blind)
    for part in ("dogs", "sheep", "yaw"):
        np.testing.assert_array_equal(getattr(after, part).position, getattr(memory, part).position)


@pytest.mark.parametrize("steering", ["reference", "track", "turn"])
def test_an_ideal_rover_goes_where_it_is_pushed_in_every_steering(steering):
    stage = STATION._replace(steering=steering)
    place, yaw, pushed = np.array([3.0, 3.0]), 2.5, np.array([0.3, -0.2])
    memory = station.start(STATION, a_frame(sheep=[place], yaw=[yaw]))
    seconds = 6.0
    for tick in range(round(seconds / DT)):
        if tick % round(PERIOD / DT) == 0:
            memory = decided(memory, sheep=pushed, stage=stage)
        memory = station.see(memory, a_frame(sheep=[place], yaw=[yaw]))
        elapsed = DT * (tick % round(PERIOD / DT))
        memory, sent = station.act(stage, memory, elapsed, height(a_frame()))
        place = place + DT * sent.twist.speed[0, 0] * np.array([np.cos(yaw), np.sin(yaw)])
        yaw += DT * sent.twist.turn_rate[0, 0]
    moved = place - 3.0
    along = moved @ pushed / np.linalg.norm(pushed)
    assert along > 0.75 * seconds * np.linalg.norm(pushed)
    assert yaw % (2 * np.pi) == pytest.approx(np.arctan2(-0.2, 0.3) % (2 * np.pi), abs=0.05)


def test_the_flock_is_the_set_points_in_reference_and_else_where_it_is_seen():
    memory = decided(station.start(STATION, a_frame()), sheep=(0.3, 0.0))
    ahead = station.flock(STATION, memory)
    # The point that is steered stands ahead of the axle.
    ahead_of_axle = ROVER.tracking.ahead
    np.testing.assert_allclose(ahead[0, 0], [4.03 + ahead_of_axle, 4.0])
    for steering in ("track", "turn"):
        seen = station.flock(STATION._replace(steering=steering), memory)
        np.testing.assert_array_equal(seen, memory.sheep.position)
