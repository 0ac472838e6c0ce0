"""`skydog twin` and `skydog reproduce --physical`."""

import json

import jax
import numpy as np
import pytest

from skydog import files
from skydog.commands import physical as command
from skydog.commands import training
from skydog.errors import Refusal
from skydog.learning import train
from skydog.shepherds import store
from skydog.shepherds.networks import Actor
from skydog.shepherds.sheepdog import Sheepdog
from skydog.study import paper, physical, statistics
from skydog.study.physical import Setting
from skydog.twin import film
from skydog.world import trace as traces
from skydog.world.presets import at_speed, preset

pytestmark = pytest.mark.usefixtures("unchecked")

SHORT = ("--cases", "2", "--steps", "6", "--threads", "1")


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 99)


def test_twin_prints_the_keys_that_test_prints(skydog):
    code, out, _ = skydog("twin", "h-ddpg-6x6", *SHORT, "--json")
    assert code == 0
    _, plain, _ = skydog("test", "h-ddpg-6x6", "--cases", "2", "--steps", "6", "--json")
    found = json.loads(out)
    assert found.keys() == json.loads(plain).keys()
    assert found["success"] == 0.0
    assert found["steps"]["mean"] == 6


def test_twin_prints_every_metric_and_how_missions_ended(skydog):
    code, out, err = skydog("twin", "strombom", *SHORT, "--profile", "ardrone2")
    assert code == 0
    for title in ("success", "distance (m)", "error a step (m)", "turn a step"):
        assert title in out
    assert "2 of 2 missions ended 'out of time'" in " ".join(err.split())


def test_twin_writes_missions_that_replay_shows(skydog, tmp_path):
    code, *_ = skydog("twin", "h-ddpg-4x4", *SHORT, "--disturb", "mild", "--out", str(tmp_path))
    assert code == 0
    files = sorted((tmp_path / "traces").iterdir())
    assert len(files) == 2
    trace, name = traces.load(files[0])
    assert name == "H-DDPG-4x4to6x6-tum-simulator"
    assert trace.poses is not None
    assert np.all(np.abs(trace.poses.altitude - 2.0) < 0.3)
    page = tmp_path / "page.html"
    code, *_ = skydog("replay", str(files[0]), "-o", str(page))
    assert code == 0
    assert "altitude" in page.read_text()


def test_twin_writes_a_film(skydog, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "save", lambda path, *_, **__: path.write_bytes(b"film"))
    where = tmp_path / "flight.mp4"
    code, *_ = skydog("twin", "strombom", *SHORT, "--video", str(where))
    assert code == 0
    assert where.read_bytes() == b"film"


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--profile", "boeing"), "no uav profile is called 'boeing'"),
        (("--rovers", "tank"), "no rover profile is called 'tank'"),
        (("--disturb", "storm"), "no disturbances are called 'storm'"),
        (("--speed", "0"), "from 0.001 to 1, got 0"),
        (("--speed", "nan"), "from 0.001 to 1, got 'nan'"),
        (("--wait", "-1"), "the distance to wait for is from 0.001 to 1,000 m, got -1"),
        (("--cases", "0"), "a test has 1 to 1,000,000 cases, got 0"),
        (("--steps", "0"), "a flight has 1 to 100,000 steps, got 0"),
        (("--video", "film.gif"), "a film is written as MP4, got film.gif"),
        (("--threads", "-1"), "got -1"),
        (("--arena", "8", "--sheep", "40"), "do not find room to start"),
        (("--preset", "paper", "--world", "some.py:world"), "there is no file some.py"),
        (("--preset", "strombom2014", "--world", "some.py:world"), "are two worlds"),
    ],
)
def test_twin_refuses_in_one_line(skydog, flags, said):
    code, out, err = skydog("twin", "strombom", *SHORT, *flags)
    assert code == 2
    assert out == ""
    assert said in " ".join(err.split())


def test_twin_refuses_a_scene_whose_dogs_are_on_the_ground(refused, tmp_path):
    numbers = "size = [6, 4]\nstart = [4, 1, 5.5, 3]\ngoal = [1, 2]\ngoal_radius = 1.0\n"
    walls = "walls = [[[3, 0], [3, 2]]]\n"
    (tmp_path / "pen.toml").write_text(f"{numbers}{walls}dogs = 'around'\n")
    said = refused("twin", "strombom", "--scene", "pen.toml", *SHORT)
    assert "dogs on the ground; change its file to dogs = 'above'" in said


