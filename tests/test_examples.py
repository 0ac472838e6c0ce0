"""Each example runs, is short, and shows what it says."""

import json
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import skydog.envs as skydog_envs
from skydog import cli
from skydog.learning import workers
from skydog.learning.curriculum import Curriculum
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.view import live
from skydog.view import session as sessions
from skydog.world import loading, presets, trace

EXAMPLES = Path(__file__).parents[1] / "examples"


def example(name):
    spec = spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_shorter_than_60_lines(path):
    assert len(path.read_text().splitlines()) < 60


def test_a_flock_that_does_not_group_is_hard_for_every_shepherd(capsys):
    rows = example("own_sheep").main(count=60)
    cohesive, loose = rows.values()
    for shepherd in ("strombom", "h-ddpg-4x4"):
        assert cohesive[shepherd]["success_ci95"][0] > 0.9
        assert loose[shepherd]["success_ci95"][1] < cohesive[shepherd]["success_ci95"][0]
    # The sheepdog learnt from flocks that group, and leans on it more than the rule does.
    assert loose["h-ddpg-4x4"]["success_ci95"][1] < loose["strombom"]["success_ci95"][0]
    assert capsys.readouterr().out.count("h-ddpg-4x4") == 2


def test_a_dog_that_goes_round_the_flock_needs_fewer_steps_than_one_that_cuts_through(capsys):
    rows = example("own_dog").main(count=200)
    assert rows["circler"]["success_ci95"][0] > 0.95
    assert rows["circler"]["steps less strombom's"]["ci95"][1] < 0.0
    assert "circler less strombom" in capsys.readouterr().out


def test_a_third_lesson_is_learnt_in_seconds(capsys):
    untaught, taught = example("own_lesson").main(steps=10_000)
    assert abs(untaught) < 0.5
    assert taught > 3.0
    assert "taught 10000 steps" in capsys.readouterr().out


# A law of one's own, everywhere that a preset's is


LAW = EXAMPLES / "own_law.py"


