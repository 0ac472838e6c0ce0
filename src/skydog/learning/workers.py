"""Trainings side by side: one process a core, each pinned to it, and a clean stop.

Or on many machines: see `skydog.learning.ray_cluster`.
"""

import multiprocessing as mp
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from skydog import files, processes
from skydog.errors import Refusal
from skydog.learning.curriculum import Curriculum
from skydog.learning.options import Skill

PATIENCE = 60.0  # seconds for the workers of a run that was killed: they still save


@dataclass(frozen=True)
class Job:
    """One skill of one sheepdog, to be trained in a folder of its own."""

    curriculum: Curriculum
    skill: Skill
    seed: int
    folder: Path
    resume: bool = False

    @property
    def name(self) -> str:
        """What the job is called while it runs."""
        return f"{self.curriculum.dog} {self.skill}, seed {self.seed}"

    @property
    def card(self) -> dict[str, Any]:
        """What is trained, for the checkpoint."""
        return {**self.curriculum.card(), "skill": self.skill}


def drawn(job: Job) -> int:
    """The seed that a job draws from: collect and drive of a sheepdog draw different numbers."""
    return 2 * job.seed + (job.skill == "drive")


def typed(seed: int) -> int:
    """The seed of a sheepdog, from one that a job of it draws from."""
    return seed // 2


@dataclass(frozen=True)
class Message:
    """A worker's message about its job: progress, or how it ended."""

    job: Job
    progress: Any = None  # a `train.Progress`
    ended: str | None = None  # "done", "stopped", or what went wrong
    refused: bool = False  # whether the user can mend what went wrong


def run(jobs: Sequence[Job], callback: Callable[[Message], None], on: str | None = None) -> bool:
    """Train every job, as many at a time as there are cores; tell whether all were finished.

    `on` says where: None on the cores of this machine, "ray" or "ray://HOST:PORT" on those of a
    Ray cluster, with the same results. Ctrl-C, or a termination signal, stops after the chunk in
    hand: every training is checkpointed, and the answer is False. Raises `Refusal` if a job was
    refused or its process died, and `RuntimeError` if one broke, once the others are safe.
    """
    if on is not None:
        from skydog.learning import ray_cluster

        return ray_cluster.run(jobs, callback, on)
    waiting, endings = list(jobs), list[Message]()
    workers: dict[Connection, BaseProcess] = {}
    stopping = False
    try:
        with signals() as asked:
            for core in sorted(processes.cores())[: len(jobs)]:
                workers |= _start(core)
            talking = list(workers)
            for link in talking:
                _tell(link, waiting.pop(0))
            while talking:
                if not stopping and (asked or any(map(failed, endings))):
                    stopping = True
                    waiting.clear()
                    for link in talking:
                        _tell(link, None)
                ready = set(wait(talking, timeout=0.2))
                for link in [link for link in talking if link in ready]:
                    message = _heard(link)
                    if message is None:
                        talking.remove(link)
                        continue
                    if message.ended:
                        endings.append(message)
                        _tell(link, waiting.pop(0) if waiting else None)
                    callback(message)
    finally:  # a worker whose link is closed stops after the chunk in hand, whatever happened here
        for link, worker in workers.items():
            link.close()
            worker.join()
    raise_failed(endings)
    killed = [worker.exitcode for worker in workers.values() if worker.exitcode]
    if killed:
        raise Refusal(
            f"a training died (exit code {killed[0]}), out of memory perhaps; try --resume"
        )
    return sum(message.ended == "done" for message in endings) == len(jobs)


def failed(ending: Message) -> bool:
    """Whether a job ended otherwise than it should."""
    return ending.ended not in ("done", "stopped")


def raise_failed(endings: Sequence[Message]) -> None:
    """Raise `Refusal` if a job was refused, and `RuntimeError` if one broke."""
    for message in endings:
        if message.refused:
            raise Refusal(message.ended)
        if failed(message):
            raise RuntimeError(f"training {message.job.name} broke: {message.ended}")


def _tell(link: Connection, job: Job | None) -> None:
    """Give a worker its next job, or None: it stops then, after the chunk in hand."""
    with suppress(OSError):  # it died: `_heard` tells
        link.send(job)


def _heard(link: Connection) -> Message | None:
    """A worker's next message, or None if it has ended."""
    with suppress(EOFError, OSError):
        return link.recv()
    return None


def _work(core: int, link: Connection) -> None:
    processes.pin({core})  # before jax is imported: its threads then do not fight over the cores
    # The link breaks when the parent dies, however it dies: a worker never outlives it for long.
    with suppress(EOFError, OSError):
        while (job := link.recv()) is not None:
            link.send(_trained(job, link))


def _trained(job: Job, link: Connection) -> Message:
    def callback(progress: Any) -> bool:
        with suppress(OSError):  # nobody listens any more: what was learnt is kept all the same
            link.send(Message(job, progress=progress))
        return not link.poll()  # told to stop, or the parent is gone

    return trained(job, callback, PATIENCE)


def trained(job: Job, callback: Callable[[Any], bool], patience: float) -> Message:
    """Train a job in this process, and tell how it ended.

    `callback` gets a `train.Progress` after each chunk, and says whether to go on. `patience` is
    how long to wait, in seconds, for another process that still has the job's folder.
    """
    try:
        with files.claimed(job.folder, patience):
            return Message(job, ended="done" if _train(job, callback) else "stopped")
    except Refusal as refusal:
        return Message(job, ended=str(refusal), refused=True)
    except Exception as problem:
        return Message(job, ended=f"{type(problem).__name__}: {problem}")


def _train(job: Job, callback: Callable[[Any], bool]) -> bool:
    from skydog.learning import train

    def told(progress: train.Progress) -> bool:
        return callback(replace(progress, skill=None))  # it stays in the process that learns it

    curriculum = job.curriculum
    training, history = train.train(
        curriculum.lesson(job.skill),
        curriculum.config(job.skill),
        drawn(job),
        curriculum.steps,
        job.folder,
        job.card,
        job.resume,
        told,
        curriculum.episodes,
    )
    return train.finished(training, history, curriculum.steps, curriculum.episodes)


@contextmanager
def signals() -> Iterator[list[int]]:
    """The signals to stop that have come; a second one stops at once.

    A thread hears none: they are for whoever owns the process.
    """
    asked: list[int] = []

    def ask(number: int, _: object) -> None:
        if asked:
            os._exit(130)
        asked.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    before = {number: signal.signal(number, ask) for number in processes.STOPS}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _start(core: int) -> dict[Connection, BaseProcess]:
    """A worker on a core, by our end of the link to it."""
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    worker = context.Process(target=_work, args=(core, theirs), daemon=True)
    try:
        processes.start(worker)
    finally:
        theirs.close()
    return {ours: worker}
