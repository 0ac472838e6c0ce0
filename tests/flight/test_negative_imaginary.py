"""The claim that the loops are negative imaginary (NI), by python-control."""

from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any

import control
import numpy as np
import pytest
from loops import MARGINS, S, is_stable, late, positive_feedback, real_part, velocity

from skydog.errors import Refusal
from skydog.flight import fuzzy, profiles, sni
from skydog.flight.profiles import Position

UAVS = profiles.ship("uav")
OMEGA = np.geomspace(1e-4, 1e4, 4001)  # rad/s
TUM = profiles.uav("tum-simulator")

sni_loops = [
    *(pytest.param(profiles.uav(name).position, 1.0, id=name) for name in UAVS),
    *(
        pytest.param(profiles.rover(name).yaw, scale, id=f"{name}, Γ times {scale:g}")
        for name in profiles.ship("rover")
        for scale in (fuzzy.RULES.min(), 1.0, fuzzy.RULES.max())
    ),
]


def controller(loop) -> Any:
    return control.tf(*sni.coefficients(loop))


# The plant: from the commanded velocity to the position


def test_the_velocity_loop_of_tum_simulator_is_the_one_of_its_sources():
    of_sources = 5 * (S + 2) * (S + 5) / (S**3 + 10 * S**2 + 45 * S + 50)
    np.testing.assert_allclose(velocity(TUM)(1j * OMEGA), of_sources(1j * OMEGA), rtol=1e-6)


@pytest.mark.parametrize("plant", [velocity(TUM), 1 / (0.38 * S + 1)], ids=["loop", "lag"])
def test_without_delay_tum_simulator_is_ni_at_all_frequencies(plant):
    # Im V(jω)/(jω) = -Re V(jω)/ω, whose numerator has no sign but one.
    assert np.all(np.real(plant.poles()) < 0.0)
    assert np.all(real_part(plant) >= 0.0)
    assert np.all(np.imag((plant / S)(1j * OMEGA)) < 0.0)
    assert MARGINS["ni_up_to"](lambda omega: plant(1j * omega)) == np.inf


@pytest.mark.parametrize(
    ("delay", "of_lag", "of_loop"), [(0.02, 11.37, 13.31), (0.1, 4.915, 6.567)]
)
def test_with_delay_tum_simulator_is_ni_up_to_a_frequency(delay, of_lag, of_loop):
    def lag(omega):
        return np.exp(-1j * omega * delay) / (0.38j * omega + 1.0)

    loop = partial(MARGINS["velocity_loop"], TUM, delay=delay)
    # Where the lag's phase and the delay's make a quarter turn.
    assert np.arctan(0.38 * of_lag) + delay * of_lag == pytest.approx(np.pi / 2, rel=1e-3)
    for response, expected in ((lag, of_lag), (loop, of_loop)):
        found = MARGINS["ni_up_to"](response)
        assert found == pytest.approx(expected, rel=0.02)
        below, above = (response(np.array([share * found])) for share in (0.99, 1.01))
        assert below.real > 0.0 > above.real


@pytest.mark.parametrize("name", UAVS)
def test_a_drone_is_ni_up_to_the_frequency_that_is_told_and_not_above(name):
    uav = profiles.uav(name)
    # Not by the formula that told it, but by python-control's own arithmetic.
    response = velocity(uav, late(uav.link.delay))
    found = MARGINS["ni_up_to"](partial(MARGINS["velocity_loop"], uav))
    below = np.geomspace(1e-4, min(0.99 * found, 1e4), 4001)
    assert is_stable(response)
    assert np.all(np.imag((response / S)(1j * below)) < 0.0)
    if found < np.inf:
        assert np.imag((response / S)(1.01j * found)) > 0.0


def test_a_tilt_that_lags_behind_its_command_is_not_ni_without_the_velocity_loop():
    # Which is why the position loop commands velocities: relative degree 3 turns too far.
    position = 9.81 / (S * (S + 0.58)) / (0.1 * S + 1)
    assert np.any(np.imag(position(1j * OMEGA)) > 0.0)


# The controller


