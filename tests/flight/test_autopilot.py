from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skydog.flight import autopilot, profiles
from skydog.flight.autopilot import GRAVITY, ROTORS, Memory, Motion

UAVS = [profiles.uav(name) for name in profiles.ship("uav")]
TUM = profiles.uav("tum-simulator")
NONE = np.zeros((1, 3))

uavs = pytest.mark.parametrize("uav", UAVS, ids=lambda uav: uav.name)


def wrench(uav, thrusts):
    """Total thrust and torque of four rotors, from where each stands and how it spins."""
    corner = uav.body.arm / np.sqrt(2.0)
    # Front left, rear left, rear right, front right; x forward, y left.
    places = corner * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    drag = uav.body.rotor_torque * np.array([-1, 1, -1, 1])
    # r × F for F along z: (y F, -x F), and what the rotor's own drag adds about z.
    arms = np.stack([places[:, 1], -places[:, 0], drag])
    return thrusts.sum(axis=-1), thrusts @ arms.T


def hover(uav, velocity=NONE, tilted=None, motion=None, memory=None):
    motion = motion or Motion(NONE, NONE, NONE, NONE)
    memory = memory or Memory(velocity, np.zeros((1, 2)))
    return autopilot.rotors(uav, memory, motion, velocity, tilted, 0.005)


# The mixer


@uavs
def test_unsaturated_rotors_make_the_thrust_and_the_torque_that_were_asked_for(uav):
    weight, rng = GRAVITY * uav.body.mass, np.random.default_rng(0)
    thrust = weight * rng.uniform(0.9, 1.1, 100)
    corner = uav.body.arm / np.sqrt(2.0)
    levers = np.array([corner, corner, uav.body.rotor_torque])
    torque = 0.1 * weight * levers * rng.uniform(-1.0, 1.0, (100, 3))
    made = wrench(uav, autopilot.mix(uav, thrust, torque))
    np.testing.assert_allclose(made[0], thrust)
    np.testing.assert_allclose(made[1], torque, atol=1e-12)


@given(st.floats(-100.0, 100.0), st.tuples(*[st.floats(-10.0, 10.0)] * 3), st.sampled_from(UAVS))
def test_whatever_is_asked_for_no_rotor_leaves_its_range(thrust, torque, uav):
    found = autopilot.mix(uav, np.array([thrust]), np.array([torque]))
    assert np.all(found >= 0.0)
    assert np.all(found <= uav.body.rotor_thrust)


@uavs
@pytest.mark.parametrize("times", [0.0, 100.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_torque_goes_before_thrust_where_both_cannot_be(uav, axis, times):
    torque = np.zeros((1, 3))
    # All that a pair of rotors has, which leaves nothing to choose for the thrust.
    torque[0, axis] = uav.body.arm * np.sqrt(2.0) * uav.body.rotor_thrust
    asked = times * GRAVITY * uav.body.mass
    thrust, made = wrench(uav, autopilot.mix(uav, np.array([asked]), torque))
    np.testing.assert_allclose(made, torque, atol=1e-9)
    np.testing.assert_allclose(thrust, 2.0 * uav.body.rotor_thrust)


def test_neighbours_turn_opposite_and_each_rotor_stands_in_a_corner_of_its_own():
    assert len({tuple(rotor[:2]) for rotor in ROTORS}) == 4
    for rotor, following in zip(ROTORS, np.roll(ROTORS, -1, axis=0), strict=True):
        assert rotor[2] == -following[2]
    assert np.all(ROTORS.sum(axis=0) == 0.0)


# From a velocity to a tilt


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -2.0])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_the_tilt_accelerates_along_the_commanded_velocity_whatever_the_yaw(yaw, direction):
    command = 0.2 * np.array([direction])
    still = np.zeros((1, 2))
    roll, pitch = autopilot.tilt(TUM, command, still, still, still, np.array([yaw]))[0]
    cos, sin = np.cos(yaw), np.sin(yaw)
    # The thrust's direction, R e_z of R = Rz(yaw) Ry(pitch) Rx(roll).
    level = np.array([np.sin(pitch) * np.cos(roll), -np.sin(roll)])
    thrust = np.array([cos * level[0] - sin * level[1], sin * level[0] + cos * level[1]])
    expected = TUM.velocity.gain * command[0] / GRAVITY
    np.testing.assert_allclose(thrust, expected, atol=2e-3)


