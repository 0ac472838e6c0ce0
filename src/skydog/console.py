"""What a person sees while a long job runs."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from skydog.errors import Refusal
from skydog.learning.workers import Job, News

# Results go to the standard output, everything about their making to the standard error.
progress_console = Console(stderr=True)


def say(text: str) -> None:
    """Tell what is being done."""
    progress_console.print(text, highlight=False, markup=False, soft_wrap=True)


class TrainingBars:
    """One progress bar a training: reward per action, success and steps per second."""

    def __init__(self, jobs: Sequence[Job]):
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[news]}"),
            TimeRemainingColumn(),
            console=progress_console,
            refresh_per_second=4,
        )
        self._rows = {
            job.name: self._bars.add_task(job.name, total=job.steps, news="waiting") for job in jobs
        }

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
        """Show what a worker tells."""
        row = self._rows[news.job.name]
        if news.progress is None:
            if news.ended == "done":
                self._bars.update(row, completed=news.job.steps)
            return
        speed = self._bars.tasks[row].speed
        self._bars.update(
            row,
            completed=news.progress.step,
            news=f"reward {news.progress.reward_per_action:+.3f} an action, "
            f"success {news.progress.success:4.0%}, {speed or 0:6,.0f} steps/s",
        )


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
