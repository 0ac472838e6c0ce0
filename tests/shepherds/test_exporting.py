"""The ONNX file and the NumPy reader, against our own sheepdog."""

import importlib.util
import json
import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from skydog.errors import Refusal
from skydog.shepherds import exporting, frame, store
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import COMMANDS, OBSERVES, observe, stretched
from skydog.study.cases import cases
from skydog.world import herding, mission, serialise
from skydog.world.limits import AnyDirection
from skydog.world.presets import preset
from skydog.world.spread import FixedSpread, TwoThirdsSpread
from skydog.world.state import State

EXAMPLE = Path(__file__).parents[2] / "examples" / "numpy_sheepdog.py"
ACTORS = ("h-ddpg-4x4", "h-ddpg-6x6")
ALL = (*ACTORS, "dhrl-4x4", "dhrl-6x6")
FLOCKS = (1, 2, 3, 7, 46)
CLOSE = 2e-5  # metres and m/s
# Nearer than this to where the gate, the stray or DHRL's step flips (m, or in the unit of Q), the
# last bit of a number decides, and no two ways of computing it need agree.
TIE = 1e-4


def world_of(name: str, arena: float | None = None):
    """A preset, or a world in which nothing is as in the presets."""
    if name == "fixed":
        return replace(preset("paper", arena), spread=FixedSpread(1.1))
    if name != "other":
        return preset(name, arena)
    world = preset("paper", arena)
    dog = replace(
        world.dog, limits=AnyDirection(), speed=0.8, collecting=0.6, driving=0.7, airspace=0.5
    )
    place = replace(world.arena, goal_x=1.0, goal_y=2.5)
    return replace(world, dog=dog, arena=place, spread=TwoThirdsSpread(0.5))


@cache
def exported(dog: str, name: str = "paper", arena: float | None = 4.0) -> bytes:
    sheepdog, card = store.read(dog)
    return exporting.model(sheepdog, world_of(name, arena), card).SerializeToString()


