"""`skydog bench`: fly shepherds through the benchmark, and put them on the leaderboard."""

import json
import shlex
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from skydog import files
from skydog.commands import flags
from skydog.commands.flags import Json, MaybeOn, Out
from skydog.errors import Refusal

if TYPE_CHECKING:
    from skydog.study.options import Results
    from skydog.world.mission import Shepherd

PAGE = "leaderboard.md"


def bench(
    shepherds: Positional[tuple[flags.Shepherd, ...]] = (),
    tasks: Annotated[str | None, arg(metavar="TASK,...")] = None,
    trained: Annotated[str | None, arg(metavar="TEXT")] = None,
    out: Out = Path("runs/bench"),
    on: MaybeOn = None,
    as_json: Json = False,
) -> int:
    """Fly shepherds through the benchmark, and put them on the leaderboard.

    The benchmark is a fixed list of tasks with fixed starts: the paper's cases, other goals, 3 to
    1,000 sheep, El-Fiqi's patterns, scenes, mixed flocks, sheep that diffuse, and the physics
    twin. Each shepherd becomes a file in the run folder after each task, and leaderboard.md there
    shows it beside the shepherds that ship. A shepherd that was interrupted goes on with the same
    command, and is flown anew if its file has changed.

    Example: skydog bench h-ddpg-4x4 my_dog.py:dog --tasks paper-4m,gate

    Args:
        shepherds: As skydog test names them; none only writes the leaderboard anew.
        tasks: The tasks, all if not given; see docs/bench.md.
        trained: What the training cost, such as "3 M steps, 2 min on a core", for the leaderboard.
        out: The run folder.
        on: Fly on a Ray cluster, each task on a core: `ray` for the one that runs here, or its
            address. Machines must see a shepherd's file at the same path. See docs/many.md.
        as_json: Print the rows as JSON instead of a table.
    """
    from skydog.commands import console
    from skydog.learning import ray_cluster
    from skydog.shepherds import named
    from skydog.study import bench as benchmark
    from skydog.study import board, board_page

    asked = None if tasks is None else [each.strip() for each in tasks.split(",")]
    chosen = benchmark.chosen(asked)
    benchmark.check()
    with files.claimed(files.folder(out)):
        board.check_names(out, shepherds)
        if shepherds:
            console.say("Ctrl-C keeps the tasks that are flown; the same command continues.")
        found = {name: named.read(name) for name in shepherds}
        with ray_cluster.held(on):
            for name, (shepherd, card) in found.items():
                _fly(name, shepherd, trained or _cost(card), chosen, out, on)
        rows = board.rows(board.SHIPPED, out)
        command = shlex.join(["skydog", "bench", *shepherds])
        files.write_text(out / PAGE, board_page.document(rows, command))
    mine = {name: rows[name] for name in shepherds}
    if as_json:
        print(json.dumps(mine, indent=2))
        return 0
    for name in shepherds:
        console.print_table(_table(name, rows))
    console.say(f"All shepherds are in {out / PAGE}.")
    return 0


def _fly(
    name: str, shepherd: "Shepherd", trained: str, tasks: list[str], out: Path, on: str | None
) -> None:
    """Fly the tasks that the shepherd's row lacks: all, if its file has changed since."""
    from skydog.commands import console
    from skydog.shepherds import named
    from skydog.study import bench as benchmark
    from skydog.study import board
    from skydog.twin import Twin

    file, command = board.path(out, name), shlex.join(["skydog", "bench", name])
    row = board.blank(name, named.digest(name), command, trained)
    if files.exists(file) and (kept := board.read(file))["digest"] == row["digest"]:
        row["tasks"] = kept["tasks"]
    todo = [task for task in tasks if task not in row["tasks"]]
    flown: Iterator[Results]
    if on is None:
        twin = Twin(benchmark.DRONE, threads=0)
        flown = (benchmark.fly(name, shepherd, task, twin) for task in todo)
    else:
        from skydog.learning import ray_cluster
        from skydog.shepherds import finding

        flown = ray_cluster.each(partial(_away, finding.anywhere(name), row["digest"]), todo, on)
    for task, figures in zip(console.track(name, todo), flown, strict=True):
        row["tasks"][task] = figures
        if any("refused" not in each for each in row["tasks"].values()):
            board.save(out, row)
    if all("refused" in each for each in row["tasks"].values()):
        raise Refusal(f"{name} flies none of the tasks: {row['tasks'][tasks[0]]['refused']}")


def _away(name: str, digest: str, task: str) -> "Results":
    """Fly a task on a machine of a cluster, on one core."""
    from skydog.shepherds import named
    from skydog.study import bench as benchmark
    from skydog.twin import Twin

    shepherd, _ = named.read(name)
    if named.digest(name) != digest:
        raise Refusal(f"{name} is not the same file as where skydog bench was called; copy it here")
    return benchmark.fly(name, shepherd, task, Twin(benchmark.DRONE, threads=1))


def _cost(card: dict[str, Any]) -> str:
    """What a sheepdog's card says of its training."""
    steps = card.get("steps_a_skill")
    if not isinstance(steps, int):
        return "—"
    return f"{steps:,} steps a skill, seed {card.get('seed')}"


def _table(name: str, rows: dict[str, Any]) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from skydog.study import bench as benchmark
    from skydog.study import board, board_page

    table = Table("task", name, "best known", box=SIMPLE_HEAD)
    for task in benchmark.TASKS:
        if (figures := rows[name]["tasks"].get(task)) is None:
            continue
        known = board.best_known(task, rows)
        shown = board_page.cell(task, figures, rows)
        best = "—" if known is None else f"{known[0]:.0f} ({known[1]})"
        table.add_row(task, figures.get("refused", shown), best)
    return table
