import json
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from skydog import files
from skydog.arrays import load_arrays, save_arrays
from skydog.commands import training
from skydog.learning import train
from skydog.shepherds import store
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate
from skydog.study.cases import cases
from skydog.world import trace as traces
from skydog.world.presets import PRESETS, preset

COMMANDS = ("herd", "train", "test", "twin", "reproduce", "replay", "watch", "export", "presets")


@pytest.fixture
def a_sheepdog(tmp_path):
    actor = Actor(4, 2, (6,), jax.random.key(0))
    store.save(tmp_path / "dog" / store.FILE, Sheepdog(actor, actor, 4.0), {"seed": 0})
    return tmp_path / "dog" / store.FILE


@pytest.fixture(scope="module")
def flown():
    world = preset("paper", 4.0)
    return jax.tree.map(lambda x: x[0], evaluate.fly(world, Strombom(), cases(world, 1), 60))


@pytest.fixture
def a_trace(tmp_path, flown):
    traces.save(tmp_path / "flown.safetensors", flown, "Strombom-4x4")
    return tmp_path / "flown.safetensors"


# Help


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_an_example_in_its_help(skydog, command):
    code, out, _ = skydog(command, "--help")
    assert code == 0
    assert f"Example: skydog {command}" in " ".join(out.replace("│", " ").split())