@pytest.mark.parametrize(("loop", "scale"), sni_loops)
def test_the_controller_is_strictly_negative_imaginary_and_its_dc_gain_is_negative(loop, scale):
    loop = replace(loop, gamma=scale * loop.gamma)
    n = controller(loop)
    assert np.all(np.real(n.poles()) < 0.0)
    imaginary = np.imag(n(1j * OMEGA))
    assert np.all(imaginary < 0.0)
    pole = loop.gamma * loop.phi
    np.testing.assert_allclose(imaginary, -loop.gamma * OMEGA / (OMEGA**2 + pole**2), rtol=1e-6)
    assert n(0).real == pytest.approx(1.0 / loop.phi - loop.delta)
    assert n(0).real < 0.0


@pytest.mark.parametrize("name", UAVS)
def test_the_position_loop_is_stable_with_its_delay_and_its_trim_estimator(name):
    uav = profiles.uav(name)
    plant = velocity(uav, late(uav.link.delay)) / S
    n = controller(uav.position)
    for whole in (n, n - uav.position.trim / S):
        assert is_stable(positive_feedback(plant, whole))


@pytest.mark.parametrize(("loop", "scale"), sni_loops[len(UAVS) :])
def test_the_yaw_loop_is_stable_with_a_tenth_of_a_second_of_delay(loop, scale):
    n = controller(replace(loop, gamma=scale * loop.gamma))
    assert is_stable(positive_feedback(late(0.1) / S, n))


@pytest.mark.parametrize("share", [0.9, 0.5])
@pytest.mark.parametrize("name", UAVS)
def test_a_dc_gain_above_zero_is_refused_and_would_diverge(tmp_path, name, share):
    uav = profiles.uav(name)
    bad = replace(uav.position, delta=share / uav.position.phi, trim=0.0)
    plant = velocity(uav, late(uav.link.delay)) / S
    assert controller(bad)(0).real > 0.0
    assert not is_stable(positive_feedback(plant, controller(bad)))

    shipped = resources.files("skydog.flight").joinpath("profiles", f"{name}.toml")
    lines = shipped.read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("delta"))
    lines[at] = f"delta = {bad.delta}"
    file = tmp_path / "wild.toml"
    file.write_text("\n".join(lines))
    with pytest.raises(Refusal, match=r"delta must be larger than 1 / phi"):
        profiles.uav(str(file))
    # What it tells to try instead can be flown.
    lines[at] = f"delta = {2.0 / bad.phi}"
    file.write_text("\n".join(lines))
    assert controller(profiles.uav(str(file)).position)(0).real < 0.0


# The discrete controller


@pytest.mark.parametrize(("loop", "scale"), sni_loops)
def test_the_discrete_controller_answers_a_constant_error_as_the_continuous_one(loop, scale):
    dt, error = 0.01, 0.7
    time = dt * np.arange(300)
    exact = replace(loop, gamma=scale * loop.gamma)
    errors: Any = np.full(300, error)
    continuous = control.forced_response(-controller(exact), time, errors).outputs
    memory, outputs = np.zeros(1), []
    for _ in time:
        memory, output = sni.step(loop, memory, np.array([error]), dt, float(scale))
        outputs.append(output[0])
    np.testing.assert_allclose(outputs, continuous, atol=1e-6)


def test_the_trim_estimator_removes_the_offset_that_a_drift_leaves():
    drift, dt = 0.05, 0.02  # m/s, s

    def offset(loop: Position) -> float:
        position = velocity = lag = np.zeros(2)
        trim = np.zeros(2)
        for _ in range(1500):
            lag, command = sni.step(loop, lag, -position, dt)
            trim = sni.trim(loop, trim, -position, dt)
            velocity = velocity + dt / 0.38 * (command + trim - velocity)
            position = position + dt * (velocity + np.array([drift, 0.0]))
        return float(position[0])

    loop = TUM.position
    without = drift / (loop.delta - 1.0 / loop.phi)  # what N(0) leaves of it
    assert offset(replace(loop, trim=0.0)) == pytest.approx(without, rel=1e-3)
    assert abs(offset(loop)) < 0.01 * without
