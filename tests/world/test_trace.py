import io
import json
from dataclasses import fields, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.shepherds.strombom import Strombom
from skydog.study import cases, evaluate, metrics
from skydog.view.animation import gif
from skydog.world import mission
from skydog.world import trace as traces
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.presets import preset
from skydog.world.trace import ENDINGS, Ending, Poses

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


def test_the_beginning_of_a_mission_is_its_first_steps(unfinished):
    begun = traces.beginning(unfinished, 7)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(begun, name), getattr(unfinished, name)[:8])
    assert len(traces.beginning(unfinished, 1000).time) == len(unfinished.time)


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
    arrays, card = load_arrays(path, traces.KIND)
    change(arrays, card)
    save_arrays(path, arrays, card)
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
    assert "not a full trace" in message


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

    assert "not a full trace" in changed(saved, empty)


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
    save_arrays(tmp_path / "x", {}, {"kind": "sheepdog"})
    with pytest.raises(Refusal, match="no trace"):
        traces.load(tmp_path / "x")


def test_a_trace_holds_its_parameters_as_plain_json(saved):
    content = saved.read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    card = json.loads(header["__metadata__"]["skydog"])
    assert card["world"]["arena.size"] == 4.0
    assert card["world"]["dog.limits.law"] == "per axis"
    assert card["ending"] == "out of time"
    assert card["steps"] == 40


# How it ended, poses, and sheep recorded now and then


def a_mission(steps=40, every=1, count=2):
    world = preset("paper", 4.0)
    starts = cases.cases(world, count, "random", seed=4)
    return evaluate.fly(world, Strombom(), starts, steps, every=every)


def crashed(trace, at, how="UAV down"):
    """One mission, cut where something went wrong."""
    parts = {name: getattr(trace, name)[: at + 1] for name in ARRAYS}
    ending = Ending(how=jnp.asarray(ENDINGS.index(how)), steps=trace.ending.steps)
    return replace(trace, **parts, ending=ending)