def test_a_tilt_is_what_p_and_d_of_tum_simulator_say():
    def of(*numbers):
        return np.array([[numbers[0], 0.0]])

    pitch = autopilot.tilt(TUM, of(0.5), of(0.2), of(0.3), of(0.7), np.zeros(1))[0, 1]
    assert pitch == pytest.approx((5.0 * (0.5 - 0.3) + 1.0 * (0.2 - 0.7)) / GRAVITY)


@uavs
def test_no_tilt_is_larger_than_the_profile_allows(uav):
    command, still = np.array([[50.0, -50.0]]), np.zeros((1, 2))
    tilted = autopilot.tilt(uav, command, still, still, still, np.zeros(1))
    np.testing.assert_allclose(tilted, [[uav.attitude.largest] * 2])  # roll right, nose down


def test_at_the_commanded_velocity_the_tilt_is_what_the_drag_takes():
    uav = profiles.uav("ardrone2")
    velocity, still = np.array([[0.8, 0.0]]), np.zeros((1, 2))
    pitch = autopilot.tilt(uav, velocity, still, velocity, still, np.zeros(1))[0, 1]
    assert GRAVITY * pitch * uav.body.mass == pytest.approx(uav.body.drag * 0.8)


# From a tilt to rotors


@uavs
def test_a_drone_that_hovers_has_a_quarter_of_its_weight_on_each_rotor(uav):
    _, thrusts = hover(uav)
    np.testing.assert_allclose(thrusts, GRAVITY * uav.body.mass / 4.0)


@uavs
@pytest.mark.parametrize("axis", [0, 1])
def test_a_tilted_drone_is_turned_back_and_its_thrust_still_bears_its_weight(uav, axis):
    attitude = np.zeros((1, 3))
    attitude[0, axis] = 0.1
    _, thrusts = hover(uav, motion=Motion(NONE, NONE, attitude, NONE), tilted=np.zeros((1, 2)))
    thrust, torque = wrench(uav, thrusts)
    assert torque[0, axis] < 0.0
    assert thrust[0] * np.cos(0.1) == pytest.approx(GRAVITY * uav.body.mass)
    np.testing.assert_allclose(np.delete(torque[0], axis), 0.0, atol=1e-12)


@uavs
def test_the_torque_is_inertia_times_what_the_attitude_loop_asks(uav):
    attitude, rates = np.array([[0.01, -0.02, 0.0]]), np.array([[0.03, 0.05, 0.0]])
    _, thrusts = hover(uav, motion=Motion(NONE, NONE, attitude, rates), tilted=np.zeros((1, 2)))
    loop = uav.attitude
    angular = -loop.gain * attitude[0, :2] - loop.damping * rates[0, :2]
    expected = np.array(uav.body.inertia[:2]) * angular
    np.testing.assert_allclose(wrench(uav, thrusts)[1][0, :2], expected)


@uavs
def test_a_drone_that_is_turned_is_turned_back_to_yaw_0(uav):
    for yaw in (0.2, -0.2):
        attitude = np.array([[0.0, 0.0, yaw]])
        _, thrusts = hover(uav, motion=Motion(NONE, NONE, attitude, NONE))
        assert np.sign(wrench(uav, thrusts)[1][0, 2]) == -np.sign(yaw)


@uavs
def test_a_drone_that_sinks_below_its_command_gets_more_thrust(uav):
    sinking = Motion(np.array([[0.0, 0.0, -0.1]]), NONE, NONE, NONE)
    _, thrusts = hover(uav, motion=sinking)
    lift = wrench(uav, thrusts)[0][0] / uav.body.mass - GRAVITY
    loop = uav.velocity
    assert lift == pytest.approx(0.1 * loop.climb_gain / (1.0 + loop.climb_damping))


def test_a_commanded_tilt_changes_no_faster_than_the_profile_allows():
    slow = replace(TUM, attitude=replace(TUM.attitude, largest_rate=2.0))
    memory, _ = hover(slow, tilted=np.array([[0.4, -0.4]]))
    np.testing.assert_allclose(memory.tilt, [[0.01, -0.01]])
    memory, _ = hover(slow, tilted=np.array([[0.4, -0.015]]), memory=memory)
    np.testing.assert_allclose(memory.tilt, [[0.02, -0.015]])
