"""Shepherds by name: ours, code, ONNX files, saved policies."""

import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import skydog
from skydog import references
from skydog.errors import Refusal
from skydog.shepherds import exporting, finding, named, scope, store
from skydog.shepherds.foreign import Policy
from skydog.study.cases import cases
from skydog.world.presets import preset

WORLD = preset("paper", 4.0)
STARTS = cases(WORLD, 2)
FILE = """
import numpy as np

import skydog

fast = skydog.Strombom()


def dog(world, state):
    return 0.5 * fast(world, state)


def maker():
    return fast


class Kept:
    def __call__(self, world, state):
        return fast(world, state)


def predict(seen):
    return -np.sign(seen[:, 2:4])


def wrong():
    return 7


def fails(world, state):
    return wolf


def outside(world, state):
    return np.asarray(state.sheep)[:1]


def narrow(world, state):
    return state.dogs[0]


asks = skydog.from_policy(predict, divide_by=2.0)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "kennel.py").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    references.run.cache_clear()
    for name in ("kennel", "skydog_world_kennel"):
        sys.modules.pop(name, None)
    sys.path[:] = [entry for entry in sys.path if entry != str(tmp_path)]


@pytest.mark.parametrize("where", ["kennel.py", "kennel"])
@pytest.mark.parametrize("name", ["dog", "fast", "maker", "Kept", "asks"])
def test_code_is_a_shepherd_or_makes_one(folder, where, name):
    shepherd, card = named.read(f"{where}:{name}")
    start = jax.tree.map(lambda leaf: leaf[0], STARTS)
    assert shepherd(WORLD, start).shape == (1, 2)
    assert card == {"name": name}
    named.trial(f"{where}:{name}", shepherd, WORLD, STARTS)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("kennel.py:wolf", "has no 'wolf'; it has dog, maker, Kept, predict"),
        ("kennel.py:predict", "function of world and state.*skydog.from_policy"),
        ("kennel.py:wrong", "made 7"),
        ("kennel.py", r"such as kennel\.py:dog"),
        ("nowhere.py:dog", "no file nowhere.py"),
        ("nowhere:dog", "no package is called nowhere"),
        ("model.zip", "no such file"),
        ("ppo:model.zip", "model.zip: there is no such file"),
        ("dqn:model.zip", "a2c, ddpg, ppo, sac, td3"),
        ("none.onnx", "no such file"),
        ("rex", r"no sheepdog is called rex.*strombom.*FILE\.py:NAME.*ppo:FILE\.zip"),
    ],
)
def test_a_name_that_means_nothing_is_refused_with_what_would(folder, name, says):
    with pytest.raises(Refusal, match=says):
        named.read(name)


def test_a_zip_without_its_algorithm_is_told_the_form(folder):
    (folder / "model.zip").write_bytes(b"PK")
    with pytest.raises(Refusal, match=r"ppo:model\.zip"):
        finding.check("model.zip")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("fails", r"kennel\.py:fails failed in line 31: NameError: name 'wolf'"),
        ("outside", "outside cannot be compiled.*skydog.from_policy"),
        ("narrow", r"shape \(2,\)"),
    ],
)
def test_a_shepherd_that_cannot_fly_is_refused_before_it_does(folder, name, says):
    shepherd, _ = named.read(f"kennel.py:{name}")
    with pytest.raises(Refusal, match=says):
        named.trial(f"kennel.py:{name}", shepherd, WORLD, STARTS)


def test_a_run_folder_may_have_a_colon_in_its_name():
    assert finding.kind("runs/2026-11-26:b") == "sheepdog"
    assert finding.kind("runs/kennel.py:dog") == finding.kind("kennel.dogs:dog") == "code"


def test_a_mistyped_name_runs_no_code(folder):
    (folder / "kennel.py").write_text("raise SystemExit('run')\n")
    finding.check("kennel.py:dog")
    with pytest.raises(Refusal, match=r"name what is in it, such as kennel\.py:NAME"):
        finding.check("kennel.py")


def test_an_onnx_file_flies_what_was_exported(folder):
    sheepdog, card = store.read("h-ddpg-4x4")
    exporting.export(Path("dog.onnx"), sheepdog, WORLD, card)
    flown, told = named.read("dog.onnx")
    start = jax.tree.map(lambda leaf: leaf[1], STARTS)
    assert np.allclose(flown(WORLD, start), sheepdog(WORLD, start), atol=2e-5)
    assert (told["name"], told["taught_for"]["arenas"]) == ("dog", [4.0, 4.0])
    with pytest.raises(Refusal, match="flies one dog, not 2"):
        named.trial("dog.onnx", flown, WORLD, cases(WORLD, 2, dogs=2))
    with pytest.raises(Refusal, match="knows of no obstacles"):
        named.trial("dog.onnx", flown, preset("paper", scene="gate"), STARTS)
    assert "law 'paper'" in " ".join(scope.beyond(told, preset("strombom2014"), 3))
    Path("other.onnx").write_bytes(b"other")
    with pytest.raises(Refusal, match="no file of skydog export"):
        named.read("other.onnx")


def test_a_policy_is_saved_as_its_name_and_how_it_observes(folder):
    for policy in (
        skydog.load("kennel:asks"),
        skydog.from_policy("kennel.py:predict", "full", 3.0),
    ):
        store.save(folder / store.FILE, policy, {"note": "ours"})
        again, card = named.read(f"policy:{folder}")
        assert isinstance(again, Policy)
        assert (again.observation, again.divide_by) == (policy.observation, policy.divide_by)
        assert card["note"] == "ours"
        assert "policy:" in (folder / "sheepdog.md").read_text()
    # A file from outside names code: it is run if the user says so.
    with pytest.raises(Refusal, match="if you trust it, say policy:"):
        skydog.load(folder)


def test_what_cannot_be_saved_says_so(folder):
    with pytest.raises(Refusal, match=r'skydog\.from_policy\("ppo:model\.zip"\)'):
        store.save(folder / store.FILE, skydog.from_policy(lambda seen: seen[:, :2]), {})


def test_a_shepherd_has_a_short_name_in_tables():
    assert finding.title("runs/kennel.py:dog") == "dog"
    assert finding.title("ppo:runs/model.zip") == "ppo-model"
    assert finding.title("runs/dog.onnx") == "dog"
    assert finding.title("team:h-ddpg-4x4") == "team:h-ddpg-4x4"


def test_the_digest_of_a_file_changes_with_it(folder):
    before = named.digest("kennel.py:dog")
    assert before == named.digest("kennel.py:maker")
    (folder / "kennel.py").write_text(FILE + "\n")
    assert named.digest("kennel.py:dog") != before
    assert named.digest("strombom") == "rule"


@pytest.mark.parametrize("name", ["strombom", "h-ddpg-4x4", "team:h-ddpg-4x4", "package.mod:dog"])
def test_what_lies_in_no_folder_has_the_same_name_everywhere(name):
    assert finding.anywhere(name) == name


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("a.py:dog", "{}/a.py:dog"),
        ("ppo:a.zip", "ppo:{}/a.zip"),
        ("a.onnx", "{}/a.onnx"),
        ("runs", "{}/runs"),
        ("team:runs", "team:{}/runs"),
        ("policy:runs", "policy:{}/runs"),
    ],
)
def test_a_file_is_named_by_its_whole_path_elsewhere(name, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("a.py", "a.zip", "a.onnx"):
        (tmp_path / file).touch()
    (tmp_path / "runs").mkdir()
    assert finding.anywhere(name) == whole.format(tmp_path)
    assert finding.anywhere(finding.anywhere(name)) == whole.format(tmp_path)


def test_a_saved_policy_means_something_else_when_its_code_has_changed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "def predict(seen):\n    return -seen[:, 2:4]\n"
    Path("fast.py").write_text(code)
    policy = skydog.from_policy("fast.py:predict")
    store.save(Path("kept/sheepdog.safetensors"), policy, {})
    before = named.digest("policy:kept")
    Path("fast.py").write_text(code.replace("-seen", "-0.1 * seen"))
    assert named.digest("policy:kept") != before


def test_a_shepherd_that_ends_the_program_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ends.py").write_text("import sys\n\n\ndef dog(world, state):\n    sys.exit(3)\n")
    with pytest.raises(Refusal, match=r"ends\.py:dog failed in line 5: SystemExit"):
        named.trial("ends.py:dog", named.load("ends.py:dog"), WORLD, STARTS)
    policy = skydog.from_policy(lambda seen: sys.exit(3))
    with pytest.raises(Refusal, match="SystemExit"):
        named.trial("policy", policy, WORLD, STARTS)


@pytest.mark.parametrize("name", ["", "team:", "policy:"])
def test_no_name_is_no_shepherd(name):
    with pytest.raises(Refusal, match="names no shepherd"):
        finding.check(name)


def test_an_algorithm_is_named_in_small_letters(tmp_path):
    (tmp_path / "a.zip").touch()
    with pytest.raises(Refusal, match=r"try ppo:.*a\.zip"):
        finding.check(f"PPO:{tmp_path / 'a.zip'}")
