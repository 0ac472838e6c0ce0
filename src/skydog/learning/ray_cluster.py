"""Trainings and other work on many machines: tasks of Ray, each on one core of a cluster.

A training is the same bit for bit as `skydog.learning.workers` would have made it, as long as the
processors are of the same kind. Ray is imported only by who asks for it; it comes with
`pip install 'skydog[ray]'`.
"""

import logging
import os
import re
import secrets
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import (
    AbstractContextManager,
    contextmanager,
    nullcontext,
    redirect_stdout,
    suppress,
)
from dataclasses import astuple, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from skydog import files, processes
from skydog.errors import Refusal, one_line, short
from skydog.learning import workers
from skydog.learning.workers import Job, Message

Item = TypeVar("Item")
Result = TypeVar("Result")

PORT = 10001  # where `ray start --head` listens for ray://
RETRIES = 10  # how often a task begins anew whose process or machine died
EVERY = 1.0  # seconds between the messages of a training: thousands of them have one listener
PATIENCE = 180.0  # seconds: a file server keeps the locks of a lost machine for 90
PACKAGES = ("skydog", "jax", "jaxlib", "equinox", "optax")  # what the bits depend on
INHERITED = ("XLA_FLAGS", "JAX_PLATFORMS")  # settings that a worker has from its parent at home


@dataclass(frozen=True)
class Site:
    """What a machine needs to compute as the one that asks it to."""

    versions: dict[str, str]
    settings: dict[str, str | None]


def checked(on: str) -> str:
    """Where to compute: "ray" or "ray://HOST:PORT". Raises `Refusal` for anything else."""
    if on == "ray" or re.fullmatch(r"ray://[^\s/:]+:\d+|ray://\[[\da-fA-F:]+\]:\d+", on):
        return on
    raise Refusal(f"no cluster is called {short(on)}; try --on ray, or --on ray://HOST:{PORT}")


def run(jobs: Sequence[Job], callback: Callable[[Message], None], on: str) -> bool:
    """Train every job, a task each, as `workers.run` does on this machine's cores.

    Folders of jobs must be the same on all machines. A training whose process or machine dies
    goes on from its last checkpoint somewhere else.
    """
    with connected(on) as ray:
        listener = {"num_cpus": 0, "resources": {"node:__internal_head__": 0.001}}
        board = ray.remote(**listener)(Board).remote()
        _check_machines(ray, _shared(jobs))
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(_trained)
        site = _site()
        with workers.signals() as asked:
            tasks = {
                task.remote(number, _anywhere(job), board, site): job
                for number, job in enumerate(jobs)
            }
            endings: list[Message] = []
            stopping = False
            try:
                while tasks:
                    over, _ = ray.wait(list(tasks), timeout=0.5)  # one, or none by then
                    for number, progress in ray.get(board.take.remote()):
                        callback(Message(jobs[number], progress=_progress(progress)))
                    for each in over:
                        ending = _ending(ray, each, tasks.pop(each))
                        endings.append(ending)
                        callback(ending)
                    if not stopping and (asked or any(map(workers.failed, endings))):
                        stopping = True
                        ray.get(board.stop.remote())
            finally:  # whatever happened here, what was learnt is kept
                ray.get(board.stop.remote())
                if tasks:
                    ray.wait(list(tasks), num_returns=len(tasks))
    workers.raise_failed(endings)
    return sum(ending.ended == "done" for ending in endings) == len(jobs)


def each(work: Callable[[Item], Result], items: Sequence[Item], on: str) -> Iterator[Result]:
    """What `work` makes of each of the items, in their order, a task each on one core.

    `work` is sent to the machines, with all that it refers to, and begins anew where a machine
    died: it must be a function of its item alone. Raises what it raises.
    """
    with connected(on) as ray:
        _check_machines(ray, None)
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(_worked)
        site = _site()
        results = [task.remote(work, item, site) for item in items]
        while results:
            try:
                yield ray.get(results.pop(0))
            except ray.exceptions.RayTaskError as problem:
                raise problem.cause from None


