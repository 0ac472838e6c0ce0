"""A law of one's own is flown wherever a preset's is."""

import json
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import skydog.envs as skydog_envs
from loaded import EXAMPLES, example
from skydog import cli, references
from skydog.learning import workers
from skydog.learning.curriculum import Curriculum
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import metrics
from skydog.view import live
from skydog.view import session as sessions
from skydog.world import presets, trace

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
    references.run.cache_clear()


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


@pytest.mark.parametrize(("file", "sheep"), [("mixed_flock", 10), ("own_end", 10)])
def test_the_command_flies_the_other_worlds_too(skydog, file, sheep):
    own = f"{EXAMPLES / file}.py:world"
    options = ["--sheep", str(sheep), "--starts", "random", "--cases", "3", "--json"]
    assert json.loads(skydog("test", "strombom", "--world", own, *options))["success"] == 1.0