@pytest.fixture
def skydog(monkeypatch, capsys, tmp_path):
    """The command, run in this process and in an empty folder: its output."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["skydog", *arguments])
        with pytest.raises(SystemExit) as left:
            cli.main()
        out = capsys.readouterr()
        assert not left.value.code, out.err
        return out.out

    yield run
    loading._run.cache_clear()


def test_a_law_of_ones_own_is_under_40_lines_and_a_shepherd_herds_its_sheep(capsys):
    text = LAW.read_text()
    law = text[text.index("class Calm") : text.index("def world")]
    assert len(law.splitlines()) < 40
    rows = example("own_law").main(count=40)
    assert rows["h-ddpg"]["success_ci95"][0] > 0.9
    assert rows["strombom"]["success_ci95"][1] < rows["h-ddpg"]["success_ci95"][1]
    assert capsys.readouterr().out.count("steps") == 2


def test_the_command_flies_a_law_of_ones_own_and_its_traces_are_replayed(skydog, tmp_path):
    out = skydog(
        "test", "h-ddpg-4x4", "--world", f"{LAW}:world", "--cases", "3", "--out", "own", "--json"
    )
    assert json.loads(out)["success"] == 1.0
    path = tmp_path / "own" / "traces" / "H-DDPG-4x4-own_law-1.safetensors"
    flown, _ = trace.load(path)
    assert metrics.success(flown)
    moved = np.linalg.norm(np.diff(flown.sheep, axis=0), axis=-1)
    assert 0.0 < np.median(moved[moved > 1e-4]) < 0.9 * 0.05  # these sheep have many speeds
    for name, start in (("own.html", b"<!"), ("own.gif", b"GIF89a")):
        skydog("replay", str(path), "-o", name)
        assert (tmp_path / name).read_bytes().lower().startswith(start.lower())


def test_the_command_trains_on_a_law_of_ones_own_and_flies_what_it_taught(skydog, tmp_path):
    own = f"{LAW}:world"
    skydog("train", "--world", own, "--arena", "5", "--steps", "2000", "--out", "own", "--json")
    sheepdog, card = store.read(tmp_path / "own")
    assert float(sheepdog.arena) == 5.0
    assert card["name"] == "H-DDPG-5x5-own_law"
    assert (card["preset"], card["own_world"]) == (None, own)
    assert card["world"]["flock.law"] == "own: skydog_world_own_law.Calm"
    lesson = Curriculum(arena=5.0, steps=2000, own_world=own).lesson("drive")
    assert type(lesson.world.flock).__name__ == "Calm"
    assert json.loads(skydog("test", "own", "--world", own, "--cases", "2", "--json"))["cases"] == 2


def test_a_law_of_ones_own_is_resumed_as_long_as_its_file_is_the_same(skydog, tmp_path):
    file = tmp_path / "law.py"
    file.write_text(LAW.read_text())
    own = Curriculum(steps=2000, own_world=f"{file}:world")
    card = workers.Job(own, "drive", 0, tmp_path).card
    assert card == workers.Job(own, "drive", 0, tmp_path).card
    file.write_text(LAW.read_text() + "\n")
    assert workers.Job(own, "drive", 0, tmp_path).card != card


def test_environments_and_the_live_view_have_a_law_of_ones_own():
    world = example("own_law").world()
    calm = world.flock
    env = gymnasium.make("skydog/Herd-v0", world=world)
    check_env(env.unwrapped, skip_render_check=True)
    envs = gymnasium.make_vec("skydog/Drive-v0", num_envs=3, world=world)
    seen, _ = envs.reset(seed=0)
    assert seen.shape == (3, 4)
    dogs = skydog_envs.herd_parallel_v0(dogs=2, world=world)
    dogs.reset(seed=1)
    dogs.step({name: np.ones(2, np.float32) for name in dogs.agents})

    worlds = {"own_law": example("own_law").world, **presets.PRESETS}
    begin = live.opening({"strombom": Strombom()}, "strombom", "own_law", worlds=worlds)
    session = sessions.advance(sessions.new(begin, worlds), {"strombom": Strombom()}, 5)
    assert type(session.world.flock).__name__ == type(calm).__name__
    shown = sessions.view(session)
    assert shown["world"]["sensing"] == 2.0
    assert shown["flights"][0]["step"] == 5
    # Messages of the page go on as in a preset's world, noise of the sheep included.
    session = sessions.update(session, {"noise": 0.5, "sheep": 5, "arena": 6.0})
    session = sessions.advance(session, {"strombom": Strombom()}, 3)
    assert len(sessions.view(session)["flights"][0]["sheep"]) == 5
    session = sessions.update(session, {"preset": "paper"})
    assert sessions.view(sessions.advance(session, {"strombom": Strombom()}, 1))["world"]["size"]


def test_a_mixed_flock_takes_longer_the_slower_its_sheep(capsys):
    rows = list(example("mixed_flock").main(count=60).values())
    assert all(row["success_ci95"][0] > 0.9 for row in rows)
    alike, slow, bold = (row["steps"]["ci95"] for row in rows)
    assert alike[1] < slow[0]
    assert alike[1] < bold[0]
    assert capsys.readouterr().out.count("steps") == 3


def test_a_mission_of_which_most_must_be_home_ends_before_one_of_all(capsys):
    rows = example("own_end").main(count=60)
    assert rows["most"]["steps"]["ci95"][1] < rows["all"]["steps"]["ci95"][0]
    assert "most home" in capsys.readouterr().out


@pytest.mark.parametrize(("file", "sheep"), [("mixed_flock", 10), ("own_end", 10)])
def test_the_command_flies_the_other_worlds_too(skydog, file, sheep):
    own = f"{EXAMPLES / file}.py:world"
    options = ["--sheep", str(sheep), "--starts", "random", "--cases", "3", "--json"]
    assert json.loads(skydog("test", "strombom", "--world", own, *options))["success"] == 1.0
