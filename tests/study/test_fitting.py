"""A flock that is known is found again in its tracks."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.commands import fit as command
from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, fitting, tracks
from skydog.study.smoothing import smoothed_force, surroundings
from skydog.study.tracks import Event, Piece
from skydog.world import loading
from skydog.world.laws.varied import VariedFlock
from skydog.world.presets import preset
from skydog.world.state import State

FLOCK = VariedFlock(
    2.0, 12.0, inertia=0.5, grouping=1.5, escape=1.0, repulsion=2.0, alignment=1.3, noise=0.2
)
SHEEP, EVENTS, STEPS = 8, 9, 60


def flown():
    """Missions far from every wall: where a wall stops a sheep, no force says whither it goes."""
    world = preset("strombom2014", 400.0, SHEEP, goal=(200.0, 200.0))
    world = replace(world, flock=FLOCK)
    rng = np.random.default_rng(0)
    around = 2 * np.pi * np.arange(EVENTS) / EVENTS
    centre = 200 + 40 * np.stack([np.cos(around), np.sin(around)], axis=-1)[:, None]
    sheep = centre + rng.uniform(-8, 8, (EVENTS, SHEEP, 2))
    dogs = centre + rng.uniform(-25, 25, (EVENTS, 1, 2))
    starts = State(*(jnp.asarray(each, jnp.float32) for each in (sheep, dogs, 0 * sheep)))
    flights = evaluate.fly(world, Strombom(), starts, STEPS, jax.random.key(0))
    return [tracks.of_trace(str(case), evaluate.one_case(flights, case)) for case in range(EVENTS)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run folder of `skydog fit`, of a flock that is known."""
    place = tmp_path_factory.mktemp("fit")
    tracks.write(place / "tracks.csv", flown())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "RESAMPLES", 2)
        assert command.fit(place / "tracks.csv", place / "run", as_json=True) == 0
    return place / "run"


@pytest.fixture(scope="module")
def found(folder):
    return json.loads((folder / "results.json").read_text())


def test_a_known_flock_is_recovered_within_ten_per_cent(found):
    fitted = {name: each["value"] for name, each in found["parameters"].items()}
    scale = fitting.SCALE / sum(getattr(FLOCK, name) for name in fitting.WEIGHTS)
    for name in ("avoidance", "sensing"):
        assert fitted[name] == pytest.approx(getattr(FLOCK, name), rel=0.02)
    for name in (*fitting.WEIGHTS, "noise"):
        assert fitted[name] == pytest.approx(scale * getattr(FLOCK, name), rel=0.1)
    assert fitted["speed"] == pytest.approx(1.0, rel=0.01)
    assert fitted["graze"] < 0.01


def test_held_out_events_are_predicted_best_with_alignment(found):
    error = {name: np.array(each["folds"]) for name, each in found["heading_error"].items()}
    assert all(each.shape == (3, fitting.HORIZON) for each in error.values())
    aligned = error["fitted with alignment"][:, 0]
    for name in ("persistence", "Strömbom's weights", "fitted without alignment"):
        assert np.all(aligned < error[name][:, 0])


def test_the_fitted_world_is_a_file_that_flies(folder):
    made = loading.maker(str(folder / "world.json"))
    world = made(arena=150.0)
    assert loading.sheep_of(made) == SHEEP
    assert loading.title(str(folder / "world.json")) == "world"
    assert (world.arena.size, world.arena.dt, world.flock.follow) == (150.0, 1.0, None)
    starts = State(jnp.full((1, 3, 2), 140.0), jnp.full((1, 1, 2), 149.0), jnp.zeros((1, 3, 2)))
    trace = evaluate.fly(world, Strombom(), starts, 20, jax.random.key(0))
    assert np.linalg.norm(trace.sheep[0, -1, 0] - trace.sheep[0, 0, 0]) > 1.0


def test_a_folder_with_results_is_refused_and_left_as_it_is(folder):
    before = {file: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(Refusal, match="holds results already"):
        command.fit(folder.parent / "tracks.csv", folder)
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


def test_a_step_shorter_than_the_tracks_have_is_refused(tmp_path):
    with pytest.raises(Refusal, match="try --step 1"):
        command.run(flown()[:1], 0.5, 0, tmp_path, lambda _, things: iter(things))


def test_sheep_that_always_stand_are_refused():
    still = Piece(np.arange(9.0), np.zeros((9, 2, 2)), np.ones((9, 1, 2)))
    with pytest.raises(Refusal, match="stand all the time"):
        fitting.moves(tracks.windows([Event("1", [still])], 1.0, 3), 1.0)


# Smooth radii


def states(count=50, sheep=5, dogs=2):
    rng = np.random.default_rng(1)
    angles = rng.uniform(0, 2 * np.pi, (count, sheep))
    before = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    before[::3, 0] = 0.0
    places = rng.normal(0, 3, (count, sheep, 2)), rng.normal(0, 12, (count, dogs, 2))
    return State(*(jnp.asarray(part, jnp.float32) for part in (*places, before)))


@pytest.mark.parametrize("alignment", [None, 1.3])
def test_with_hard_radii_the_smoothed_force_is_the_force(alignment):
    flock = replace(FLOCK, alignment=alignment)
    smooth = smoothed_force(flock, surroundings(states()), 1e-7)
    hard = jax.vmap(lambda state: flock.force(state, None))(states())
    np.testing.assert_allclose(
        np.moveaxis(np.asarray(smooth), -1, 0).swapaxes(1, 2), hard, atol=1e-4
    )


def test_only_smoothed_radii_have_a_gradient():
    radii = jnp.array([2.0, 12.0])

    def summed(radii, smooth):
        flock = replace(FLOCK, avoidance=radii[0], sensing=radii[1])
        if smooth:
            return jnp.sum(smoothed_force(flock, surroundings(states()), 0.1))
        return jnp.sum(jax.vmap(lambda state: flock.force(state, None))(states()))

    assert np.all(jax.grad(summed)(radii, False) == 0.0)
    assert np.all(np.abs(jax.grad(summed)(radii, True)) > 0.01)


@pytest.mark.parametrize("sheep", [1, 2])
def test_a_lone_sheep_on_the_dog_has_finite_gradients(sheep):
    on_one = State(jnp.ones((1, sheep, 2)), jnp.ones((1, 1, 2)), jnp.zeros((1, sheep, 2)))

    def summed(flock):
        return jnp.sum(smoothed_force(flock, surroundings(on_one), 0.1))

    slope = jax.grad(summed)(jax.tree.map(jnp.float32, FLOCK))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))


# A world as a file


def test_a_law_of_ones_own_is_not_written_as_a_world(tmp_path):
    class Own(VariedFlock):
        pass

    world = replace(preset("paper"), flock=Own(**vars(FLOCK)))
    with pytest.raises(Refusal, match=r"--world FILE\.py:NAME"):
        loading.write(tmp_path / "world.json", world, 3)
    assert not (tmp_path / "world.json").exists()


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"kind": "trace"}', '{"kind": "world", "sheep": 3}', "[" * 100_000]
)
def test_a_file_that_is_no_world_is_refused(tmp_path, text):
    (tmp_path / "world.json").write_text(text)
    with pytest.raises(Refusal):
        loading.maker(str(tmp_path / "world.json"))
