# pyright: reportAttributeAccessIssue=false
"""What the bodies do by themselves, and on board, against what can be computed by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from rigs import ARDRONE, CRAZYFLIE, ROVER, TUM, Rig, model, run

from skydog.errors import Refusal
from skydog.flight.autopilot import GRAVITY, ROTORS
from skydog.twin import bodies
from skydog.twin.bodies import TIMESTEP

pytestmark = pytest.mark.usefixtures("unchecked")

DRONES = [TUM, ARDRONE, CRAZYFLIE]
drones = pytest.mark.parametrize("uav", DRONES, ids=lambda uav: uav.name)
STILL = (0.0, 0.0, 0.0)


def with_body(uav, **changes):
    return replace(uav, body=replace(uav.body, **changes))


# A drone in the air


@drones
def test_a_drone_is_as_heavy_as_its_profile_has_it_and_its_mass_lies_between_its_rotors(uav):
    built, data = model(uav)
    dog = built.model.body("dog0")
    assert dog.mass[0] == pytest.approx(uav.body.mass)
    np.testing.assert_allclose(dog.inertia, uav.body.inertia)
    np.testing.assert_array_equal(dog.ipos, 0.0)
    mujoco.mj_forward(built.model, data)
    sites = [data.site(f"dog0_rotor{number}").xpos for number in range(4)]
    np.testing.assert_allclose(np.mean(sites, axis=0), data.body("dog0").xipos, atol=1e-12)


def test_a_drone_without_thrust_or_drag_falls_freely():
    built, data = model(TUM)
    data.qpos[2] = 100.0
    for _ in range(4):
        run(built, data, 0.5)
        # At the end of each step exactly: velocity first, then the position by it.
        assert data.qvel[2] == pytest.approx(-GRAVITY * data.time)
        fallen = 0.5 * GRAVITY * data.time * (data.time + TIMESTEP)
        assert 100.0 - data.qpos[2] == pytest.approx(fallen)
    np.testing.assert_allclose(data.qpos[3:7], [1, 0, 0, 0], atol=1e-12)  # and does not turn


def test_a_drone_that_falls_through_air_comes_to_the_speed_at_which_drag_bears_it():
    built, data = model(ARDRONE)
    data.qpos[2] = 500.0
    lasts = ARDRONE.body.mass / ARDRONE.body.drag
    for _ in range(8):
        run(built, data, 1.0)
        expected = GRAVITY * lasts * (1.0 - np.exp(-data.time / lasts))
        assert -data.qvel[2] == pytest.approx(expected, rel=5e-3)
    assert data.time > 4.0 * lasts
    np.testing.assert_allclose(data.qvel[3:6], 0.0, atol=1e-12)  # drag does not turn it


@drones
def test_a_quarter_of_its_weight_on_each_rotor_keeps_a_drone_at_its_height(uav):
    built, data = model(uav)
    data.ctrl[built.rotors] = GRAVITY * uav.body.mass / 4.0
    if uav.body.motor_lag:
        data.act[:] = GRAVITY * uav.body.mass / 4.0
    run(built, data, 1.0)
    np.testing.assert_allclose(data.qpos[:3], [1.0, 1.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(data.qpos[3:7], [1.0, 0.0, 0.0, 0.0], atol=1e-9)


@drones
def test_thrust_follows_its_command_with_the_lag_of_the_motors(uav):
    built, data = model(uav)
    data.ctrl[built.rotors] = 0.5 * uav.body.rotor_thrust
    run(built, data, 0.02)
    lag = uav.body.motor_lag
    # What the last step has applied is the thrust as it was when that step began.
    share = 1.0 - np.exp(-0.015 / lag) if lag else 1.0
    np.testing.assert_allclose(
        data.actuator_force[built.rotors], 0.5 * uav.body.rotor_thrust * share
    )


@pytest.mark.parametrize("rotor", range(4))
def test_each_rotor_turns_the_drone_as_the_mixer_takes_it_to(rotor):
    built, data = model(TUM)
    data.ctrl[built.rotors[0, rotor]] = 1.0
    mujoco.mj_forward(built.model, data)
    reach = TUM.body.arm / np.sqrt(2.0)
    torque = ROTORS[rotor] * [reach, reach, TUM.body.rotor_torque]
    np.testing.assert_allclose(data.qacc[3:6] * TUM.body.inertia, torque)


@drones
def test_without_thrust_a_drone_that_spins_and_hits_the_floor_never_gains_energy(uav):
    built, data = model(uav, sheep=0)
    spin = np.array([3.0, -2.0, 1.0])
    data.qpos[2], data.qvel[:3], data.qvel[3:6] = 1.0, (0.4, 0.0, 1.0), spin
    built.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    mujoco.mj_forward(built.model, data)
    start, energies = float(data.energy.sum()), []
    for _ in range(400):
        mujoco.mj_step(built.model, data)
        energies.append(float(data.energy.sum()))
    # Half a time step of gravity is what the integrator may be off.
    assert max(energies) < start + GRAVITY * uav.body.mass * 0.5 * TIMESTEP
    assert energies[-1] < 0.5 * start  # and the floor has taken of it


# A drone that is flown


def first(series, above):
    """When a series of 5 ms is above a value for the first time, in seconds."""
    return (np.flatnonzero(series > above)[0] + 1) * 0.005


@pytest.mark.parametrize(("commanded", "off"), [(0.5, 0.08), (1.0, 0.12)])
def test_tum_simulator_answers_a_step_of_velocity_as_the_original_does(commanded, off):
    place, velocity, attitude = Rig(TUM).fly([(commanded, 0.0, 0.0)] * 600)
    reached = velocity[:, 0] / commanded
    # Measured on a port of simple_controller at 1 kHz: 0.38 s, 0.70 s, no overshoot, 6° and 12°.
    assert first(reached, 0.632) == pytest.approx(0.38, rel=off)
    assert first(reached, 0.9) == pytest.approx(0.70, rel=0.08)
    assert reached.max() < 1.02
    assert np.degrees(attitude[:, 1].max()) == pytest.approx(12.0 * commanded, rel=0.1)
    np.testing.assert_allclose(place[:, 2], 2.0, atol=0.01)
    np.testing.assert_allclose(place[:, 1], 1.0, atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_drone_tilts_towards_where_it_is_sent(axis):
    command = np.zeros(3)
    command[axis] = 0.5
    place, _, attitude = Rig(TUM).fly([command] * 60)
    assert place[-1, axis] > 1.02
    # Nose down to fly forward, right side up to fly left (REP-103).
    tilted, other = (attitude[-1, 1], attitude[-1, 0])[:: 1 if axis == 0 else -1]
    assert np.sign(tilted) == (1.0 if axis == 0 else -1.0)
    assert other == pytest.approx(0.0, abs=1e-9)


@drones
def test_a_commanded_climb_is_climbed_upright(uav):
    place, velocity, attitude = Rig(uav).fly([(0.0, 0.0, 0.3)] * 600)
    assert velocity[-1, 2] == pytest.approx(0.3, rel=0.02)
    np.testing.assert_allclose(attitude, 0.0, atol=1e-9)
    assert place[-1, 2] > 2.5


def test_the_tilt_of_ardrone2_follows_within_a_tenth_of_a_second():
    _, _, attitude = Rig(ARDRONE).fly([STILL] * 200, tilted=(0.0, 0.1))
    # tum_ardrone: a first-order lag of 0.1 s.
    assert first(attitude[:, 1], 0.0632) == pytest.approx(0.1, abs=0.015)
    assert attitude[:, 1].max() < 0.102
    assert attitude[-1, 1] == pytest.approx(0.1, rel=1e-3)


def test_ardrone2_flies_as_fast_as_its_tilt_and_the_air_let_it():
    tilted = 0.2
    place, velocity, _ = Rig(ARDRONE).fly([STILL] * 2000, tilted=(0.0, tilted))
    body = ARDRONE.body
    assert velocity[-1, 0] == pytest.approx(
        GRAVITY * np.tan(tilted) * body.mass / body.drag, rel=0.01
    )
    assert velocity[-1, 0] == pytest.approx(17.8 * np.sin(tilted), rel=0.05)  # tum_ardrone: c2 f
    # It gets there as tum_ardrone has it: c1 = 0.58 1/s, behind the tilt's 0.1 s.
    half = first(velocity[:, 0], 0.5 * velocity[-1, 0])
    assert half == pytest.approx(np.log(2.0) / 0.58 + 0.1, rel=0.05)
    assert abs(place[-1, 2] - 2.0) < 0.05


# A rover


@pytest.fixture(scope="module")
def straight():
    return Rig().drive([(0.4, 0.0)], 2.0)[:, 0]


def test_a_rover_drives_straight_at_the_speed_that_its_wheels_have(straight):
    speed = (straight[-1, 0] - straight[200, 0]) / 1.0
    assert speed == pytest.approx(0.4, rel=0.02)
    np.testing.assert_allclose(straight[:, 1:], [[3.0, 0.0]] * len(straight), atol=1e-6)


@pytest.mark.parametrize("rate", [1.5, -2.0])
def test_a_rover_turns_on_the_circle_that_its_wheels_have(rate):
    driven = Rig().drive([(0.3, rate)], 6.0)[200:, 0]
    turned = np.diff(np.unwrap(driven[:, 2])) / 0.005
    assert turned.mean() == pytest.approx(rate, rel=0.02)
    centre = 0.5 * (driven[:, :2].max(axis=0) + driven[:, :2].min(axis=0))
    away = np.linalg.norm(driven[:, :2] - centre, axis=1)
    assert away.mean() == pytest.approx(0.3 / abs(rate), rel=0.02)
    assert np.ptp(away) < 0.01 * away.mean()


def test_a_rover_turns_on_the_spot():
    driven = Rig().drive([(0.0, 1.5)], 3.0)[:, 0]
    assert np.diff(np.unwrap(driven[:, 2]))[200:].mean() / 0.005 == pytest.approx(1.5, rel=0.02)
    np.testing.assert_allclose(driven[:, :2], 3.0, atol=1e-3)


def pulled(built, data):
    """How fast a rover goes, in m/s, whose wheels turn freely, after a second at 0.5 N."""
    at = built.sheep_speeds[0]
    built.model.actuator_gainprm[built.wheels] = built.model.actuator_biasprm[built.wheels] = 0.0
    run(built, data, 0.2)
    data.qfrc_applied[at] = 0.5
    run(built, data, 1.0)
    return float(data.qvel[at])


def test_casters_do_not_drag():
    body = ROVER.body
    # Two wheels roll along: spheres of 5 % of the mass each, and their motors behind the gear.
    rolls = 2 * (0.4 * 0.05 * body.mass + body.wheel_inertia / body.wheel_radius**2)
    assert pulled(*model()) == pytest.approx(0.5 / (body.mass + rolls), rel=0.01)


def test_casters_that_grip_as_the_floor_does_would_drag():
    built, data = model()
    casters = np.flatnonzero(built.model.geom_condim == 1)
    assert len(casters) == 2
    built.model.geom_condim[casters], built.model.geom_priority[casters] = 3, 0
    assert pulled(built, data) < 0.05


@pytest.mark.parametrize("timestep", [0.005, 0.0025])
def test_wheels_follow_their_command_without_chattering(timestep):
    built, data = model(timestep=timestep)
    at = [built.model.joint(f"sheep0_{side}").dofadr[0] for side in ("left", "right")]
    data.ctrl[built.wheels] = wanted = 0.1 / ROVER.body.wheel_radius
    speeds = []
    for _ in range(round(0.3 / timestep)):
        mujoco.mj_step(built.model, data)
        speeds.append(data.qvel[at].copy())
    assert np.all(np.diff(speeds, axis=0) > -0.02 * wanted)
    assert np.max(speeds) < 1.02 * wanted
    np.testing.assert_allclose(speeds[-1], wanted, rtol=0.02)


def test_wheels_on_a_slippery_floor_do_not_keep_up():
    built, data = model(friction=0.02)
    data.ctrl[built.wheels] = 0.5 / ROVER.body.wheel_radius
    run(built, data, 0.5)
    # No faster than friction accelerates it, on what of its weight the wheels bear.
    assert 0.0 < data.qvel[built.sheep_speeds[0]] < 1.05 * 0.02 * GRAVITY * 0.5


@pytest.mark.parametrize(("x", "y", "yaw"), [(5.5, 3.0, 0.0), (5.6, 5.6, 0.7), (3.0, 0.5, -1.7)])
def test_a_rover_that_is_driven_against_a_wall_stays_in(x, y, yaw):
    rig = Rig(sheep=((x, y, yaw),))
    driven = rig.drive([(0.5, 0.0)], 3.0)[:, 0, :2]
    assert driven.min() > -0.005
    assert driven.max() < 6.005
    assert min(driven[-1].min(), 6.0 - driven[-1].max()) < 0.01  # it is at the wall
    assert not np.any(rig.plant.crashed())


@pytest.mark.parametrize("aside", [0.0, 0.05])
def test_two_rovers_that_drive_into_each_other_do_not_pass_or_overlap(aside):
    rig = Rig(sheep=((2.5, 3.0, 0.0), (3.5, 3.0 + aside, np.pi)))
    driven = rig.drive([(0.5, 0.0), (0.5, 0.0)], 2.0)
    away = driven[:, 0, :2] - driven[:, 1, :2]
    assert np.linalg.norm(away, axis=-1).min() > 2 * ROVER.body.radius - 0.01
    assert np.all(away[:, 0] < 0.0)
    assert not np.any(rig.plant.crashed())


# Attitudes, and what cannot be built


@pytest.mark.parametrize("angle", [0.3, -1.2])
@pytest.mark.parametrize("axis", range(3))
def test_an_attitude_is_the_angle_about_its_axis(axis, angle):
    quaternion = np.zeros(4)
    quaternion[0], quaternion[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    np.testing.assert_allclose(bodies.attitudes(quaternion), np.eye(3)[axis] * angle, atol=1e-12)


def test_attitudes_turn_by_yaw_then_pitch_then_roll():
    angles = np.random.default_rng(0).uniform(-1.2, 1.2, (20, 3))
    found = []
    for roll, pitch, yaw in angles:
        quaternion = np.zeros(4)
        mujoco.mju_euler2Quat(quaternion, np.array([yaw, pitch, roll]), "zyx")  # intrinsic
        found.append(bodies.attitudes(quaternion))
    np.testing.assert_allclose(found, angles, atol=1e-9)


@pytest.mark.parametrize(
    ("uav", "rover", "told"),
    [
        (with_body(TUM, inertia=(0.001, 0.001, 0.1)), ROVER, r"inertia must satisfy A \+ B >= C"),
        (with_body(TUM, mass=1e-300), ROVER, "mass"),
        (TUM, replace(ROVER, body=replace(ROVER.body, height=0.01)), "size"),
    ],
)
def test_bodies_that_cannot_be_are_refused_in_a_line(uav, rover, told):
    with pytest.raises(Refusal, match=told) as refused:
        model(uav, rover=rover)
    assert "\n" not in str(refused.value)
    assert "tum-simulator and kobuki" in str(refused.value)
