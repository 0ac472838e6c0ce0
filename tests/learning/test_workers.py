"""Trainings in processes of their own: how they end, whatever ends them."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import jax
import pytest

from skydog import files
from skydog.commands import training
from skydog.errors import Refusal
from skydog.learning import train, workers
from skydog.learning.curriculum import Curriculum
from skydog.learning.options import Skill

SKYDOG = [sys.executable, "-m", "skydog.cli"]
HANGS = 600  # seconds that nothing takes which has not hung, on the slowest machine
ENDLESS = 10_000_000  # steps
PARENT = f"""
import sys
from pathlib import Path
from skydog.learning import workers
from skydog.learning.curriculum import Curriculum
def fails(message): raise OSError("disk full")
if __name__ == "__main__":
    folder = Path(sys.argv[1])
    jobs = [
        workers.Job(Curriculum(steps={ENDLESS}), skill, 0, folder / skill)
        for skill in ("collect", "drive")
    ]
    workers.run(jobs, fails if "fails" in sys.argv else lambda _: None)
"""


def a_job(folder: Path, skill: Skill = "drive", **options) -> workers.Job:
    return workers.Job(Curriculum(steps=2_000, **options), skill, 0, folder / skill)


def wait_for(event):
    until = time.monotonic() + HANGS
    while not event():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.fixture
def start(tmp_path):
    """Starts processes, each with its workers a group of its own, and leaves none behind."""
    begun = []

    def start(*command):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        begun.append(subprocess.Popen(command, start_new_session=True, cwd=tmp_path, **pipes))
        return begun[-1]

    yield start
    for process in begun:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture
def parent(start, tmp_path):
    """Starts a process with a worker for each core, at most two."""
    (tmp_path / "parent.py").write_text(PARENT)
    return lambda *options: start(sys.executable, "parent.py", str(tmp_path), *options)


def group(leader: int) -> list[int]:
    """The processes of a group that have not ended."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, in_group = entry.read_text().rpartition(")")[2].split()[:3]
            if int(in_group) == leader and state != "Z":
                found.append(int(entry.parent.name))
    return found


def trains(process: int) -> bool:
    """Whether a process is a worker, and not its parent or a tracker of resources."""
    with suppress(OSError):
        return b"spawn_main" in Path(f"/proc/{process}/cmdline").read_bytes()
    return False


def test_both_trainings_report_and_finish(tmp_path):
    jobs = [a_job(tmp_path, skill) for skill in ("collect", "drive")]
    messages = []
    assert workers.run(jobs, messages.append)
    for job in jobs:
        steps = [m.progress.step for m in messages if m.job == job and m.progress]
        assert steps == [1_000, 2_000]
        assert [m.ended for m in messages if m.job == job and m.ended] == ["done"]


def test_a_thread_trains_too_and_leaves_the_signals_alone(tmp_path):
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    ended = []
    thread = threading.Thread(
        target=lambda: ended.append(workers.run([a_job(tmp_path)], lambda _: None))
    )
    thread.start()
    thread.join(HANGS)
    assert ended == [True]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


def test_a_job_that_is_refused_is_refused_here_too(tmp_path):
    with pytest.raises(Refusal, match="the arena's side"):
        workers.run([a_job(tmp_path, arena=-1.0)], lambda _: None)


def test_a_training_in_a_folder_where_another_trains_is_refused(tmp_path, monkeypatch):
    job = a_job(tmp_path)
    monkeypatch.setattr(workers, "PATIENCE", 0.0)
    with files.claimed(job.folder):
        ours, theirs = workers.mp.Pipe()
        with ours, theirs:
            message = workers._trained(job, theirs)
    assert message.refused
    assert "another run is at work" in str(message.ended)


def test_a_listener_that_fails_ends_the_workers_too(parent):
    process = parent("fails")
    assert "disk full" in process.communicate(timeout=HANGS)[1]
    assert process.returncode == 1
    wait_for(lambda: not group(process.pid))


@pytest.mark.parametrize("moment", ["workers exist", "workers train"])
def test_no_worker_outlives_a_parent_that_is_killed(parent, tmp_path, moment):
    process = parent()
    count = min(2, len(os.sched_getaffinity(0)))
    wait_for(lambda: sum(map(trains, group(process.pid))) == count)
    if moment == "workers train":
        wait_for(lambda: any(tmp_path.glob("*/checkpoint.safetensors")))
    process.kill()
    wait_for(lambda: not group(process.pid))
    folders = [path.parent for path in tmp_path.glob("*/checkpoint.safetensors")]
    assert folders or moment == "workers exist"
    for folder in folders:
        assert not [entry.name for entry in folder.iterdir() if entry.name.startswith(".")]


def test_ctrl_c_again_and_again_says_no_more_than_once_does(start, tmp_path):
    out = tmp_path / "run"
    process = start(*SKYDOG, "train", "--steps", str(ENDLESS), "--out", str(out))
    wait_for(lambda: sum(map(trains, group(process.pid))) > 0)
    # Until it has ended: two that come at the same moment are one.
    while process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.01)
    told = process.communicate(timeout=HANGS)[1]
    assert process.returncode == 130
    assert "leaked" not in told
    assert "Traceback" not in told
    wait_for(lambda: not group(process.pid))


def steps_done(out: Path) -> list[int]:
    curriculum, done = Curriculum(steps=ENDLESS), []
    for job in training.jobs(curriculum, out, 0, resume=True):
        if not train.checkpoint_in(job.folder).exists():
            continue  # one core: it waits for the other
        blank = train.init(curriculum.lesson(job.skill), curriculum.config(), jax.random.key(0))
        done.append(int(train.load(job.folder, blank, job.card)[0].step))
    return done


def test_ctrl_c_keeps_what_was_learnt_and_resuming_goes_on_from_there(start, tmp_path):
    out = tmp_path / "a [long] name of a folder"

    def interrupted(*options: str) -> tuple[int, str]:
        """Start a long training, let it come past its first chunks, press Ctrl-C."""
        command = [*SKYDOG, "train", "--steps", str(ENDLESS), "--out", str(out), *options]
        checkpoint = train.checkpoint_in(out / "collect")
        before = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
        process = start(*command)
        wait_for(lambda: checkpoint.exists() and checkpoint.stat().st_mtime_ns != before)
        assert process.poll() is None
        os.killpg(process.pid, signal.SIGINT)
        told = process.communicate(timeout=HANGS)[1]
        return process.returncode, told

    code, told = interrupted()
    assert code == 130
    assert "Traceback" not in told
    # Whole, in one line, so that it can be copied.
    assert f"skydog train --steps {ENDLESS} --out '{out}' --resume\n" in told
    first = steps_done(out)
    assert min(first) >= 1_000
    code, told = interrupted("--resume")
    assert code == 130
    assert told.count("--resume") == 1
    second = steps_done(out)
    assert all(later > earlier for earlier, later in zip(first, second, strict=True))
