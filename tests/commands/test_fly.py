"""The commands take whatever flies missions: here, a world in which every drone falls down."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.commands import herd, replay, test, train, training, zoo
from skydog.learning.curriculum import Curriculum
from skydog.learning.history import History
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, scenarios
from skydog.world import trace as traces
from skydog.world.mission import MAX_STEPS, Fly
from skydog.world.presets import preset
from skydog.world.trace import ENDINGS, Ending, Poses

FALLS = 11  # the step at which the drone falls
WORLD = preset("paper", 4.0)


def falling(world, shepherd, starts, steps=MAX_STEPS, key=None):
    """Missions that end with a fall, with the poses of the bodies."""
    flown = evaluate.fly(world, shepherd, starts, steps, key)
    assert flown.ending is not None
    count, dogs, sheep = len(starts.sheep), starts.dogs.shape[1], starts.sheep.shape[1]
    short = {
        name: getattr(flown, name)[:, : FALLS + 1]
        for name in ("time", "sheep", "dogs", "subgoal", "drives", "command", "accomplished")
    }
    instants = (count, FALLS + 1)
    height = jnp.linspace(2.0, 0.0, FALLS + 1)[None, :, None] * jnp.ones((count, 1, dogs))
    poses = Poses(
        altitude=height,
        attitude=jnp.zeros((*instants, dogs, 3)),
        setpoint=jnp.full((*instants, dogs, 3), 2.0),
        yaw=jnp.zeros((*instants, sheep)),
        speed=jnp.zeros((*instants, sheep)),
        turn_rate=jnp.zeros((*instants, sheep)),
    )
    ending = Ending(how=jnp.full(count, ENDINGS.index("UAV down")), steps=flown.ending.steps)
    return replace(flown, **short, poses=poses, ending=ending)


def test_what_flies_missions_is_a_fly():
    assert isinstance(evaluate.fly, Fly)
    assert isinstance(falling, Fly)


def assert_all_fell(row, count):
    assert (row["success"], row["cases"]) == (0.0, count)
    assert row["steps"]["mean"] == row["steps_gcm"]["mean"] == 1000
    assert 0.0 < row["distance"]["mean"] < 1.42 * 0.1 * FALLS


def test_a_test_of_falling_drones_is_a_row_of_failures_whose_traces_say_why(tmp_path):
    starts = cases.cases(WORLD, 3)
    results = test.run(
        "Strombom-4x4", Strombom(), WORLD, starts, MAX_STEPS, None, tmp_path, falling
    )
    assert_all_fell(results["Strombom-4x4"], 3)
    path = tmp_path / "traces" / "Strombom-4x4-1.safetensors"
    flown, _ = traces.load(path)
    assert traces.how_it_ended(flown) == "UAV down"
    assert flown.poses is not None
    assert float(flown.poses.altitude[-1, 0]) == 0.0
    for name in ("x.html", "x.gif"):
        replay.replay((path,), tmp_path / name)
    assert '"ending":"UAV down"' in (tmp_path / "x.html").read_text()


@pytest.mark.parametrize("command", [herd, train])
def test_what_is_trained_is_flown_by_what_flies(tmp_path, monkeypatch, command):
    # A training takes no time here: its sheepdog comes from the zoo.
    history = History(np.ones(20), np.ones(20, int), np.ones(20, bool), np.zeros(0, int), None)
    taught = store.load("h-ddpg-4x4"), {"collect": history, "drive": history}
    monkeypatch.setattr(training, "train_all", lambda *_: True)
    monkeypatch.setattr(training, "fuse", lambda *_: taught)
    count = 2 if command is herd else train.CASES
    given = (2, False) if command is herd else (1, False, False)
    results = command.run(tmp_path / "run", Curriculum(), 0, *given, "skydog", falling)
    for row in results.values():
        assert_all_fell(row, count)
    if command is herd:
        assert "UAV down" in (tmp_path / "run" / "report.html").read_text()


def test_the_study_is_flown_by_what_flies():
    trained = zoo.read()
    flight = scenarios.flights({name: dogs[0] for name, dogs in trained.dogs.items()})
    first, random, shown = scenarios.fly_one(flight["Strombom-4x4"], falling)
    assert not first["success"].any()
    assert (len(first["steps"]), len(random["steps"])) == (30, 1000)
    assert (random["steps"] == 1000).all()
    assert traces.how_it_ended(shown) == "UAV down"
    assert jax.tree.leaves(shown.poses)
