"""Trainings on a cluster of Ray: two machines, of which one is lost."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from skydog.arrays import load_arrays
from skydog.learning import ray_cluster, train, workers
from skydog.learning.curriculum import Curriculum

STEPS, CHECKPOINT, HELD = 6_000, 2_000, 4_000
MARKS = Path(__file__).with_name("marks")


def held(go: str) -> None:
    """Checkpoint often, tell of every chunk, and go no further than `HELD` before there is `go`."""
    advance = train.advance

    def waits(task, config, training, key, steps):
        while int(training.step) >= HELD and not Path(go).exists():
            time.sleep(0.05)
        return advance(task, config, training, key, steps)

    train.CHECKPOINT, train.advance, ray_cluster.EVERY = CHECKPOINT, waits, 0.0


@pytest.fixture
def cluster(tmp_path):
    """Two machines with a core each, and what a process on either does first."""
    ray = pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    machines = cluster_utils.Cluster(True, head_node_args={"num_cpus": 1})
    go = str(tmp_path / "go")
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    try:
        machines.other = machines.add_node(num_cpus=1)
        ray.init(
            machines.address,
            log_to_driver=False,
            logging_level="error",
            runtime_env={"worker_process_setup_hook": lambda: held(go)},
        )
        yield machines
    finally:
        ray.cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
        ray.shutdown()
        machines.shutdown()


def test_a_study_that_loses_a_machine_ends_with_the_same_bits(cluster, tmp_path):
    curriculum = Curriculum(steps=STEPS)
    jobs = [workers.Job(curriculum, "drive", seed, tmp_path / f"{seed}") for seed in range(2)]
    steps = {job: [] for job in jobs}

    def callback(message):
        if message.progress:
            steps[message.job].append(message.progress.step)
        if not (tmp_path / "go").exists() and all(HELD in seen for seen in steps.values()):
            cluster.remove_node(cluster.other, allow_graceful=False)  # kills it
            (tmp_path / "go").touch()

    assert workers.run(jobs, callback, "ray")
    chunks = [1_000, 2_000, 3_000, 4_000, 5_000, 6_000]
    # One went through; the other went on elsewhere, from its last checkpoint.
    assert sorted(steps.values()) == [[*chunks[:4], *chunks[4:]], chunks]
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
