"""What a person sees: progress on the standard error, results on the standard output."""

import json
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console, Group
from rich.measure import Measurement
from rich.progress import (
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import track as rich_track
from rich.table import Table
from rich.text import Text

from skydog.errors import Refusal, one_line
from skydog.learning.workers import Job, Message

if TYPE_CHECKING:
    from skydog.world.trace import Trace

Thing = TypeVar("Thing")

WIDEST = 10_000  # columns of a table

# Results go to the standard output, everything about their making to the standard error.
progress_console = Console(stderr=True)


def say(text: str) -> None:
    """Tell what is being done."""
    progress_console.print(one_line(text), highlight=False, markup=False, soft_wrap=True)


def say_beyond(shepherd: str, asked: Sequence[str]) -> None:
    """Say what a mission asks of a shepherd beyond what it was taught, if anything."""
    if asked:
        say(f"{shepherd} was trained {'; '.join(asked)}. It flies anyway.")


def say_over(traces: "Trace") -> None:
    """Say if missions, stacked along the first axis, are accomplished where they start."""
    over = int(traces.accomplished[:, 0].sum())
    if over:
        count = len(traces.accomplished)
        say(f"{over} of {count} missions are accomplished at the start; try --starts anywhere")


def say_endings(traces: "Trace") -> None:
    """Say how missions, stacked along the first axis, ended, if not all were accomplished."""
    from skydog.world.trace import ACCOMPLISHED, ENDINGS

    if traces.ending is None:
        return
    ways = [int(way) for way in traces.ending.how]
    for way in sorted(set(ways) - {ACCOMPLISHED}):
        case = ways.index(way)
        say(f"{ways.count(way)} of {len(ways)} missions ended {ENDINGS[way]!r}; so did case {case}")


def film(path: Path, trace: "Trace", profile: str, rovers: str) -> None:
    """Write a film of one mission of the twin, and tell its progress."""
    from skydog.twin import film as films

    with Progress(console=progress_console, transient=True) as bars:
        row = bars.add_task("film")
        films.save(
            path,
            trace,
            profile,
            rovers,
            progress=lambda done, whole: bars.update(row, completed=done, total=whole),
        )
    say(f"The film is {path}.")


def track(text: str, things: Iterable[Thing]) -> Iterator[Thing]:
    """Go through things, and show how many are done and how long the others will take."""
    yield from rich_track(list(things), text, console=progress_console, transient=True)


@contextmanager
def missions(count: int, name: str = "missions") -> Iterator[Callable[[int, int], None]]:
    """Shows the progress of missions that are flown together.

    What it gives is told the step, and how many missions are over by then.
    """
    columns = (
        TextColumn("{task.description}"),
        TaskProgressColumn(),
        TextColumn("{task.fields[at]}"),
    )
    with Progress(*columns, console=progress_console, transient=True) as bars:
        row = bars.add_task(name, total=count, at="")

        def update(step: int, over: int) -> None:
            bars.update(row, completed=over, at=f"step {step}, {over} of {count} are over")

        yield update


class TrainingBars:
    """The progress of all trainings, and of each that runs: reward, steps a second."""

    def __init__(self, jobs: Sequence[Job]):
        self._bars = Progress(
            TextColumn("{task.description}"),
            TaskProgressColumn(),
            TextColumn("{task.fields[message]}"),
            TimeRemainingColumn(compact=True),
            console=progress_console,
            refresh_per_second=4,
            speed_estimate_period=120.0,
        )
        self._done: dict[str, int] = {}
        steps = sum(job.curriculum.steps for job in jobs)
        whole = f"all {len(jobs)} trainings"
        self._all = self._bars.add_task(whole, total=steps, message="", visible=len(jobs) > 2)
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

    def update(self, message: Message) -> None:
        """Show a worker's message. A training that has ended makes room for the next."""
        job = message.job
        if job.name not in self._rows:
            self._rows[job.name] = self._bars.add_task(
                job.name, total=job.curriculum.steps, message=""
            )
        row = self._rows[job.name]
        if message.progress is not None:
            self._done[job.name] = message.progress.step
            speed = self._bars.tasks[row].speed
            self._bars.update(
                row,
                completed=message.progress.step,
                message=f"reward per action {message.progress.reward_per_action:+.3f}, "
                f"{speed or 0:6,.0f} steps/s",
            )
        elif message.ended == "done":
            self._done[job.name] = job.curriculum.steps
            self._bars.update(row, completed=job.curriculum.steps)
            self._bars.update(row, visible=self._bars.tasks[self._all].visible is False)
        self._bars.update(self._all, completed=sum(self._done.values()))


def tensorboard(folder: Path) -> Callable[[Message], None]:
    """A callback that writes the learning curves for TensorBoard, one run a training.

    Raises `Refusal` if the optional package is missing.
    """
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        raise Refusal(
            "--tensorboard needs tensorboardX; run: pip install 'skydog[tensorboard]'"
        ) from None
    writers: dict[str, Any] = {}

    def write(message: Message) -> None:
        if message.progress is None:
            return
        name = message.job.name
        if name not in writers:
            writers[name] = SummaryWriter(str(folder / name))
        writer = writers[name]
        writer.add_scalar(
            "reward per action", message.progress.reward_per_action, message.progress.step
        )
        writer.add_scalar("success", message.progress.success, message.progress.step)
        writer.flush()

    return write


def command_line() -> str:
    """The command as it was typed."""
    return shlex.join(["skydog", *sys.argv[1:]])


def show(results: dict[str, Any], as_json: bool, as_paper: bool = True) -> None:
    """Print rows of figures as a table, beside the paper's if they are of its cases; or as JSON."""
    if as_json:
        print(json.dumps(results if len(results) > 1 else next(iter(results.values())), indent=2))
        return
    from skydog.study import report

    print_table(report.table(report.rows(results, as_paper)))


def print_path(path: Path) -> None:
    """Print where something was written: as it is for a program, in one line for a person."""
    print(one_line(str(path)) if sys.stdout.isatty() else path)


def print_table(table: Table) -> None:
    """Print a table on the standard output, below each other what does not fit beside each other.

    A file or a pipe has room for every table.
    """
    console = ResultConsole()
    needs = Measurement.get(console, console.options.update(width=WIDEST), table).maximum
    if needs > console.width and not sys.stdout.isatty():
        console.width = needs
    console.print(table if needs <= console.width else stacked(table))


def stacked(table: Table) -> Group:
    """A table for a narrow terminal: each row a block, and in it a line for each column."""
    head, *columns = table.columns
    blocks: list[Any] = []
    for row, name in enumerate(head.cells):
        block = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
        block.add_column(overflow="fold")
        block.add_column(overflow="fold")
        for column in columns:
            # Lines of one figure stand beside each other: the mean, then its interval.
            cell = str(list(column.cells)[row]).replace("\n", " ")
            block.add_row(Text(str(column.header)), Text(cell))
        blocks += [Text(str(name), style="bold"), block, Text()]
    return Group(*blocks, Text(str(table.caption or "")))


class ResultConsole(Console):
    """The standard output. A reader that has gone is for the command to notice, as any other."""

    def on_broken_pipe(self) -> None:
        """Raise the `BrokenPipeError` that is being handled."""
        raise