def test_at_a_share_of_the_speed_dogs_and_sheep_are_slower():
    world = at_speed(preset("paper-physical"), 0.5)
    assert (world.dog.speed, world.sheep.speed, world.arena.dt) == (0.5, 0.25, 0.2)
    with pytest.raises(Refusal, match="to 1, got 2"):
        at_speed(world, 2.0)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The physical study, of very short missions: its folder, and how to go on."""
    out = tmp_path_factory.mktemp("physical")
    with pytest.MonkeyPatch.context() as patch:
        few = {
            "SPEEDS": {"a sixth": 1 / 6},
            "UNTAUGHT": physical.UNTAUGHT[:1],
            "TAUGHT": physical.TAUGHT[:1],
            "CASES": 1,
            "GAP_CASES": 2,
            "LAB_CASES": 2,
            "MAX_STEPS": 4,
            "CAUSES": {"kinematic": Setting(None), "both: tum-simulator": Setting()},
            "FOR_ALL": ("kinematic",),
            "AT_A_SIXTH": ("kinematic",),
        }
        for name, value in few.items():
            patch.setattr(physical, name, value)
        patch.setattr(statistics, "RESAMPLES", 99)
        yield out, lambda: command.run(out, 1, 1, True, "skydog reproduce --physical --from-zoo")


def test_the_physical_study_stands_beside_the_papers_and_continues_where_it_was(study):
    out, run = study
    results = run()
    assert {f"{row}, a sixth" for row in paper.PHYSICAL} < results.keys()
    for dog in (*physical.UNTAUGHT, *physical.TAUGHT):
        assert f"{dog}: kinematic, full" in results
    assert results[f"{physical.UNTAUGHT[0]}: lab"]["cases"] == 2
    for name in ("results.json", "report.html", "physical.md"):
        assert (out / name).stat().st_size > 1000
    told = (out / "physical.md").read_text()
    assert "911 ± 93" in told
    assert "What physics costs" in told
    kept = {path: path.stat().st_mtime_ns for path in (out / "lines").iterdir()}
    (gone, *_) = kept
    gone.unlink()
    again = run()
    assert again == results
    assert {path for path in kept if path.stat().st_mtime_ns != kept[path]} == {gone}


def test_of_several_seeds_taught_the_fastest_in_the_twin_ships(tmp_path, monkeypatch):
    actors = [Actor(4, 2, (6,), jax.random.key(seed)) for seed in range(3)]
    dogs = [Sheepdog(actor, actor, 4.0) for actor in actors]
    needed = {id(dog): steps for dog, steps in zip(dogs, (7.0, 5.0, 6.0), strict=True)}

    def train_all(jobs, on):
        for job in jobs:
            files.write_text(train.checkpoint_in(job.folder), job.name)
        return True

    monkeypatch.setattr(training, "train_all", train_all)
    monkeypatch.setattr(training, "check", lambda out, todo: None)
    monkeypatch.setattr(training, "fuse", lambda kind, folder, seed: (dogs[seed], {}))
    flown = {"success": 1.0}
    monkeypatch.setattr(
        physical, "fly", lambda line, dog, *_: ({**flown, "steps": {"mean": needed[id(dog)]}}, None)
    )
    monkeypatch.setattr(command, "SIZES", (4.0,))
    assert command._teach(tmp_path, 3, 4, "skydog reproduce --physical")
    _, card = store.read(tmp_path / "zoo" / "h-ddpg-4x4-physical.safetensors")
    assert (card["name"], card["seed"]) == ("H-DDPG-4x4-physical", 1)
    assert card["results"]["H-DDPG-4x4-physical in the twin steps"] == 5.0
    monkeypatch.setattr(physical, "fly", None)  # called again, nothing is flown
    assert command._teach(tmp_path, 3, 4, "skydog reproduce --physical")


def test_teaching_that_was_stopped_flies_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "train_all", lambda _, on: False)
    assert command.run(tmp_path, 1, 4, False, "skydog reproduce --physical") is None
    assert not (tmp_path / "zoo").exists()
