"""Trainings on a cluster of Ray: two machines, of which one is lost."""

import logging
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from skydog import files
from skydog.arrays import load_arrays
from skydog.commands.bench import _away, bench
from skydog.errors import Refusal
from skydog.learning import ray_cluster, train, workers
from skydog.learning.curriculum import Curriculum

# Ray forks its processes, and they become other programs at once. jax, in use by now in this
# process, warns of every fork.
pytestmark = pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")

STEPS, CHECKPOINT, HELD = 6_000, 4_000, 5_000
# Ray gives up on what does not answer within seconds: on a slow machine nothing does.
PATIENT = {
    "RAY_gcs_rpc_server_reconnect_timeout_s": "600",
    "RAY_gcs_server_port_wait_time_s": "600",
    "RAY_gcs_server_request_timeout_seconds": "600",
    "RAY_health_check_timeout_ms": "600000",
    "RAY_raylet_start_wait_time_s": "600",
    "RAY_worker_register_timeout_seconds": "600",
    "RAY_worker_niceness": "0",
}


def held(go: Path) -> None:
    """Checkpoint often, tell of every chunk, and go no further than `HELD` before there is `go`.

    Nor on a machine that was killed: its processes notice it only after a while.
    """
    advance, machine = train.advance, os.getppid()

    def waits(task, config, training, key, steps):
        while int(training.step) >= HELD and not (go.exists() and os.getppid() == machine):
            time.sleep(0.05)
        return advance(task, config, training, key, steps)

    train.CHECKPOINT, train.advance, ray_cluster.EVERY = CHECKPOINT, waits, 0.0


@pytest.fixture(scope="module")
def go(tmp_path_factory):
    """The file that lets trainings go on."""
    return tmp_path_factory.mktemp("cluster") / "go"


@pytest.fixture(scope="module")
def cluster(go):
    """Two machines with a core each."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in PATIENT.items():
            patch.setenv(name, value)
        ray = pytest.importorskip("ray")
        from ray.cluster_utils import Cluster

        ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
        machines = Cluster(True, head_node_args={"num_cpus": 1})
        try:
            machines.add_node(num_cpus=1)
            ray.init(
                machines.address,
                log_to_driver=False,
                logging_level=logging.ERROR,
                runtime_env={"worker_process_setup_hook": lambda: held(go)},
            )
            yield machines
        finally:
            ray.cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
            ray.shutdown()
            machines.shutdown()


def test_a_machine_with_another_version_is_refused(cluster, monkeypatch, tmp_path):
    asked = {**ray_cluster._versions(), "skydog": "9.9"}
    monkeypatch.setattr(ray_cluster, "_versions", lambda: asked)
    with pytest.raises(Refusal, match=r"machine .* has skydog .*: pip install skydog==9\.9"):
        workers.run([workers.Job(Curriculum(), "drive", 0, tmp_path)], lambda _: None, "ray")


def test_a_folder_that_a_machine_does_not_see_is_refused(cluster, monkeypatch, tmp_path):
    monkeypatch.setattr(files, "write_text", lambda path, content: None)
    with pytest.raises(Refusal, match=r"does not see .* all machines share"):
        workers.run([workers.Job(Curriculum(), "drive", 0, tmp_path)], lambda _: None, "ray")


def test_results_of_other_work_come_in_the_order_of_its_items(cluster):
    with pytest.raises(ZeroDivisionError):
        list(ray_cluster.each(lambda number: 1 / number, [0.0], "ray"))
    assert list(ray_cluster.each(lambda number: 1 / number, [1.0, 2.0, 4.0], "ray")) == [
        1,
        0.5,
        0.25,
    ]


def test_a_row_of_the_benchmark_is_the_same_on_a_cluster(cluster, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("from skydog.shepherds.strombom import Strombom as dog\n")
    tasks = "paper-4m,goal-centre"
    bench(("own.py:dog",), tasks, out=Path("home"))
    bench(("own.py:dog",), tasks, out=Path("away"), on="ray")
    rows = [(Path(out) / "own.py-dog.json").read_bytes() for out in ("home", "away")]
    assert rows[0] == rows[1]
    with pytest.raises(Refusal, match=r"machine .* not the same file"):
        list(
            ray_cluster.each(
                partial(_away, str(Path("own.py:dog").absolute()), "0"), ["gate"], "ray"
            )
        )


def test_a_study_that_loses_a_machine_ends_with_the_same_bits(cluster, go, tmp_path):
    curriculum = Curriculum(steps=STEPS)
    jobs = [workers.Job(curriculum, "drive", seed, tmp_path / f"{seed}") for seed in range(2)]
    steps = {job: [] for job in jobs}

    def callback(message):
        if message.progress:
            steps[message.job].append(message.progress.step)
        if not go.exists() and all(HELD in seen for seen in steps.values()):
            cluster.remove_node(*cluster.worker_nodes, allow_graceful=False)  # kills it
            go.touch()

    assert workers.run(jobs, callback, "ray")
    # One went through. The other went on elsewhere, from its last checkpoint.
    through = list(range(1_000, STEPS + 1, 1_000))
    assert sorted(steps.values()) == [[*through[:5], *through[4:]], through]
    for job in jobs:
        home = tmp_path / "home" / f"{job.seed}"
        lesson, config = curriculum.lesson("drive"), curriculum.config("drive")
        train.train(lesson, config, workers.drawn(job), STEPS, home, job.card)
        ours, card = load_arrays(train.checkpoint_in(job.folder), train.KIND)
        theirs, their_card = load_arrays(train.checkpoint_in(home), train.KIND)
        assert card == their_card
        assert ours.keys() == theirs.keys()
        for name, values in ours.items():
            np.testing.assert_array_equal(values, theirs[name], name)


def test_who_does_not_ask_for_ray_does_not_import_it():
    code = "import sys, skydog.cli, skydog.learning.ray_cluster; print('ray' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "False\n"


def test_without_ray_its_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(Refusal, match=r"pip install 'skydog\[ray\]'"):
        workers.run([], lambda _: None, "ray")


@pytest.mark.parametrize("on", ["", "spark", "ray://", "ray://here", "ray:// here:1", "ray://a:b"])
def test_what_is_no_cluster_is_refused(on):
    with pytest.raises(Refusal, match=r"no cluster is called .* --on ray"):
        workers.run([], lambda _: None, on)


def test_a_cluster_that_is_not_there_is_told_at_once():
    with pytest.raises(Refusal, match=r"nobody answers at ray://localhost:1 .* ray start"):
        ray_cluster._check_there("ray://localhost:1")
