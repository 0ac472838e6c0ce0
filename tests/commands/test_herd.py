"""The main job from end to end, small: one run for all tests of this file."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import pytest

from skydog.commands import training
from skydog.errors import Refusal
from skydog.learning import train, workers
from skydog.learning.curriculum import Curriculum
from skydog.learning.options import Skill

CURRICULUM = Curriculum(steps=2_000)
SKYDOG = [sys.executable, "-m", "skydog.cli"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run folder, and what the command printed."""
    out = tmp_path_factory.mktemp("run") / "herd"
    command = [*SKYDOG, "herd", "--steps", "2000", "--cases", "3", "--json", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return out, json.loads(done.stdout)


def test_the_results_of_both_shepherds_are_printed_and_written(run):
    out, printed = run
    assert json.loads((out / "results.json").read_text()) == printed
    assert {"H-DDPG-4x4", "Strombom-4x4"} <= printed.keys()
    for row in printed.values():
        assert 0.0 <= row["success"] <= 1.0
        assert row["cases"] == 3
        for figure in ("steps", "steps_gcm", "distance"):
            low, high = row[figure]["ci95"]
            assert low <= row[figure]["mean"] <= high
            assert row[figure]["sd"] >= 0.0


def test_a_run_folder_holds_everything(run):
    out, printed = run
    found = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert found == {
        "sheepdog.safetensors",
        "sheepdog.md",
        "learning_curves.png",
        "learning_curves.svg",
        "trajectories.png",
        "trajectories.svg",
        "report.html",
        "results.json",
        "results.md",
        *(f"{s}/{f}" for s in training.SKILLS for f in ("checkpoint.safetensors", "curve.csv")),
        *(f"traces/{name}.safetensors" for name in printed),
    }


@pytest.mark.parametrize("skill", training.SKILLS)
def test_a_worker_teaches_what_is_taught_in_process_with_its_seed(run, skill):
    out, _ = run
    task = CURRICULUM.lesson(skill)
    seed = 1 if skill == "drive" else 0
    here, _ = train.train(task, CURRICULUM.config(), seed, CURRICULUM.steps)
    sheepdog, histories = training.fuse(CURRICULUM, out, 0)
    assert len(histories[skill].length) == 40
    for mine, theirs in zip(
        jax.tree.leaves(here.agent.skill), jax.tree.leaves(getattr(sheepdog, skill)), strict=True
    ):
        assert (mine == theirs).all()


def test_a_sheepdog_that_was_written_is_flown_again_to_the_same_figures(run):
    out, printed = run
    done = subprocess.run(
        [*SKYDOG, "test", str(out), "--cases", "3", "--json"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    again, first = json.loads(done.stdout), printed["H-DDPG-4x4"]
    assert again.keys() == first.keys()
    # To rounding: `test` records the sheep at the start and at the end alone.
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(first), strict=True):
        assert one == pytest.approx(other, rel=1e-5, abs=1e-6)


# Workers


def a_job(folder: Path, skill: Skill = "drive", **options) -> workers.Job:
    return workers.Job(Curriculum(steps=2_000, **options), skill, 0, folder / skill)


def test_both_trainings_report_and_finish(tmp_path):
    jobs = [a_job(tmp_path, skill) for skill in training.SKILLS]
    messages = []
    assert workers.run(jobs, messages.append)
    for job in jobs:
        steps = [m.progress.step for m in messages if m.job == job and m.progress]
        assert steps == [1_000, 2_000]
        assert [m.ended for m in messages if m.job == job and m.ended] == ["done"]


def test_a_job_that_is_refused_is_refused_here_too(tmp_path):
    with pytest.raises(Refusal, match="arena must be longer"):
        workers.run([a_job(tmp_path, arena=-1.0)], lambda _: None)


def test_a_listener_that_fails_ends_the_workers_too(tmp_path):
    code = (
        "from pathlib import Path; from skydog.learning import curriculum, workers\n"
        "def fails(message): raise OSError('disk full')\n"
        "if __name__ == '__main__':\n"
        "    job = workers.Job(curriculum.Curriculum(steps=10**9), 'drive', 0, Path('drive'))\n"
        "    workers.run([job], fails)\n"
    )
    (tmp_path / "main.py").write_text(code)
    assert_ends([sys.executable, "main.py"], tmp_path, within=40)


def assert_ends(command, folder, within):
    process = subprocess.Popen(
        command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        assert "disk full" in process.communicate(timeout=within)[1]
        assert process.returncode == 1
    finally:
        end_group(process)


def end_group(process):
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def interrupted(out: Path, *options: str) -> tuple[int, str]:
    """Start a long training, let it come past its first chunks, press Ctrl-C."""
    command = [*SKYDOG, "train", "--steps", "10000000", "--out", str(out), *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    checkpoint = train.checkpoint_in(out / "collect")
    before = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
    try:
        until = time.monotonic() + 120
        while not checkpoint.exists() or checkpoint.stat().st_mtime_ns == before:
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        _, told = process.communicate(timeout=60)
        return process.returncode, told
    finally:
        end_group(process)


def steps_done(out: Path) -> list[int]:
    done = []
    for job in training.jobs(CURRICULUM, out, 0, resume=True):
        if not train.checkpoint_in(job.folder).exists():
            continue  # one core: it waits for the other
        blank = train.init(CURRICULUM.lesson(job.skill), CURRICULUM.config(), jax.random.key(0))
        done.append(int(train.load(job.folder, blank, job.card)[0].step))
    return done


def test_ctrl_c_keeps_what_was_learnt_and_resuming_goes_on_from_there(tmp_path):
    out = tmp_path / "a [long] name of a folder"
    code, told = interrupted(out)
    assert code == 130
    assert "Traceback" not in told
    # Whole, in one line, so that it can be copied.
    assert f"skydog train --steps 10000000 --out '{out}' --resume\n" in told
    first = steps_done(out)
    assert min(first) >= 1_000
    code, told = interrupted(out, "--resume")
    assert code == 130
    assert told.count("--resume") == 1
    second = steps_done(out)
    assert all(later > earlier for earlier, later in zip(first, second, strict=True))
