"""Trainings side by side: one process a core, each pinned to it, and a clean stop."""

import multiprocessing as mp
import os
import queue
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from skydog.errors import Refusal
from skydog.learning.curriculum import Curriculum
from skydog.learning.options import Skill


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


@dataclass(frozen=True)
class Message:
    """A worker's message about its job: progress, or how it ended."""

    job: Job
    progress: Any = None  # a `train.Progress`
    ended: str | None = None  # "done", "stopped", or what went wrong
    refused: bool = False  # whether the user can mend what went wrong


def run(jobs: Sequence[Job], callback: Callable[[Message], None]) -> bool:
    """Train every job, as many at a time as there are cores; tell whether all were finished.

    Ctrl-C, or a termination signal, stops after the chunk in hand: every training is
    checkpointed, and the answer is False. Raises `Refusal` if a job was refused or its process
    died, and `RuntimeError` if one broke, once the others are safe.
    """
    cores = sorted(_cores())
    context = mp.get_context("spawn")
    waiting, messages, stop = context.Queue(), context.Queue(), context.Event()
    for job in jobs:
        waiting.put(job)
    workers = [
        context.Process(target=_work, args=(core, waiting, messages, stop), daemon=True)
        for core in cores[: len(jobs)]
    ]
    endings: list[Message] = []
    try:
        with _signals() as asked:
            for worker in workers:
                waiting.put(None)
                _start(worker)
            while any(worker.is_alive() for worker in workers) or not messages.empty():
                if asked:
                    stop.set()
                with suppress(queue.Empty):
                    message = messages.get(timeout=0.2)
                    if message.ended:
                        endings.append(message)
                        if message.ended not in ("done", "stopped"):
                            stop.set()
                    callback(message)
    finally:  # no worker outlives a listener that failed, and no unread job holds up the exit
        stop.set()
        waiting.cancel_join_thread()
    for message in endings:
        if message.refused:
            raise Refusal(message.ended)
        if message.ended not in ("done", "stopped"):
            raise RuntimeError(f"training {message.job.name} broke: {message.ended}")
    killed = [worker.exitcode for worker in workers if worker.exitcode]
    if killed:
        raise Refusal(
            f"a training died (exit code {killed[0]}), out of memory perhaps; try --resume"
        )
    return sum(message.ended == "done" for message in endings) == len(jobs)


def _work(core: int, waiting: Any, messages: Any, stop: Event) -> None:
    parent = os.getppid()
    _pin(core)  # before jax is imported: its threads then do not fight over the cores
    while (job := waiting.get()) is not None and not stop.is_set():
        try:
            finished = _train(job, messages, lambda: stop.is_set() or os.getppid() != parent)
            messages.put(Message(job, ended="done" if finished else "stopped"))
        except Refusal as refusal:
            messages.put(Message(job, ended=str(refusal), refused=True))
        except Exception as problem:
            messages.put(Message(job, ended=f"{type(problem).__name__}: {problem}"))
    if os.getppid() != parent:
        messages.cancel_join_thread()  # nobody reads it any more


def _train(job: Job, messages: Any, stopped: Callable[[], bool]) -> bool:
    from skydog.learning import train

    def callback(progress: train.Progress) -> bool:
        messages.put(Message(job, progress=progress))
        return not stopped()

    curriculum = job.curriculum
    # The lessons of one sheepdog are two trainings: they must not draw the same numbers.
    seed = 2 * job.seed + (job.skill == "drive")
    training, history = train.train(
        curriculum.lesson(job.skill),
        curriculum.config(),
        seed,
        curriculum.steps,
        job.folder,
        job.card,
        job.resume,
        callback,
        curriculum.episodes,
    )
    return train.finished(training, history, curriculum.steps, curriculum.episodes)


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The signals to stop that have come; a second one stops at once."""
    asked: list[int] = []

    def ask(number: int, _: object) -> None:
        if asked:
            os._exit(130)
        asked.append(number)

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _start(worker: BaseProcess) -> None:
    # A worker inherits the mask: Ctrl-C, which the terminal sends to all, is the parent's to hear.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        worker.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _pin(core: int) -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
