"""Missions that go wrong: each is found out, ends with its reason, and counts as a failure."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigs import ending, poses

from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, metrics
from skydog.twin import Disturbances, Twin, missions, plant
from skydog.twin.plant import Plant
from skydog.world import mission
from skydog.world import trace as traces
from skydog.world.presets import preset

pytestmark = pytest.mark.usefixtures("unchecked")

WORLD = preset("paper", 4.0)
TWIN = Twin(profile="crazyflie", threads=1)
STEPS = 9
TAKE_OFF = 250  # ticks: 2 m at 1 m/s, and half a second to settle
BROKEN = 4  # the step in which something happens


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(missions, "SETTLES", 0.5)


@pytest.fixture(scope="module")
def begin():
    """Two missions alike, of which the first will go wrong."""
    sheep = jnp.array(((3.0, 3.0), (3.0, 3.6), (2.5, 2.6)))
    one = mission.start(sheep, jnp.array(((1.2, 1.4),)))
    return jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), one)


def flown_with(monkeypatch, begin, happens, at=BROKEN, twin=TWIN):
    """Both missions, in the first of which something `happens` to the plant in a step."""
    step, calls = Plant.step, []

    def stepped(self, *arguments):
        step(self, *arguments)
        calls.append(None)
        if len(calls) == TAKE_OFF + 10 * at + 5:  # a call in each tick, ten of them in a step
            happens(self)

    monkeypatch.setattr(Plant, "step", stepped)
    return twin(WORLD, Strombom(), begin, STEPS)


def turned_over(who):
    def happens(self):
        at = {"sheep": self.bodies.sheep[1], "dog": self.bodies.dogs[0]}[who]
        self._qpos[0, at + 3 : at + 7] = (np.cos(0.8), np.sin(0.8), 0.0, 0.0)  # 92 degrees
        if who == "sheep":
            self._qpos[0, at + 2] += 0.15

    return happens


def moved(who, place):
    def happens(self):
        at = {"sheep": self.bodies.sheep[2], "dog": self.bodies.dogs[0]}[who]
        self._qpos[0, at : at + len(place)] = place

    return happens


@pytest.mark.parametrize(
    ("happens", "how"),
    [
        (turned_over("sheep"), "upset"),
        (turned_over("dog"), "UAV down"),
        (moved("dog", (1.0, 1.0, 0.2)), "UAV down"),
        (moved("dog", (6.5, 1.0)), "left the cage"),
        (moved("dog", (1.0, -2.5)), "left the cage"),
        (moved("dog", (1.0, 1.0, 3.5)), "left the cage"),
        (moved("sheep", (4.9, 3.0, 0.5)), "left the cage"),
    ],
    ids=["rover over", "drone over", "drone low", "far", "behind", "high", "rover out"],
)
def test_a_mission_that_goes_wrong_ends_with_its_reason_and_with_all_its_steps(
    monkeypatch, begin, happens, how
):
    flown = flown_with(monkeypatch, begin, happens)
    failed, other = (evaluate.one_case(flown, case) for case in (0, 1))
    assert traces.how_it_ended(failed) == how
    assert traces.how_it_ended(other) == "out of time"
    assert not np.any(failed.accomplished)
    # It is found out in the step in which it happens; from then on nothing moves.
    for part in jax.tree.leaves((failed.sheep, failed.dogs, failed.poses)):
        assert part.shape[0] == STEPS + 1
        stood = np.asarray(part)[BROKEN + 1 :]
        np.testing.assert_array_equal(stood, np.broadcast_to(stood[0], stood.shape))
    assert not np.any(np.asarray(failed.command)[BROKEN + 1 :])
    assert np.ptp(np.asarray(other.dogs)[BROKEN + 1 :], axis=0).max() > 0.1
    # Giving up early does not pay.
    assert int(metrics.steps(failed)) == int(metrics.steps(other)) == STEPS
    assert int(ending(failed).steps) == STEPS


def test_a_drone_whose_rotors_stop_falls_and_is_down(monkeypatch, begin):
    real, stopped = plant.autopilot.rotors, []

    def rotors(*arguments):
        memory, thrust = real(*arguments)
        if stopped:
            thrust[0] = 0.0
        return memory, thrust

    monkeypatch.setattr(plant.autopilot, "rotors", rotors)
    flown = flown_with(monkeypatch, begin, lambda self: stopped.append(None), at=1)
    assert [traces.how_it_ended(evaluate.one_case(flown, case)) for case in (0, 1)] == [
        "UAV down",
        "out of time",
    ]
    altitude = np.asarray(poses(flown).altitude)[0, :, 0]
    fallen = 0.1 * (np.flatnonzero(altitude < plant.LOW)[0] - 1.5)
    assert fallen == pytest.approx(np.sqrt(2 * (2.0 - plant.LOW) / 9.81), abs=0.2)


def test_a_drone_that_never_took_off_has_no_mission(monkeypatch, begin):
    real = plant.autopilot.rotors

    def rotors(*arguments):
        memory, thrust = real(*arguments)
        return memory, 0.5 * thrust

    monkeypatch.setattr(plant.autopilot, "rotors", rotors)
    flown = TWIN(WORLD, Strombom(), begin, 3)
    assert traces.how_it_ended(evaluate.one_case(flown, 0)) == "UAV down"
    assert np.ptp(np.asarray(poses(flown).altitude), axis=1).max() == 0.0


def test_a_failed_mission_is_saved_whole_and_read_back_with_its_reason(
    monkeypatch, begin, tmp_path
):
    flown = flown_with(monkeypatch, begin, moved("dog", (6.5, 1.0)))
    traces.save(tmp_path / "failed.safetensors", evaluate.one_case(flown, 0), "strombom")
    read, _ = traces.load(tmp_path / "failed.safetensors")
    assert traces.how_it_ended(read) == "left the cage"
    assert len(read.time) == STEPS + 1


def test_a_gale_ends_missions_and_a_failure_is_no_success(begin):
    tight = replace(WORLD, dog=replace(WORLD.dog, airspace=0.0))
    gale = replace(TWIN, disturb=Disturbances(gust=8.0))
    flown = gale(tight, Strombom(), begin, 20)
    assert not np.any(flown.accomplished)
    assert set(np.asarray(ending(flown).how).tolist()) <= {1, 3, 4}
    assert np.any(np.asarray(ending(flown).how) != traces.OUT_OF_TIME)
