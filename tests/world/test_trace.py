import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog import files
from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics, traces
from skydog.world import mission
from skydog.world.params import preset

ARRAYS = ("time", "sheep", "dogs", "subgoal", "drives", "command", "accomplished")
WORLD = preset("paper-w05", 4.0)


@jax.jit
def flown(shepherd):
    nearly = jnp.array([[1.6, 1.6], [1.9, 1.6], [1.6, 1.9]])
    start = mission.start(nearly, jnp.array([[3.0, 3.0], [3.5, 3.0]]))
    return mission.rollout(WORLD, shepherd, start, 40)


@pytest.fixture(scope="module")
def unfinished():
    trace = flown(Strombom(speed=0.0))
    assert not metrics.success(trace)
    return trace


@pytest.fixture(scope="module")
def finished():
    trace = flown(Strombom())
    assert metrics.success(trace)
    return trace


@pytest.fixture
def saved(tmp_path, unfinished):
    path = tmp_path / "trace.safetensors"
    traces.save(path, unfinished, "a rule dog")
    return path


def test_a_trace_comes_back_exactly_with_its_world_and_its_shepherd(saved, unfinished):
    back, shepherd = traces.load(saved)
    assert shepherd == "a rule dog"
    for name in ARRAYS:
        here, there = getattr(unfinished, name), getattr(back, name)
        assert here.dtype == there.dtype
        assert np.array_equal(here, there)
    assert jax.tree.structure(back.world) == jax.tree.structure(WORLD)
    assert [np.float32(x) for x in jax.tree.leaves(back.world)] == [
        np.float32(x) for x in jax.tree.leaves(WORLD)
    ]


def test_a_trace_is_saved_up_to_the_end_of_its_mission_and_measures_the_same(tmp_path, finished):
    traces.save(tmp_path / "x", finished, "rule")
    back, _ = traces.load(tmp_path / "x")
    assert len(back.time) == int(metrics.steps(finished)) + 1 < len(finished.time)
    assert metrics.success(back)
    for metric in (metrics.steps, metrics.steps_gcm, metrics.distance):
        np.testing.assert_allclose(metric(back), metric(finished), rtol=1e-6)


def test_a_mission_commanded_by_no_number_can_be_kept_and_read_again(tmp_path, unfinished):
    world = unfinished.world
    start = mission.start(unfinished.sheep[0], unfinished.dogs[0])
    flown = mission.rollout(world, lambda _, state: state.dogs * jnp.nan, start, 5)
    traces.save(tmp_path / "x", flown, "a shepherd that divides by zero")
    back, _ = traces.load(tmp_path / "x")
    assert np.array_equal(back.dogs, np.repeat(unfinished.dogs[:1], 6, axis=0))


def changed(path, change):
    arrays, card = files.load_arrays(path, traces.KIND)
    change(arrays, card)
    files.save_arrays(path, arrays, card)
    with pytest.raises(Refusal) as refusal:
        traces.load(path)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


@pytest.mark.parametrize("name", ARRAYS)
def test_a_trace_without_one_of_its_arrays_is_refused_by_its_name(saved, name):
    assert name in changed(saved, lambda arrays, card: arrays.pop(name))


@pytest.mark.parametrize(
    ("name", "misshapen"),
    [
        ("time", np.zeros((41, 1), np.float32)),
        ("time", np.zeros(40, np.float32)),
        ("sheep", np.zeros((41, 3, 3), np.float32)),
        ("sheep", np.zeros((41, 0, 2), np.float32)),
        ("dogs", np.zeros((41, 1, 2), np.float32)),
        ("subgoal", np.zeros((41, 2), np.float32)),
        ("drives", np.zeros((41, 3), bool)),
        ("command", np.zeros((1, 2, 2), np.float32)),
        ("accomplished", np.zeros(42, bool)),
    ],
)
def test_a_misshapen_array_is_refused(saved, name, misshapen):
    message = changed(saved, lambda arrays, card: arrays.update({name: misshapen}))
    assert "no whole trace" in message


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("sheep", np.float64), ("time", np.int32), ("drives", np.uint8), ("accomplished", np.float32)],
)
def test_an_array_of_another_type_is_refused_by_name_and_type(saved, name, dtype):
    message = changed(saved, lambda a, card: a.update({name: a[name].astype(dtype)}))
    assert name in message
    assert np.dtype(dtype).name in message


@pytest.mark.parametrize("value", [1e20, -1e20])
@pytest.mark.parametrize("name", ["time", "sheep", "dogs", "subgoal", "command"])
def test_a_trace_out_of_bounds_is_refused_by_its_name(saved, name, value):
    message = changed(saved, lambda arrays, card: arrays[name].flat.__setitem__(-1, value))
    assert name in message


def test_a_trace_of_no_instants_is_refused(saved):
    def empty(arrays, card):
        arrays.update({name: array[:0] for name, array in arrays.items()})

    assert "no whole trace" in changed(saved, empty)


@pytest.mark.parametrize("world", [None, [], "paper", 4.0])
def test_a_trace_without_a_world_is_refused(saved, world):
    assert "world" in changed(saved, lambda arrays, card: card.update(world=world))


@pytest.mark.parametrize("value", [None, "wide", [4.0], {}, 1e39, 10**400])
def test_a_world_with_a_senseless_parameter_is_refused_by_its_name(saved, value):
    message = changed(saved, lambda arrays, card: card["world"].update({"arena.size": value}))
    assert "arena.size" in message


def test_a_world_with_a_missing_parameter_is_refused_by_its_name(saved):
    assert "dog.speed" in changed(saved, lambda arrays, card: card["world"].pop("dog.speed"))


def test_a_file_of_another_kind_is_refused(tmp_path):
    files.save_arrays(tmp_path / "x", {}, {"kind": "sheepdog"})
    with pytest.raises(Refusal, match="no trace"):
        traces.load(tmp_path / "x")


def test_a_trace_holds_its_parameters_as_plain_json(saved):
    content = saved.read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    card = json.loads(header["__metadata__"]["skydog"])
    assert card["world"]["arena.size"] == 4.0
    assert card["world"]["dog.per_axis"] is True
