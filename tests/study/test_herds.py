import jax
import numpy as np
import pytest

from skydog.shepherds.lama import Lama
from skydog.study import evaluate, herds
from skydog.study.herds import NEVER
from skydog.world.presets import preset

RUNS, SHEEP, DOGS, STEPS = 6, 5, 3, 700
WORLD = preset("lama2024", sheep=SHEEP)
KEY = jax.random.key(3)
BEGUN = herds.starts(WORLD, RUNS, 1, SHEEP, DOGS)


@pytest.fixture(scope="module")
def found():
    return herds.herd(WORLD, Lama(), BEGUN, STEPS, KEY)


def test_starts_are_on_a_ring_around_the_goal():
    starts = herds.starts(preset("lama2024"), 200, 0, 3, 2)
    for places in (starts.sheep, starts.dogs):
        distance = np.linalg.norm(np.asarray(places) - 25.0, axis=-1)
        assert distance.min() == pytest.approx(6.0, abs=0.2)
        assert distance.max() == pytest.approx(22.5, abs=0.2)


def test_a_run_is_the_mission_that_is_flown_from_its_start(found):
    traces = evaluate.fly(WORLD, Lama(), BEGUN, STEPS, KEY)
    distance = np.linalg.norm(np.asarray(traces.sheep) - 25.0, axis=-1)
    home = np.mean(distance <= 5.0, axis=-1)
    for run in range(RUNS):
        over = np.flatnonzero(home[run] == 1.0)
        assert found.captured[run] == (over[0] if len(over) else NEVER)
        assert found.settled[run] == found.captured[run]  # 99 % of five sheep is all of them
        assert found.share[run] == pytest.approx(home[run].max())
    assert (found.captured != NEVER).any()


def test_a_run_does_not_depend_on_how_many_are_herded_with_it(found, monkeypatch):
    monkeypatch.setattr(herds, "A_FEW", 1)
    again = herds.herd(WORLD, Lama(), BEGUN, STEPS, KEY)
    for name in herds.Herds._fields:
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))


def test_herding_stops_at_its_last_step_and_tells_how_far_it_is():
    told = []
    none = herds.herd(WORLD, Lama(), BEGUN, 20, KEY, lambda *what: told.append(what))
    assert (none.captured == NEVER).all()
    assert told == [(20, 0)]
