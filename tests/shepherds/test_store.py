import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.learning import ddpg, train
from skydog.learning.lessons import Lesson
from skydog.shepherds import store
from skydog.shepherds.networks import Actor, GreedyQ
from skydog.shepherds.sheepdog import COMMANDS, OBSERVES, Sheepdog
from skydog.world import mission
from skydog.world.presets import preset

WORLD = preset("paper", 4.0)
FROM = {"preset": "paper", "seed": 17, "results": {"H-DDPG-4x4 success": 1 / 3}}


def a_sheepdog(arena: float = 4.0) -> Sheepdog:
    collect, drive = (Actor(4, 2, sizes, jax.random.key(len(sizes))) for sizes in ((5, 7), (6,)))
    return Sheepdog(collect, drive, arena)


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / store.FILE
    store.save(path, a_sheepdog(), FROM)
    return path


def refusal(path) -> str:
    """What a refused file is told; it and its folder are left as they were."""
    folder = path if path.is_dir() else path.parent
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    with pytest.raises(Refusal) as caught:
        store.read(path)
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert len(message) < 600
    return message


# What is kept


@pytest.mark.parametrize("arena", [4.0, 4.1, 150.0])
def test_a_sheepdog_comes_back_exactly_and_flies_the_same(tmp_path, arena):
    dog = a_sheepdog(arena)
    store.save(tmp_path / "x.safetensors", dog, FROM)
    back, _ = store.read(tmp_path / "x.safetensors")
    assert back.arena == arena
    assert jax.tree.structure(back) == jax.tree.structure(dog)
    for here, there in zip(jax.tree.leaves(dog), jax.tree.leaves(back), strict=True):
        assert np.array_equal(here, there)
    for key in jax.random.split(jax.random.key(0), 10):
        state = mission.reset(WORLD, key)
        assert np.array_equal(dog(WORLD, state), back(WORLD, state))


def test_a_sheepdog_of_four_actions_comes_back_as_one(tmp_path):
    collect, drive = (GreedyQ(4, 2, (5,), jax.random.key(seed)) for seed in range(2))
    dog = Sheepdog(collect, drive, 4.0)
    store.save(tmp_path / store.FILE, dog, FROM)
    back, card = store.read(tmp_path)
    assert card["policy"] == "chooser"
    for key in jax.random.split(jax.random.key(5), 10):
        state = mission.reset(WORLD, key)
        flown = back(WORLD, state)
        assert np.array_equal(dog(WORLD, state), flown)
        assert sorted(np.abs(flown[0]).tolist()) == [0.0, 1.0]


def test_a_policy_of_an_unknown_kind_is_refused(saved):
    arrays, card = load_arrays(saved, "sheepdog")
    save_arrays(saved, arrays, card | {"policy": "oracle"})
    assert "oracle" in refusal(saved)


@pytest.mark.parametrize("name", ["h-ddpg-4x4", "H-DDPG-6x6", "dhrl-4x4", "dhrl-6x6"])
def test_a_sheepdog_that_ships_is_found_by_its_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    dog, card = store.read(name)
    assert card["name"].lower() == name.lower()
    assert float(dog.arena) == float(name[-1])


