"""What a person sees while a long job runs."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import (
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
    track,
)

from skydog.errors import Refusal
from skydog.learning.workers import Job, News

Thing = TypeVar("Thing")

# Results go to the standard output, everything about their making to the standard error.
progress_console = Console(stderr=True)


def say(text: str) -> None:
    """Tell what is being done."""
    progress_console.print(text, highlight=False, markup=False, soft_wrap=True)


def counted(text: str, things: Iterable[Thing]) -> Iterator[Thing]:
    """Go through things, and show how many are done and how long the others will take."""
    yield from track(list(things), text, console=progress_console, transient=True)


class TrainingBars:
    """The progress of all trainings, and of each that runs: reward, success, steps a second."""

    def __init__(self, jobs: Sequence[Job]):
        self._bars = Progress(
            TextColumn("{task.description}"),
            TaskProgressColumn(),
            TextColumn("{task.fields[news]}"),
            TimeRemainingColumn(compact=True),
            console=progress_console,
            refresh_per_second=4,
            speed_estimate_period=120.0,
        )
        self._done: dict[str, int] = {}
        steps = sum(job.course.steps for job in jobs)
        whole = f"all {len(jobs)} trainings"
        self._all = self._bars.add_task(whole, total=steps, news="", visible=len(jobs) > 2)
        self._rows: dict[str, TaskID] = {}

    def __enter__(self) -> "TrainingBars":
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def listen(self, news: News) -> None:
        """Show what a worker tells. A training that has ended makes room for the next."""
        job = news.job
        if job.name not in self._rows:
            self._rows[job.name] = self._bars.add_task(job.name, total=job.course.steps, news="")
        row = self._rows[job.name]
        if news.progress is not None:
            self._done[job.name] = news.progress.step
            speed = self._bars.tasks[row].speed
            self._bars.update(
                row,
                completed=news.progress.step,
                news=f"reward {news.progress.reward_per_action:+.3f}, "
                f"{news.progress.success:4.0%} arrive, {speed or 0:6,.0f} steps/s",
            )
        elif news.ended == "done":
            self._done[job.name] = job.course.steps
            self._bars.update(row, completed=job.course.steps)
            self._bars.update(row, visible=self._bars.tasks[self._all].visible is False)
        self._bars.update(self._all, completed=sum(self._done.values()))


def tensorboard(folder: Path) -> Callable[[News], None]:
    """A listener that writes the learning curves for TensorBoard, one run a training.

    Raises `Refusal` if the optional package is missing.
    """
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        raise Refusal(
            "--tensorboard needs tensorboardX; run: pip install 'skydog[tensorboard]'"
        ) from None
    writers: dict[str, Any] = {}

    def listen(news: News) -> None:
        if news.progress is None:
            return
        name = news.job.name
        if name not in writers:
            writers[name] = SummaryWriter(str(folder / name))
        writer = writers[name]
        writer.add_scalar("reward per action", news.progress.reward_per_action, news.progress.step)
        writer.add_scalar("success", news.progress.success, news.progress.step)
        writer.flush()

    return listen