@pytest.mark.parametrize("how", ENDINGS[2:])
def test_a_crash_is_a_failure_with_all_the_steps_that_the_mission_was_given(finished, how):
    whole = int(metrics.steps(finished))
    trace = crashed(finished, whole // 2, how)
    assert not metrics.success(trace)
    assert int(metrics.steps(trace)) == int(metrics.steps_gcm(trace)) == 40
    assert float(metrics.steps_ratio(trace)) > float(metrics.steps_ratio(finished))
    home_first = replace(finished, ending=replace(trace.ending))  # it crashed on its way back
    assert int(metrics.steps(home_first)) == int(metrics.steps_gcm(home_first)) == 40
    flown = float(metrics.distance(trace))
    assert 0 < flown < float(metrics.distance(finished))


def test_a_mission_cut_short_counts_all_its_steps_unless_nobody_knows_them(finished):
    early = {name: getattr(finished, name)[:4] for name in ARRAYS}
    cut = replace(finished, **early)
    assert not metrics.success(cut)
    assert int(metrics.steps(cut)) == 40
    assert int(metrics.steps(replace(cut, ending=None))) == 3


@pytest.mark.parametrize("how", ENDINGS)
def test_how_a_mission_ended_comes_back(tmp_path, finished, how):
    trace = finished if how == "accomplished" else crashed(finished, 3, how)
    traces.save(tmp_path / "x", trace, "rule")
    back, _ = traces.load(tmp_path / "x")
    assert traces.how_it_ended(back) == traces.how_it_ended(trace) == how
    for metric in (metrics.success, metrics.steps, metrics.steps_gcm):
        assert metric(back) == metric(trace)


@pytest.mark.parametrize(
    ("ending", "steps"),
    [
        ("bored", 40),
        (3, 40),
        ("UAV down", None),
        ("UAV down", -1),
        ("UAV down", 4.0),
        (["x"], 1),
        ("upset", 3),
    ],
)
def test_an_ending_that_is_none_is_refused(saved, ending, steps):
    message = changed(saved, lambda arrays, card: card.update(ending=ending, steps=steps))
    assert "ended" in message


def with_poses(trace):
    instants, dogs, sheep = len(trace.time), trace.dogs.shape[1], trace.sheep.shape[1]
    drawn = iter(range(9))

    def some(*shape):
        return jax.random.normal(jax.random.key(next(drawn)), shape)

    poses = Poses(
        altitude=some(instants, dogs),
        attitude=some(instants, dogs, 3),
        setpoint=some(instants, dogs, 3),
        yaw=some(instants, sheep),
        speed=some(instants, sheep),
        turn_rate=some(instants, sheep),
    )
    return replace(trace, poses=poses)


def test_poses_come_back_exactly(tmp_path, finished):
    posed = with_poses(finished)
    traces.save(tmp_path / "x", posed, "rule")
    back, _ = traces.load(tmp_path / "x")
    until = len(back.time)
    for field in fields(Poses):
        here, there = getattr(posed.poses, field.name), getattr(back.poses, field.name)
        assert np.array_equal(here[:until], there)


def test_poses_of_which_one_is_missing_or_misshapen_are_refused(tmp_path, finished):
    traces.save(tmp_path / "x", with_poses(finished), "rule")
    assert "poses.yaw" in changed(tmp_path / "x", lambda a, _: a.pop("poses.yaw"))
    wrong = np.zeros((3, 3), np.float32)
    assert "poses" in changed(tmp_path / "x", lambda a, _: a.update({"poses.altitude": wrong}))


@pytest.mark.parametrize("every", [2, 7, 40, 1000, None])
def test_sheep_recorded_now_and_then_are_those_of_the_whole_mission_and_measure_the_same(every):
    whole, thin = a_mission(200), a_mission(200, every)
    assert thin.recorded is not None
    at = np.asarray(thin.recorded[0])
    assert at[0] == 0
    assert at[-1] == 200
    assert len(at) < 102
    assert np.array_equal(np.asarray(whole.sheep)[:, at], thin.sheep)
    for name in set(ARRAYS) - {"sheep"}:
        assert np.array_equal(getattr(whole, name), getattr(thin, name))
    ours, theirs = evaluate.measure(whole), evaluate.measure(thin)
    for metric in ours:
        np.testing.assert_array_equal(ours[metric], theirs[metric])


@pytest.mark.parametrize("every", [3, None])
def test_a_thinned_trace_comes_back_and_is_drawn_at_the_instants_it_has(tmp_path, every):
    thin = evaluate.one_case(a_mission(200, every), 1)
    traces.save(tmp_path / "x", thin, "rule")
    back, _ = traces.load(tmp_path / "x")
    assert len(back.time) == int(metrics.steps(thin)) + 1
    assert back.recorded is not None
    assert int(back.recorded[-1]) == len(back.time) - 1
    for metric in (metrics.success, metrics.steps, metrics.steps_gcm, metrics.distance):
        np.testing.assert_allclose(metric(back), metric(thin), rtol=1e-6)
    # A film has the dogs of every instant; the sheep stand until they are recorded again.
    with Image.open(io.BytesIO(gif({"thin": back}))) as film:
        film.seek(len(back.time) // 3)  # raises where there is no such frame
    drawn = traces.frames(back)
    assert drawn.recorded is None
    assert len(drawn.time) == len(drawn.sheep) == len(drawn.dogs) == len(back.recorded)
    assert np.array_equal(traces.step_numbers(drawn), back.recorded)
    assert bool(drawn.accomplished[-1]) == bool(metrics.success(thin))


@pytest.mark.parametrize(
    "recorded", [[1, 2, 3], [0, 5, 5], [0, 9, 3], [0, 1, 10**6], [0, -1, 2], [0.0, 1.0, 2.0]]
)
def test_sheep_recorded_at_no_such_instants_are_refused(tmp_path, recorded):
    traces.save(tmp_path / "x", evaluate.one_case(a_mission(20, 10), 0), "rule")
    kind = np.int32 if isinstance(recorded[0], int) else np.float32
    message = changed(tmp_path / "x", lambda a, _: a.update(recorded=np.array(recorded, kind)))
    assert "recorded" in message


def test_a_trace_too_large_to_be_read_again_is_not_written(tmp_path, finished, monkeypatch):
    monkeypatch.setattr(traces, "LARGEST", 1000)
    with pytest.raises(Refusal, match="--every"):
        traces.save(tmp_path / "x", finished, "rule")
    assert not list(tmp_path.iterdir())


DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize(
    ("name", "law", "steps", "distance"),
    [
        ("paper-w05", StrombomFlock, 10, 1.4142059087753296),
        ("strombom2014", StrombomFlock, 20, 60.0),
        ("literal", LiteralFlock, 17, 2.404153347015381),
    ],
)
def test_a_file_whose_world_carries_no_laws_is_read_and_measures_as_it_did(
    name, law, steps, distance
):
    back, shepherd = traces.load(DATA / f"{name}-without-laws.safetensors")
    assert isinstance(back.world.flock, law)
    assert shepherd.startswith("Strombom")
    assert int(metrics.steps(back)) == steps
    assert float(metrics.distance(back)) == pytest.approx(distance, rel=1e-6)
    # Its world flies on as it flew.
    state = mission.start(back.sheep[0], back.dogs[0])
    if name != "strombom2014":  # whose noise nobody kept the key of
        again = mission.rollout(back.world, Strombom(), state, len(back.time) - 1)
        np.testing.assert_allclose(again.sheep, back.sheep, atol=1e-5)