def test_a_run_folder_is_nearer_than_the_zoo(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store.save(tmp_path / "h-ddpg-4x4" / store.FILE, a_sheepdog(arena=9.0), FROM)
    assert store.load("h-ddpg-4x4").arena == 9.0


def test_an_unknown_name_is_refused_with_those_that_ship(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Refusal, match=r"no sheepdog is called rex.*h-ddpg-4x4"):
        store.load("rex")


def test_the_card_says_where_a_sheepdog_comes_from_and_what_it_sees(saved):
    _, card = store.read(saved)
    assert card == {
        "kind": "sheepdog",
        "observes": list(OBSERVES),
        "commands": list(COMMANDS),
        "arena": 4.0,
        "frame": "folded",
        "policy": "actor",
        **FROM,
    }


def test_the_card_for_people_names_the_observations_in_order_and_the_seed(saved):
    text = saved.with_suffix(".md").read_text()
    lines = text.splitlines()
    assert lines[0].startswith("# ")
    assert "- seed: 17" in lines
    places = [lines.index(f"{place}. {name}") for place, name in enumerate(OBSERVES, 1)]
    assert places == sorted(places)
    assert "- H-DDPG-4x4 success: 0.3333" in lines


def test_a_sheepdog_is_found_by_its_run_folder(saved):
    assert store.find(saved.parent) == saved
    assert store.load(saved.parent).arena == 4.0


def test_a_folder_of_several_sheepdogs_is_refused_and_one_of_them_named(tmp_path):
    for seed in (3, 4):
        store.save(tmp_path / f"seed-{seed}" / store.FILE, a_sheepdog(), FROM)
    message = refusal(tmp_path)
    assert "2 sheepdogs" in message
    named = tmp_path / "seed-3"
    assert str(named) in message
    store.load(named)


def test_a_folder_without_a_sheepdog_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing here")
    assert store.FILE in refusal(tmp_path)


# What is refused


def test_a_missing_file_is_refused(tmp_path):
    refusal(tmp_path / "nowhere.safetensors")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_sheepdog_is_refused(saved, share):
    whole = saved.read_bytes()
    saved.write_bytes(whole[: int(share * len(whole))])
    refusal(saved)


@pytest.mark.parametrize("seed", range(5))
def test_random_bytes_are_refused(tmp_path, seed):
    path = tmp_path / "noise.safetensors"
    path.write_bytes(np.random.default_rng(seed).bytes(5_000))
    refusal(path)


def forge(path, arrays=None, **card):
    """Write what `path` holds again, with other arrays and another card."""
    found, was = load_arrays(path, store.KIND)
    save_arrays(path, {**found, **(arrays or {})}, {**was, **card})


@pytest.mark.parametrize("what", ["observes", "commands"])
@pytest.mark.parametrize(
    "told",
    [["a", "b", "c", "d", "e", "f"], ["a", "b"], [], "x", None, 4, {"a": 1}],
    ids=["six", "two", "none", "text", "null", "a number", "a group"],
)
def test_a_sheepdog_that_sees_or_commands_other_numbers_is_refused(saved, what, told):
    forge(saved, **{what: told})
    message = refusal(saved)
    assert what in message
    assert "train it again" in message
    if isinstance(told, list):
        assert f"{what} {len(told)} numbers" in message


def test_the_same_numbers_in_another_order_are_refused(saved):
    forge(saved, observes=list(reversed(OBSERVES)))
    refusal(saved)


@pytest.mark.parametrize("arena", [0.0, -4.0, 1e300, 10**30, "4", None, [4.0], {}])
def test_an_arena_that_cannot_be_is_refused(saved, arena):
    forge(saved, arena=arena)
    assert "arena" in refusal(saved)


def layers(skill, *shapes):
    return {
        f"{skill}.{depth}.{part}": np.zeros(shape if part == "weight" else shape[:1], np.float32)
        for depth, shape in enumerate(shapes)
        for part in ("weight", "bias")
    }


@pytest.mark.parametrize(
    "arrays",
    [
        layers("collect", (5, 6)),
        layers("collect", (5, 4), (7, 6)),
        layers("drive", (6, 4), (3, 6)),
        layers("drive", (6, 4), (2, 6), (1, 2)),
        layers("drive", (6, 4), (2, 6), (5000, 2), (2, 5000)),
        {"drive.0.bias": np.zeros((6, 1), np.float32)},
        {"drive.0.weight": np.zeros(24, np.float32)},
        {"drive.0.weight": np.zeros((6, 4), np.float64)},
        {"drive.0.weight": np.zeros((6, 4), np.float16)},
        {"drive.0.weight": np.zeros((6, 4), np.int32)},
        {"drive.0.weight": np.full((6, 4), np.nan, np.float32)},
        {"collect.1.bias": np.full(7, np.inf, np.float32)},
        layers("drive", (6, 4), *[(6, 6)] * 98, (2, 6)),
        layers("drive", (6, 4), *[(2, 6), (6, 2)] * 8, (2, 6)),
        layers("drive", (0, 4), (2, 0)),
    ],
    ids=[
        "other inputs",
        "layers that do not meet",
        "three commands",
        "a layer too many",
        "a layer too wide",
        "a bias of two dimensions",
        "a flat weight",
        "float64",
        "float16",
        "integers",
        "nan",
        "infinity",
        "100 layers",
        "more layers than are read",
        "a layer of no nodes",
    ],
)
def test_layers_that_are_no_skill_are_refused(saved, arrays):
    forge(saved, arrays)
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize("missing", ["collect.0.weight", "collect.2.bias", "drive.1.weight"])
def test_a_missing_layer_is_refused(saved, missing):
    arrays, card = load_arrays(saved, store.KIND)
    arrays.pop(missing)
    save_arrays(saved, arrays, card)
    assert "damaged" in refusal(saved)


def test_a_sheepdog_without_a_skill_is_refused(saved):
    arrays, card = load_arrays(saved, store.KIND)
    kept = {name: array for name, array in arrays.items() if not name.startswith("drive")}
    save_arrays(saved, kept, card)
    assert "drive" in refusal(saved)


def test_a_checkpoint_is_no_sheepdog(tmp_path):
    config = ddpg.Config(actor=(4,), critic=(4,), memory=50)
    train.train(Lesson(WORLD, "drive"), config, 0, 40, tmp_path, {"skill": "drive"})
    message = refusal(train.checkpoint_in(tmp_path))
    assert "checkpoint" in message
    assert "sheepdog" in message


def test_a_sheepdog_of_float32_scalars_is_saved_like_one_of_plain_numbers(tmp_path):
    dog = eqx.tree_at(lambda s: s.arena, a_sheepdog(), jnp.float32(4.0))
    store.save(tmp_path / store.FILE, dog, FROM)
    assert json.loads(json.dumps(store.read(tmp_path)[1]))["arena"] == 4.0