def session(content: bytes) -> onnxruntime.InferenceSession:
    """One thread, so that tests can run beside each other."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def theirs(content: bytes, sheep, dog):
    positions = {"sheep": np.float32(sheep), "dog": np.float32(dog)}
    velocity, subgoal, drives = map(np.asarray, session(content).run(None, positions))
    return velocity, subgoal, drives


def ours(dog: str, world, sheep, dogs):
    """Velocity, subgoal and drives of every case, and how near it is to a tie."""
    return map(np.asarray, flown(store.load(dog), world, jnp.float32(sheep), jnp.float32(dogs)))


@jax.jit
@partial(jax.vmap, in_axes=(None, None, 0, 0))
def flown(sheepdog, world, sheep, dog):
    state = State(sheep=sheep, dogs=dog[None], force=jnp.zeros_like(sheep))
    subgoal, drives = herding.gate(world, state.sheep, state.dogs)
    seen = sheepdog.arena / world.arena.size * observe(state.sheep, state.dogs, subgoal)
    flips = jnp.asarray(jnp.inf)
    if sheepdog.frame == "folded":
        x, y = jnp.abs(seen[0, :2] - seen[0, 2:])
        flips = jnp.min(jnp.stack([jnp.abs(x - y), x, y]))
        seen, _ = frame.fold(seen)
    for skill, matters in ((sheepdog.drive, drives[0]), (sheepdog.collect, ~drives[0])):
        if not isinstance(skill, Actor):
            best = jnp.sort(skill.values(seen)[0])
            flips = jnp.where(matters, jnp.minimum(flips, best[-1] - best[-2]), flips)
    return sheepdog(world, state)[0], subgoal[0], drives[0], flips


def decided(world, sheep, dogs, flips):
    """Whether a case is further than `TIE` from where it flips, in float64."""
    away = np.linalg.norm(sheep - sheep.mean(axis=1, keepdims=True), axis=-1)
    radius = world.spread.radius(sheep.shape[1])
    gap = np.linalg.norm(sheep - dogs[:, None], axis=-1)
    rank = np.where(away > radius, away - world.dog.nearness * gap, -np.inf)
    ranked = np.sort(rank, axis=1)
    second = ranked[:, -2] if sheep.shape[1] > 1 else np.full(len(sheep), -np.inf)
    scattered = np.max(away, axis=1) > radius
    clear = np.min(np.abs(away - radius), axis=1) > TIE
    with np.errstate(invalid="ignore"):  # none is outside
        clear &= ~scattered | (ranked[:, -1] - second > TIE)
    return clear & (flips > TIE)


def random_states(world, flock: int, count: int = 400):
    """Flocks from packed to scattered, anywhere, and a dog anywhere in its airspace."""
    rng = np.random.default_rng(flock)
    size, beyond = world.arena.size, world.dog.airspace
    wide = size * rng.uniform(0.02, 1.0, (count, 1, 1))
    sheep = (size - wide) * rng.uniform(size=(count, 1, 2)) + wide * rng.uniform(
        size=(count, flock, 2)
    )
    dog = rng.uniform(-beyond, size + beyond, (count, 2))
    return np.float32(sheep).astype(float), np.float32(dog).astype(float)


def scale(world) -> float:
    """2e-5 in 4 m. A float32 coordinate is the coarser the longer the arena, here and there."""
    return CLOSE * max(1.0, world.arena.size / 4.0)


WORLDS = [("paper", 4.0), ("paper", 6.0), ("paper", 12.0), ("strombom2014", None), ("other", 4.0)]
SPREADS = [("strombom2014-sqrt", None), ("fixed", 4.0)]


@pytest.mark.parametrize(
    ("dog", "name", "arena"),
    [(dog, *world) for dog in ALL for world in WORLDS]
    + [("h-ddpg-4x4", *world) for world in SPREADS],
)
def test_the_file_flies_as_ours_from_random_states(dog, name, arena):
    world = world_of(name, arena)
    seen = set()
    for flock in FLOCKS:
        sheep, dogs = random_states(world, flock)
        *mine, flips = ours(dog, world, sheep, dogs)
        clear = decided(world, sheep, dogs, flips)
        # Of two scattered sheep both are the stray: see the next test.
        assert np.mean(clear | ((flock == 2) & ~mine[2])) > 0.98
        found = theirs(exported(dog, name, arena), sheep, dogs)
        for one, other in zip(mine, found, strict=True):
            np.testing.assert_allclose(other[clear], one[clear], atol=scale(world), rtol=0)
        seen |= set(mine[2].tolist())
    assert seen == {True, False}


@pytest.mark.parametrize("dog", ALL)
def test_of_two_scattered_sheep_the_file_collects_either_one(dog):
    world = preset("paper", 12.0)
    sheepdog = store.load(dog)
    xi = sheepdog.arena / 12.0
    sheep, dogs = random_states(world, 2)
    velocity, subgoal, drives = theirs(exported(dog, "paper", 12.0), sheep, dogs)
    outward = sheep - sheep.mean(axis=1, keepdims=True)
    points = sheep + outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    beside = np.abs(np.clip(points, -1.4, 13.4) - subgoal[:, None]).max(axis=-1).min(axis=1)
    assert drives.sum() < 300
    assert beside[~drives].max() < scale(world)

    seen = xi * jax.vmap(lambda s, d, g: observe(s, d[None], g[None])[0])(sheep, dogs, subgoal)
    offset = np.abs(np.asarray(seen[:, :2] - seen[:, 2:]))
    clear = ~drives & (np.abs(offset[:, 0] - offset[:, 1]) > TIE) & (offset.min(axis=1) > TIE)
    seen, symmetry = frame.fold(seen)
    action = frame.unfold(sheepdog.collect(seen), symmetry)
    if isinstance(sheepdog.collect, Actor):
        action = stretched(action, xi)
    else:
        best = np.sort(sheepdog.collect.values(seen), axis=1)
        clear &= best[:, -1] - best[:, -2] > TIE
    action = np.asarray(action)
    np.testing.assert_allclose(velocity[clear], action[clear], atol=scale(world), rtol=0)


def degenerate_states(world):
    """Three sheep and a dog where something is zero, on a wall or in one place."""
    size, beyond = world.arena.size, world.dog.airspace
    far, half = np.array([size, size]), np.full(2, size / 2)
    spread = np.array([[0.55, 0.75], [0.60, 0.70], [0.75, 0.35]]) * size
    line = np.array([[0.125, 0.5], [0.25, 0.5], [1.0, 0.5]]) * size
    corners = np.array([[0.0, 0.0], [size, size], [size, 0.5]])
    flocks = [
        np.tile(half, (3, 1)),  # all on one spot
        np.zeros((3, 2)),  # all on the goal
        np.tile(far, (3, 1)),
        np.array([half, half, far]),  # two on one spot, and a stray in the corner
        np.array([[0.0, 0.0], [0.0, 0.0], [size, 0.0]]),
        spread,
        line,
        corners,
    ]
    states = []
    for flock in flocks:
        subgoal, _ = herding.gate(world, jnp.float32(flock), jnp.zeros((1, 2)))
        centre = flock.astype(np.float32).mean(axis=0)
        here = [centre, np.asarray(subgoal[0]), flock[0], [-beyond] * 2, [size + beyond, -beyond]]
        states += [(flock, dog) for dog in here]
    sheep, dogs = (np.float32(np.stack(part)).astype(float) for part in zip(*states, strict=True))
    return sheep, dogs


@pytest.mark.parametrize(("name", "arena"), WORLDS)
@pytest.mark.parametrize("dog", ALL)
def test_the_file_flies_as_ours_from_degenerate_states(dog, name, arena):
    world = world_of(name, arena)
    sheep, dogs = degenerate_states(world)
    *mine, flips = ours(dog, world, sheep, dogs)
    clear = decided(world, sheep, dogs, flips)
    # Most of these are made to tie: strays on one spot, offsets along an axis or a diagonal.
    assert clear.mean() > 0.15
    found = theirs(exported(dog, name, arena), sheep, dogs)
    for one, other in zip(mine, found, strict=True):
        np.testing.assert_allclose(other[clear], one[clear], atol=scale(world), rtol=0)
    assert np.isfinite(found[0]).all()


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["paper", "strombom2014"])
@pytest.mark.parametrize("dog", ALL)
def test_a_dog_that_cannot_know_where_anyone_is_hovers(dog, name, odd):
    sheep, dogs = random_states(preset(name), 3, count=5)
    before = theirs(exported(dog, name, None), sheep, dogs)[0]
    sheep[1, 2, 0] = sheep[2, 0, 1] = dogs[3, 0] = odd
    after = theirs(exported(dog, name, None), sheep, dogs)[0]
    np.testing.assert_array_equal(after[1:4], 0.0)
    np.testing.assert_array_equal(after[[0, 4]], before[[0, 4]])
    if dog in ACTORS and np.isnan(odd):
        np.testing.assert_array_equal(next(ours(dog, preset(name), sheep, dogs))[1:4], 0.0)


@pytest.mark.parametrize(("dog", "arena"), [("h-ddpg-4x4", 6.0), ("dhrl-4x4", 4.0)])
def test_missions_flown_by_the_file_in_plain_numpy_end_as_ours(dog, arena):
    world = preset("paper", arena)
    starts = cases(world, 30)
    rolled = jax.jit(jax.vmap(lambda start: mission.rollout(world, store.load(dog), start, 400)))
    step = jax.jit(jax.vmap(lambda state, velocity: mission.step(world, state, velocity)))
    done = jax.jit(jax.vmap(lambda state: mission.accomplished(world, state)))
    policy = session(exported(dog, "paper", arena))
    state, home = starts, np.zeros(30, bool)
    for _ in range(400):
        positions = {"sheep": np.asarray(state.sheep), "dog": np.asarray(state.dogs)[:, 0]}
        (velocity,) = policy.run(["velocity"], positions)
        state = step(state, np.asarray(velocity)[:, None])
        home |= np.asarray(done(state))
        if home.all():
            break
    np.testing.assert_array_equal(home, rolled(starts).accomplished[:, -1])
    assert home.all()


# The file


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "new" / "dog.onnx"
    exporting.export(path, store.load("h-ddpg-4x4"), preset("paper", 6.0), card())
    return path


def card():
    return store.read("h-ddpg-4x4")[1]


def test_the_file_opens_by_name_and_takes_any_number_of_cases_and_sheep(written):
    made = onnx.load(written)
    onnx.checker.check_model(made, full_check=True)
    shapes = {
        value.name: [side.dim_param or side.dim_value for side in value.type.tensor_type.shape.dim]
        for value in (*made.graph.input, *made.graph.output)
    }
    assert shapes == {
        "sheep": ["cases", "sheep", 2],
        "dog": ["cases", 2],
        "velocity": ["cases", 2],
        "subgoal": ["cases", 2],
        "drives": ["cases"],
    }
    policy = onnxruntime.InferenceSession(written, providers=["CPUExecutionProvider"])
    for count, flock in ((1, 1), (2, 300), (0, 3)):
        positions = {"sheep": np.ones((count, flock, 2)), "dog": np.zeros((count, 2))}
        positions = {name: array.astype(np.float32) for name, array in positions.items()}
        shapes = [np.asarray(out).shape for out in policy.run(None, positions)]
        assert shapes == [(count, 2), (count, 2), (count,)]


def test_the_file_says_what_it_is_for_which_world_and_in_which_units(written):
    made = onnx.load(written)
    told = {prop.key: prop.value for prop in made.metadata_props}
    assert json.loads(told["card"]) == card()
    assert serialise.unflatten(json.loads(told["world"])) == preset("paper", 6.0)
    assert json.loads(told["observes"]) == list(OBSERVES)
    assert json.loads(told["commands"]) == list(COMMANDS)
    assert "m/s" in told["outputs"]
    assert made.producer_name == "skydog"


def test_the_file_is_read_by_runtimes_of_2022_and_holds_nothing_but_standard_nodes(written):
    made = onnx.load(written)
    assert made.ir_version == 8
    assert [(opset.domain, opset.version) for opset in made.opset_import] == [("", 18)]
    assert not made.functions
    assert {node.domain for node in made.graph.node} == {""}


def test_the_same_sheepdog_in_the_same_world_is_the_same_file(tmp_path, written):
    dog, told = store.read("h-ddpg-4x4")
    exporting.export(tmp_path / "again.onnx", dog, preset("paper", 6.0), told)
    assert (tmp_path / "again.onnx").read_bytes() == written.read_bytes()


def test_export_without_onnx_is_refused_with_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    dog, told = store.read("h-ddpg-4x4")
    with pytest.raises(Refusal, match=r"run: pip install 'skydog\[onnx\]'$"):
        exporting.export(tmp_path / "dog.onnx", dog, preset("paper"), told)
    assert not list(tmp_path.iterdir())


def test_a_folder_is_refused_as_the_file(tmp_path):
    dog, told = store.read("h-ddpg-4x4")
    with pytest.raises(Refusal, match="is a folder"):
        exporting.export(tmp_path, dog, preset("paper"), told)


# The reader


@pytest.fixture(scope="module")
def reader():
    """examples/numpy_sheepdog.py as a module."""
    told = importlib.util.spec_from_file_location("numpy_sheepdog", EXAMPLE)
    assert told is not None
    assert told.loader is not None
    module = importlib.util.module_from_spec(told)
    told.loader.exec_module(module)
    return module


@pytest.mark.parametrize("xi", [1.0, 4 / 6, 6 / 4, 1 / 3])
@pytest.mark.parametrize("dog", ALL)
def test_the_reader_gives_the_actions_of_ours(reader, dog, xi):
    sheepdog = store.load(dog)
    weights, told = reader.read(store.find(Path(dog)))
    assert told == store.read(dog)[1]
    # Both are float32: each is some 1e-6 off the exact action for every metre that is seen.
    seen = np.random.default_rng(5).uniform(-4, 4, (1000, 4)).astype(np.float32)
    for skill in ("collect", "drive"):
        policy = getattr(sheepdog, skill)
        folded, symmetry = frame.fold(jnp.float32(xi) * seen)
        if sheepdog.frame == "paper":
            folded, symmetry = jnp.float32(xi) * seen, frame.fold(jnp.ones((1000, 4)))[1]
        mine = frame.unfold(policy(folded), symmetry)
        clear = np.ones(len(seen), bool)
        if isinstance(policy, Actor):
            mine = stretched(mine, xi)
        else:
            best = np.sort(policy.values(folded), axis=1)
            clear = best[:, -1] - best[:, -2] > TIE
            assert clear.mean() > 0.99
        read = reader.act(weights, told, skill, seen, xi)
        np.testing.assert_allclose(read[clear], np.asarray(mine)[clear], atol=CLOSE, rtol=0)


def test_the_reader_is_35_lines_that_need_numpy_alone(reader):
    lines = [line for line in EXAMPLE.read_text().splitlines() if line.strip()]
    assert len(lines) <= 35
    imports = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert imports <= {"json", "sys", "pathlib", "numpy"}
    assert set(reader.main()) == {"collect", "drive"}


def test_home_is_home_to_the_last_digit_of_a_float32():
    sheepdog = store.load("h-ddpg-4x4")
    at_home = [exporting.model(sheepdog, preset("paper", arena), {}) for arena in (4.0, 4.00000001)]
    operations = [[node.op_type for node in model.graph.node] for model in at_home]
    assert operations[0] == operations[1]
