"""The loops that theory speaks of are those that the twin flies: `benchmarks/margins.py`."""

import runpy
from pathlib import Path
from typing import Any

import control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigs import ARDRONE, CRAZYFLIE, TUM, Rig

from skydog.flight import altitude
from skydog.twin import Disturbances, Twin
from skydog.world import mission
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

MARGINS = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "margins.py"))


@pytest.mark.parametrize("omega", [2.0, 5.0])
@pytest.mark.parametrize("uav", [TUM, CRAZYFLIE], ids=lambda uav: uav.name)
def test_the_velocity_loop_on_board_answers_as_the_linear_one(uav, omega):
    periods, size = 2, 0.2
    time = 0.005 * np.arange(round(2 * np.pi * (periods + 1) / omega / 0.005))
    command = np.zeros((len(time), 3))
    command[:, 0] = size * np.sin(omega * time)
    _, velocity, _ = Rig(uav).fly(command)
    settled = time > time[-1] - 2 * np.pi * periods / omega
    # A command is held for 5 ms, and what is recorded is its end.
    wave = np.exp(-1j * omega * (time[settled] + 0.0025))
    found = 2.0 * np.mean(velocity[settled, 0] * wave) * 1j / size
    expected = MARGINS["velocity_loop"](uav, np.array([omega]), delay=0.0)[0]
    assert found == pytest.approx(expected, abs=0.03)


def test_the_velocity_of_a_crazyflie_follows_a_step_as_python_control_has_it():
    _, velocity, _ = Rig(CRAZYFLIE).fly([(0.1, 0.0, 0.0)] * 300)
    s: Any = control.tf("s")
    loop = CRAZYFLIE.velocity
    tilt, drag = MARGINS["tilt_loop"](CRAZYFLIE), CRAZYFLIE.body.drag / CRAZYFLIE.body.mass
    closed = tilt * (loop.gain + drag) / (s + drag + tilt * loop.gain)
    time = 0.005 * np.arange(301)
    expected = 0.1 * control.step_response(closed, time).outputs[1:]
    np.testing.assert_allclose(velocity[:, 0], expected, atol=0.003)


class Nudge(eqx.Module):
    """A shepherd that flies a short way, and then holds."""

    def __call__(self, world, state):
        return jnp.where(state.dogs[:, :1] < 2.05, jnp.array([0.5, 0.0]), 0.0)


@pytest.mark.parametrize(("share", "swings"), [(0.75, False), (1.25, True)])
def test_ardrone2_bears_as_much_delay_as_its_margin_says_and_no_more(share, swings):
    late = round(share * MARGINS["margins"]("ardrone2").delay, 2)
    twin = Twin("ardrone2", disturb=Disturbances(action_delay=late), threads=1)
    begin = mission.start(jnp.array([[5.0, 5.0]]), jnp.array([[2.0, 2.0]]))
    flown = twin(preset("paper", 6.0), Nudge(), jax.tree.map(lambda leaf: leaf[None], begin), 120)
    swing = np.ptp(np.asarray(flown.dogs)[0, 95:, 0, 0])
    assert (swing > 0.5) if swings else (swing < 0.1)  # its tilt's limit bounds the swing


@pytest.mark.parametrize("uav", [TUM, ARDRONE, CRAZYFLIE], ids=lambda uav: uav.name)
def test_a_drone_takes_off_holds_and_lands_softly(uav):
    floor = uav.body.height / 2
    rig = Rig(uav, height=floor)
    start = rig.plant.truth().dogs[0, 0]

    def goes_by(climbs, seconds):
        found = []
        for _ in range(round(seconds / 0.01)):
            climb = float(climbs(rig.plant.truth().dogs[0, :, 2])[0])
            found.append(rig.fly([(0.0, 0.0, climb)] * 2))
        place, velocity, attitude = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return place, velocity, attitude

    place, velocity, attitude = goes_by(
        lambda z: altitude.climb(uav, z, np.array(altitude.HEIGHT)), 8.0
    )
    assert velocity[:, 2].max() <= uav.velocity.largest_climb + 0.05
    assert place[:, 2].max() < altitude.HEIGHT + 0.2
    np.testing.assert_allclose(place[-200:, 2], altitude.HEIGHT, atol=0.03)
    np.testing.assert_allclose(attitude, 0.0, atol=1e-6)
    place, velocity, _ = goes_by(lambda z: altitude.land(uav, z), 9.0)
    touches = np.flatnonzero(place[:, 2] < floor + 0.005)[0]
    assert velocity[touches, 2] > -0.3
    np.testing.assert_allclose(place[-1], start, atol=0.03)


def test_the_thrust_of_a_hovering_drone_is_steady_after_its_take_off():
    """D on the acceleration of the step before made tum-simulator's swing between 0 and 2 m g."""
    rig = Rig(TUM, height=0.05)
    seen = []
    for _ in range(1600):
        z = rig.plant.truth().dogs[0, :, 2]
        climb = float(altitude.climb(TUM, z, np.array(altitude.HEIGHT))[0])
        rig.fly([(0.0, 0.0, climb)])
        seen.append(rig.plant._ctrl[0, rig.bodies.rotors[0]].sum())
    hover = np.array(seen[-200:])
    assert np.abs(np.diff(hover)).max() < 0.01 * 9.81 * TUM.body.mass