def test_the_help_lists_every_command_and_does_not_import_jax():
    code = (
        "import sys; from skydog import cli; sys.argv = ['skydog', '--help']\n"
        "try: cli.main()\n"
        "except SystemExit as left: print(left.code, 'jax' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] in ("0 False", "None False")
    assert all(command in done.stdout for command in COMMANDS)


# Refusals


@pytest.mark.parametrize(
    ("arguments", "value", "remedy"),
    [
        ("train --sheep -1", "-1", "--sheep 3"),
        ("test strombom --sheep 0", "0", "--sheep 3"),
        ("herd --arena 0", "0", "--arena 4"),
        ("train --arena nan", "nan", "--arena 4"),
        ("test strombom --arena -3", "-3", "--arena 4"),
        ("train --preset nope", "'nope'", ", ".join(PRESETS)),
        ("test strombom --preset nope", "'nope'", ", ".join(PRESETS)),
        ("herd --cases 0", "0", "--cases 30"),
        ("test strombom --cases 0", "0", "--cases 30"),
        ("test strombom --dogs 0", "0", "--dogs 1"),
        ("test strombom --sheep 4", "4", "--starts random"),
        ("herd --steps 0", "0", "--steps"),
        ("train --steps -5", "-5", "--steps"),
        ("train --seeds 0", "0", "--seeds 8"),
        ("test nowhere.safetensors", "nowhere.safetensors", "check the path"),
        ("replay nowhere.safetensors", "nowhere.safetensors", "check the path"),
        ("test strombom --steps 0", "0", "--steps 1000"),
        ("test strombom --steps 99999999999", "99999999999", "--steps 1000"),
        ("test strombom --every 0", "0", "--every 10"),
        ("test strombom --goal 4", "'4'", "--goal 4,4"),
        ("test strombom --goal 1,2,3", "'1,2,3'", "--goal 4,4"),
        ("test strombom --goal 5,1", "5,1", "--goal 4,4"),
        ("test strombom --goal nan,1", "nan", "--goal 4,4"),
        ("test strombom --goal-radius 0", "got 0;", "--goal-radius 2"),
        ("test strombom --nearness -1", "-1", "--nearness 1"),
        ("train --goal a,b", "'a,b'", "--goal 4,4"),
        ("train --goal 9,9", "9,9", "--goal 4,4"),
        ("herd --goal 9,9", "9,9", "--goal 4,4"),
        ("herd --goal-radius 5", "5", "--arena 10"),
        ("export h-ddpg-4x4 --onnx --goal 0,5", "0,5", "--goal 4,4"),
        ("export h-ddpg-4x4 --onnx --nearness nan", "nan", "--nearness 1"),
        ("watch --goal 1", "'1'", "--goal 4,4"),
        ("reproduce --physical --patterns", "--physical and --patterns", "leave one of them out"),
        ("watch --goal 9,9", "9,9", "--goal 4,4"),
        ("watch --goal-radius 0", "got 0;", "--goal-radius 2"),
        ("watch --goal-radius nan", "nan", "--goal-radius 2"),
        ("watch --goal-radius 1000", "1000", "--goal-radius 2"),
        ("test strombom --world flocks.py", "'flocks.py'", "FILE.py:NAME"),
        ("test strombom --world none.py:world", "none.py", "check the path"),
        ("train --world none.py:world", "none.py", "check the path"),
        ("watch --world none.py:world", "none.py", "check the path"),
        ("test strombom --world a.py:b --preset paper-w05", "a.py:b", "leave one of them out"),
        ("train --world a.py:b --preset paper-w05", "a.py:b", "leave one of them out"),
        ("watch --world a.py:b --preset paper-w05", "a.py:b", "leave one of them out"),
    ],
)
def test_a_wrong_value_is_refused_in_one_line_with_its_remedy(refused, arguments, value, remedy):
    message = refused(*arguments.split())
    assert value in message
    assert remedy in message


@pytest.mark.parametrize("command", ["herd", "train"])
def test_a_folder_that_cannot_be_made_is_refused(refused, tmp_path, command):
    (tmp_path / "file").write_text("in the way")
    assert "file/run" in refused(command, "--out", "file/run", "--steps", "10")


def test_results_that_cannot_be_written_are_refused(refused, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert "file/out" in refused("test", "strombom", "--cases", "1", "--out", "file/out")


def test_a_damaged_sheepdog_is_refused(refused, a_sheepdog):
    a_sheepdog.write_bytes(a_sheepdog.read_bytes()[:-9])
    assert "damaged" in refused("test", str(a_sheepdog))


def test_a_sheepdog_that_observes_other_numbers_is_refused(refused, a_sheepdog):
    arrays, card = load_arrays(a_sheepdog, "sheepdog")
    save_arrays(a_sheepdog, arrays, {**card, "observes": ["a", "b", "c", "d", "e", "f"]})
    message = refused("test", str(a_sheepdog.parent))
    assert "observes 6 numbers, this mission has 4" in message
    assert "train it again" in message


def test_what_is_no_trace_is_not_replayed(refused, a_sheepdog):
    assert "no trace" in refused("replay", str(a_sheepdog))


def test_a_replay_of_nothing_is_refused(refused):
    assert "needs a trace" in refused("replay")


@pytest.mark.parametrize("name", ["x.xyz", "x"])
def test_a_replay_of_an_unknown_kind_is_refused(refused, a_trace, name):
    assert "x.html, x.gif or x.mp4" in refused("replay", str(a_trace), "-o", name)


def test_an_export_writes_a_file_that_another_runtime_flies(skydog, tmp_path, monkeypatch):
    onnxruntime = pytest.importorskip("onnxruntime")
    monkeypatch.chdir(tmp_path)
    code, out, _ = skydog("export", "h-ddpg-4x4", "--onnx")
    assert (code, out) == (0, "h-ddpg-4x4.onnx\n")
    dog = onnxruntime.InferenceSession(tmp_path / "h-ddpg-4x4.onnx")
    assert [told.name for told in dog.get_inputs()] == ["sheep", "dog"]


def test_an_export_of_a_run_is_called_as_its_folder(skydog, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rex").mkdir()
    shutil.copy(store.find(Path("h-ddpg-4x4")), tmp_path / "rex" / store.FILE)
    assert skydog("export", "rex", "--onnx")[:2] == (0, "rex.onnx\n")


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (["export", "h-ddpg-4x4"], "--onnx"),
        (["export", "nobody", "--onnx"], "h-ddpg-4x4"),
        (["export", "h-ddpg-4x4", "--onnx", "--arena", "1"], "longer than 2 m"),
        (["watch", "nobody"], "h-ddpg-4x4"),
        (["watch", "--sheep", "201"], "1 to 200"),
        (["watch", "--dogs", "99"], "1 to 8"),
        (["watch", "--port", "99999"], "port"),
        (["watch", "--host", "no.such.host.invalid"], "127.0.0.1"),
        (["watch", "--preset", "nowhere"], "paper"),
    ],
)
def test_what_cannot_be_exported_or_watched_is_refused_with_the_remedy(refused, arguments, remedy):
    assert remedy in refused(*arguments)


@pytest.mark.parametrize("skill", ["collect", "drive"])
@pytest.mark.parametrize("command", ["train", "herd"])
def test_a_training_is_not_overwritten_without_being_asked(
    refused, monkeypatch, tmp_path, command, skill
):
    def overwrites(*_):
        raise AssertionError("a training would be overwritten")

    monkeypatch.setattr(training, "train_all", overwrites)
    files.write_bytes(train.checkpoint_in(tmp_path / "runs" / skill), b"much learnt")
    assert "--resume" in refused(command, "--out", "runs")


def test_tensorboard_that_is_missing_is_refused_with_the_line_to_type(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    message = refused("train", "--tensorboard", "--steps", "10")
    assert "pip install 'skydog[tensorboard]'" in message


@pytest.mark.parametrize("option", ["--seeds", "--episodes"])
def test_a_study_of_nothing_is_refused(refused, option):
    assert option in refused("reproduce", option, "0", "--out", "study")


# What is printed


@pytest.mark.parametrize("who", ["dog", "dog/sheepdog.safetensors", "strombom"])
def test_a_test_as_json_is_one_row(skydog, a_sheepdog, who):
    code, out, _ = skydog("test", who, "--cases", "2", "--json")
    assert code == 0
    row = json.loads(out)
    assert row.keys() >= {"success", "cases", "steps", "steps_gcm", "distance", "error_per_step"}
    assert row["cases"] == 2
    assert row["steps"].keys() == {"mean", "sd", "ci95"}


def test_a_test_writes_its_results_and_a_trace_per_mission(skydog, tmp_path):
    code, out, _ = skydog("test", "strombom", "--cases", "2", "--out", "kept", "--json")
    assert code == 0
    results = json.loads((tmp_path / "kept" / "results.json").read_text())
    assert results == {"Strombom-4x4": json.loads(out)}
    for case in (1, 2):
        trace, shepherd = traces.load(tmp_path / f"kept/traces/Strombom-4x4-{case}.safetensors")
        assert shepherd == "Strombom-4x4"
        assert trace.sheep.shape[1:] == (3, 2)


def test_a_mission_may_take_longer_than_a_thousand_steps_and_record_some_of_them(skydog, tmp_path):
    options = ["--arena", "30", "--cases", "2", "--json"]
    short = json.loads(skydog("test", "strombom", *options)[1])
    assert short["success"] == 0.0
    assert short["steps"]["mean"] == 1000
    _, out, _ = skydog(
        "test", "strombom", *options, "--steps", "4000", "--out", "far", "--every", "50"
    )
    whole = json.loads(out)
    assert whole["success"] == 1.0
    assert 1000 < whole["steps"]["mean"] < 4000
    trace, _ = traces.load(tmp_path / "far/traces/Strombom-30x30-1.safetensors")
    assert len(trace.time) > 1000
    assert len(trace.sheep) < 0.03 * len(trace.time)
    # The figures are those of the whole mission, however much of it was kept.
    assert json.loads(skydog("test", "strombom", *options, "--steps", "4000")[1]) == whole
    code, _, err = skydog("replay", "far/traces/Strombom-30x30-1.safetensors", "-o", "far.html")
    assert (code, err) == (0, "")
    page = (tmp_path / "far.html").read_text()
    assert '"step":[0,50,100,' in page


@pytest.mark.parametrize(("name", "begins"), [("x.html", b"<!"), ("x.gif", b"GIF89a")])
def test_a_mission_is_replayed_as_a_page_or_a_moving_picture(skydog, a_trace, name, begins):
    code, out, _ = skydog("replay", str(a_trace), "-o", name)
    assert (code, out.strip()) == (0, name)
    assert Path(name).read_bytes().lower().startswith(begins.lower())


def test_missions_of_the_same_name_are_all_replayed(skydog, a_trace, tmp_path):
    other = tmp_path / "other" / a_trace.name
    files.write_bytes(other, a_trace.read_bytes())
    assert skydog("replay", str(a_trace), str(other), "-o", "two.html")[0] == 0
    assert Path("two.html").read_text().count('"ending":') == 2


def test_presets_are_listed_with_their_values(skydog):
    code, out, _ = skydog("presets", "--json")
    assert code == 0
    listed = json.loads(out)
    assert listed["paper"]["flock.sensing"] == 2.0
    names = {name for values in listed.values() for name in values if name.startswith("flock.")}
    assert skydog("presets")[1].count("flock.") == len(names)


# Sheepdogs and worlds of one's own


OWN = """
from dataclasses import replace
import jax.numpy as jnp
import skydog

def nine(arena=8.0, sheep=9):
    world = skydog.preset("paper", arena, sheep)
    return replace(world, sheep=replace(world.sheep, speed=jnp.full(sheep, 0.5)))

fixed = nine()
"""


@pytest.mark.parametrize("name", ["nine", "fixed"])
def test_a_world_of_ones_own_is_flown_with_its_own_sheep(skydog, tmp_path, name):
    (tmp_path / "own.py").write_text(OWN)
    arguments = ["--world", f"own.py:{name}", "--starts", "random", "--cases", "2", "--json"]
    assert skydog("test", "strombom", *arguments)[0] == 0
    code, _, err = skydog("test", "strombom", *arguments, "--sheep", "4")
    assert code == (2 if name == "fixed" else 0)
    assert ("--sheep 9" in err) == (name == "fixed")


def test_a_sheepdog_of_another_world_says_where_it_was_trained(skydog, tmp_path):
    actor = Actor(4, 2, (6,), jax.random.key(0))
    card = {"own_world": "hills.py:world"}
    store.save(tmp_path / "dog" / store.FILE, Sheepdog(actor, actor, 4.0), card)
    _, _, err = skydog("test", "dog", "--cases", "1", "--json")
    assert "--world hills.py:world" in err
    _, _, err = skydog("export", "dog", "--onnx")
    assert "trained in hills.py:world" in err


def test_the_table_of_a_world_that_is_not_the_papers_has_no_column_for_it(skydog):
    assert "the paper's own" in skydog("test", "strombom", "--cases", "2")[1]
    other = ["--preset", "paper-literal", "--cases", "2"]
    assert "paper's own" not in skydog("test", "strombom", *other)[1]


@pytest.mark.parametrize(
    "command", ["test nobody", "replay no.safetensors", "test strombom --preset no"]
)
def test_a_name_that_there_is_not_is_refused_before_jax_is_imported(command):
    code = (
        "import sys; from skydog import cli; sys.argv = ['skydog', *sys.argv[1:]]\n"
        "try: cli.main()\n"
        "except SystemExit as left: print(left.code, 'jax' in sys.modules)\n"
    )
    called = [sys.executable, "-c", code, *command.split()]
    done = subprocess.run(called, capture_output=True, text=True)
    assert done.stdout == "2 False\n"