class Board:
    """Where trainings say how far they are, and read whether to go on. An actor of Ray."""

    def __init__(self) -> None:
        self._begun: set[int] = set()
        self._posted: list[tuple[int, tuple[Any, ...]]] = []
        self._stopping = False

    def begin(self, number: int) -> tuple[bool, bool]:
        """Whether a training may begin, and whether it has begun before."""
        before = number in self._begun
        self._begun.add(number)
        return not self._stopping, before

    def post(self, number: int, progress: tuple[Any, ...]) -> bool:
        """Say how far a training is; the answer is whether it goes on."""
        self._posted.append((number, progress))
        return not self._stopping

    def take(self) -> list[tuple[int, tuple[Any, ...]]]:
        """What was posted since the last time."""
        taken, self._posted = self._posted, []
        return taken

    def stop(self) -> None:
        """Let every training stop after the chunk in hand, and none begin."""
        self._stopping = True


def _trained(number: int, job: Job, board: Any, site: Site) -> Message:
    """Train a job on whatever machine this is: the body of a task."""
    import ray
    import ray.exceptions

    # Of a main thread that waits for an answer, Ray gives the core to another task.
    line = ThreadPoolExecutor(1)

    def answer(question: Any) -> Any:
        return line.submit(ray.get, question).result()

    goes_on, before = answer(board.begin.remote(number))
    if not goes_on:
        return Message(job, ended="stopped")
    try:
        _settle(site)
        if not files.is_folder(job.folder):
            raise Refusal(_unseen(_here(), job.folder))
    except Refusal as refusal:
        return Message(job, ended=str(refusal), refused=True)
    posted = -EVERY

    def callback(progress: Any) -> bool:
        nonlocal posted
        if time.monotonic() - posted < EVERY:
            return True
        posted = time.monotonic()
        with suppress(ray.exceptions.RayError):
            return answer(board.post.remote(number, astuple(progress)))
        return False  # nobody listens any more: what was learnt is kept all the same

    return workers.trained(replace(job, resume=job.resume or before), callback, PATIENCE)


def _worked(work: Callable[[Any], Any], item: Any, site: Site) -> Any:
    _settle(site)
    try:
        return work(item)
    except Refusal as refusal:
        raise Refusal(f"{_here()}: {refusal}") from None


def _settle(site: Site) -> None:
    """Compute from now on as the machine does that asked. Raises `Refusal` if this one cannot."""
    unlike = _unlike(site.versions, _versions())
    if unlike:
        raise Refusal(f"{_here()} has {unlike}")
    for name, value in site.settings.items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value
    processes.settle()
    processes.one_thread()


def _check_there(on: str) -> None:
    """Raise `Refusal` if nobody listens where a cluster is said to be. Ray itself asks for long."""
    if on == "ray":
        return
    host, _, port = on.removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=10).close()
    except (OSError, OverflowError) as problem:
        raise Refusal(
            f"nobody answers at {on} ({one_line(str(problem)):.100}); start a cluster with: ray "
            "start --head"
        ) from None


def _site() -> Site:
    settings = {name: os.environ.get(name) for name in INHERITED}
    # A task has a core, and no share of a GPU.
    return Site(_versions(), {**settings, "JAX_PLATFORMS": settings["JAX_PLATFORMS"] or "cpu"})


def _versions() -> dict[str, str]:
    return {name: metadata.version(name) for name in PACKAGES}


def _unlike(ours: dict[str, str], theirs: dict[str, str]) -> str | None:
    """What to say of a machine that has other versions; None if it has the same."""
    for name, wanted in ours.items():
        if theirs.get(name) != wanted:
            there = f"{name} {theirs[name]}" if name in theirs else f"no {name}"
            return (
                f"{there}, this study runs with {name} {wanted}; run there: "
                f"pip install {name}=={wanted}"
            )
    return None


