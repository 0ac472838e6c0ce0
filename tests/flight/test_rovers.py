from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.flight import fuzzy, profiles, rovers
from skydog.flight.rovers import Pose, Twist, YawMemory

ROVER = profiles.rover("kobuki")
ANY = np.random.default_rng(0)


def poses(count=50):
    return Pose(ANY.uniform(0.0, 6.0, (count, 2)), ANY.uniform(-np.pi, np.pi, count))


# Following a set-point


def test_the_steered_point_moves_as_wanted_while_no_limit_binds():
    pose = poses()
    # Near enough that neither the speed nor the turn rate is at its limit.
    setpoint = rovers.steered(ROVER, pose) + ANY.uniform(-0.05, 0.05, (50, 2))
    twist = rovers.track(ROVER, pose, setpoint, 0.5)
    dt = 1e-6
    half = pose.yaw + 0.5 * dt * twist.turn_rate
    direction = np.stack([np.cos(half), np.sin(half)], axis=-1)
    moved = Pose(
        pose.position + dt * twist.speed[:, None] * direction, pose.yaw + dt * twist.turn_rate
    )
    velocity = (rovers.steered(ROVER, moved) - rovers.steered(ROVER, pose)) / dt
    wanted = ROVER.tracking.gain * (setpoint - rovers.steered(ROVER, pose))
    np.testing.assert_allclose(velocity, wanted, atol=1e-5)


@given(
    st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-np.pi, np.pi), st.floats(0.01, 0.5)
)
def test_however_far_a_set_point_is_the_rover_is_asked_for_no_more_than_it_may(x, y, yaw, speed):
    pose = Pose(np.zeros((1, 2)), np.array([yaw]))
    twist = rovers.track(ROVER, pose, np.array([[x, y]]), speed)
    assert np.abs(twist.speed) <= speed + 1e-12
    assert np.abs(twist.turn_rate) <= ROVER.motion.largest_turn_rate


def test_a_rover_on_its_set_point_is_asked_for_nothing():
    pose = poses()
    twist = rovers.track(ROVER, pose, rovers.steered(ROVER, pose), 0.5)
    np.testing.assert_allclose(twist, 0.0, atol=1e-12)


def test_a_set_point_right_behind_a_rover_is_reversed_to():
    pose = Pose(np.zeros((1, 2)), np.zeros(1))
    behind = rovers.steered(ROVER, pose) - np.array([[0.05, 0.0]])
    twist = rovers.track(ROVER, pose, behind, 0.5)
    np.testing.assert_allclose(twist, [[-ROVER.tracking.gain * 0.05], [0.0]], atol=1e-9)


# Turning, then driving


def turned(yaw, direction, seconds, dt=0.01, rover=ROVER):
    """The yaw and twist of an ideal rover over time, that is pushed in a direction."""
    memory = YawMemory(np.zeros(1), np.zeros(1))
    velocity = 0.3 * np.array([[np.cos(direction), np.sin(direction)]])
    yaws, twists = [], []
    for _ in range(round(seconds / dt)):
        pose = Pose(np.zeros((1, 2)), np.array([yaw]))
        memory, twist = rovers.turn_then_drive(rover, memory, pose, velocity, dt)
        yaw = float(rovers.wrapped(np.array([yaw + dt * twist.turn_rate[0]]))[0])
        yaws.append(yaw)
        twists.append((float(twist.speed[0]), float(twist.turn_rate[0])))
    return np.array(yaws), np.array(twists)


@pytest.mark.parametrize(("yaw", "direction"), [(0.0, 2.5), (3.0, -3.0), (-1.0, -1.2)])
def test_a_pushed_rover_turns_the_short_way_and_drives_once_it_is_turned(yaw, direction):
    yaws, twists = turned(yaw, direction, 3.0)
    away = rovers.wrapped(np.array([direction - yaw]))[0]
    assert np.sign(twists[0, 1]) == np.sign(away)
    assert rovers.wrapped(yaws - direction)[-1] == pytest.approx(0.0, abs=0.02)
    error = np.abs(rovers.wrapped(direction - np.array([yaw, *yaws[:-1]])))
    within = error <= ROVER.yaw.moves_within
    np.testing.assert_allclose(twists[:, 0], np.where(within, 0.3, 0.0))
    assert np.all(np.abs(twists[:, 1]) <= ROVER.motion.largest_turn_rate)


def test_a_rover_without_a_push_stands():
    _, twists = turned(1.0, 0.0, 0.01)
    assert twists.any()
    memory = YawMemory(np.zeros(3), np.zeros(3))
    _, twist = rovers.turn_then_drive(ROVER, memory, poses(3), np.zeros((3, 2)), 0.01)
    np.testing.assert_array_equal(twist, 0.0)


def test_the_rules_make_a_large_turn_sooner_than_the_gain_as_it_stands(monkeypatch):
    def settles():
        yaws, _ = turned(0.0, 2.0, 3.0)
        assert yaws.max() < 2.0 + 1e-3  # and no further than it should
        return np.flatnonzero(yaws < 1.95)[-1]

    ruled = settles()
    monkeypatch.setattr(fuzzy, "RULES", np.ones((3, 3)))
    assert ruled < 0.95 * settles()


# Limits and wheels

speeds, rates = st.floats(-5.0, 5.0), st.floats(-20.0, 20.0)


@given(
    st.floats(-0.5, 0.5), st.floats(-3.14, 3.14), speeds, rates, st.sampled_from([0.01, 0.1, 0.2])
)
def test_no_twist_is_beyond_the_limits_or_changes_faster(speed, rate, wanted, turning, dt):
    before = Twist(np.array([speed]), np.array([rate]))
    after = rovers.within_limits(ROVER, before, Twist(np.array([wanted]), np.array([turning])), dt)
    limits = ROVER.motion
    for was, now, most, faster in (
        (before.speed, after.speed, limits.largest_speed, limits.acceleration),
        (before.turn_rate, after.turn_rate, limits.largest_turn_rate, limits.turn_acceleration),
    ):
        assert np.abs(now) <= most + 1e-9
        assert np.abs(now - was) <= faster * dt + 1e-9


def test_a_twist_within_the_limits_is_left_as_it_is():
    wanted = Twist(np.array([0.31]), np.array([-1.05]))
    after = rovers.within_limits(ROVER, Twist(np.array([0.3]), np.array([-1.0])), wanted, 0.01)
    np.testing.assert_allclose(after, wanted)


@given(speeds, rates)
def test_the_wheels_speeds_make_the_twist_that_they_were_made_of(speed, rate):
    left, right = rovers.wheels(ROVER, Twist(np.array([speed]), np.array([rate])))
    radius, apart = ROVER.body.wheel_radius, ROVER.body.wheel_separation
    np.testing.assert_allclose(0.5 * radius * (left + right), speed, atol=1e-9)
    np.testing.assert_allclose(radius * (right - left) / apart, rate, atol=1e-9)


@given(st.floats(-50.0, 50.0))
def test_a_wrapped_angle_points_the_same_way(angle):
    wrapped = rovers.wrapped(np.array([angle]))
    assert -np.pi <= wrapped[0] <= np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp([1j * angle]), atol=1e-9)


def test_the_point_that_is_steered_is_ahead_of_the_axle():
    longer = replace(ROVER, tracking=replace(ROVER.tracking, ahead=0.5))
    pose = Pose(np.array([[1.0, 1.0]]), np.array([np.pi / 2]))
    np.testing.assert_allclose(rovers.steered(longer, pose), [[1.0, 1.5]])