def _unseen(machine: str, folder: Path) -> str:
    return (
        f"{machine} does not see {folder} of this machine; choose an --out on a file system that "
        "all machines share, at the same path"
    )


def _here() -> str:
    import ray

    return f"the machine {ray.util.get_node_ip_address()}"


def _anywhere(job: Job) -> Job:
    """A job whose paths lead to the same place from every working folder."""
    return replace(job, curriculum=job.curriculum.anywhere(), folder=job.folder.absolute())


def _shared(jobs: Sequence[Job]) -> Path | None:
    """The folder that holds the folders of all jobs, made with them."""
    folders = [files.folder(job.folder.absolute()) for job in jobs]
    return Path(os.path.commonpath(folders)) if folders else None


def _progress(values: tuple[Any, ...]) -> Any:
    from skydog.learning import train

    return train.Progress(*values)


def _ending(ray: Any, task: Any, job: Job) -> Message:
    try:
        return replace(ray.get(task), job=job)
    except ray.exceptions.RayError as problem:
        why = one_line(str(problem)).split(". ")[0]
        return Message(job, ended=f"{job.name} died: {why:.200}; try --resume", refused=True)


def _check_machines(ray: Any, folder: Path | None) -> None:
    """Raise `Refusal` if a machine has other versions than this one, or does not see the folder."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    mark = None if folder is None else folder / f".seen-{secrets.token_hex(8)}"
    try:
        if mark is not None:
            files.write_text(mark, "")
        looking = {}
        for node in ray.nodes():
            if node["Alive"]:
                there = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
                # A lambda is sent as code: a machine may have no skydog, or another.
                look = ray.remote(num_cpus=0, scheduling_strategy=there)(
                    lambda: (
                        {each.name: each.version for each in reversed([*metadata.distributions()])},
                        mark is None or os.path.exists(mark),
                    )
                )
                looking[f"the machine {node['NodeManagerAddress']}"] = look.remote()
        for machine, told in looking.items():
            try:
                theirs, seen = ray.get(told)
            except ray.exceptions.RayError:
                continue  # it has just died: its work goes to others
            unlike = _unlike(_versions(), theirs)
            if unlike:
                raise Refusal(f"{machine} has {unlike}")
            if not seen and folder is not None:
                raise Refusal(_unseen(machine, folder))
    finally:
        if mark is not None:
            mark.unlink(missing_ok=True)


def held(on: str | None) -> AbstractContextManager[Any]:
    """One connection for all that is done within, if `on` names a cluster: its start takes long."""
    return nullcontext() if on is None else connected(on)


@contextmanager
def connected(on: str) -> Iterator[Any]:
    """The module `ray`, in touch with the cluster, or with one of this machine if there is none.

    Who is in touch with one already stays so. Raises `Refusal` if Ray is missing, or no cluster
    answers.
    """
    checked(on)
    try:
        import ray
    except ImportError:
        raise Refusal(f"--on {on} needs Ray; run: pip install 'skydog[ray]'") from None
    if ray.is_initialized():
        yield ray
        return
    _check_there(on)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGTERM)  # Ray sets its own
    # What Ray says of machines is no result.
    with redirect_stdout(sys.stderr):
        try:
            with warnings.catch_warnings(action="ignore"):
                ray.init(
                    None if on == "ray" else on,
                    log_to_driver=False,
                    logging_level=logging.ERROR,
                    include_dashboard=False if on == "ray" else None,
                )
        except Exception as problem:
            raise Refusal(
                f"no Ray cluster answers at {on} ({one_line(str(problem)):.200}); "
                "start one with: ray start --head, and set RAY_AUTH_MODE=token if it has a token"
            ) from None
        try:
            yield ray
        finally:
            ray.shutdown()
            if main:
                signal.signal(signal.SIGTERM, handler)
