"""The study of scenes as tables, as Markdown and as a page."""

from collections.abc import Callable

from rich.table import Table as RichTable

from skydog.study import report, scenes
from skydog.study.options import Results
from skydog.study.page import Page, Table, terminal

TITLE = "Around obstacles"
FIGURE = "obstacles"  # the name of its file, without the suffix
CAPTION = (
    f"One mission of {scenes.NAMES[0]} with {scenes.SHOWN_SHEEP} sheep in each scene: the "
    "paths of the sheep and of the dog, which flies above the obstacles."
)

INTRODUCTION = (
    "The five [scenes](scenes.md) put walls and discs into the world of the preset `paper`. The "
    "sheep cannot pass them; the dog flies above. The arena grows with the flock: 12 m for 3 "
    "sheep, 22 m for 10, and 38 m for 30. The gate is always 1 m wide, which is the avoidance "
    "radius of a sheep.",
    "“Around” is the way home by the field "
    "([`AroundHome`](#skydog.world.home.AroundHome)): it says who strays, where to push it and "
    "where to drive. “Straight” is the same dog with the straight line "
    "([`StraightHome`](#skydog.world.home.StraightHome)). No shepherd was changed or trained for "
    "obstacles. Both fly the same starts, at the same speed limits.",
)

NOTES = (
    "Success has its Wilson 95 % interval. Steps are mean ± SD; a mission that fails counts with "
    "all its steps. A mission has at most "
    + ", ".join(f"{steps:,} steps with {sheep} sheep" for sheep, steps in scenes.STEPS.items())
    + ".",
    "Starts: "
    + ", ".join(f"{count} with {sheep} sheep" for sheep, count in scenes.FLOCKS.items())
    + f"; for {scenes.NAMES[0]} in the gate {scenes.GATE_CASES} each. The straight dog flies "
    f"the first {scenes.STRAIGHT_CASES} of them, since it mostly fails and then takes all its "
    f"steps; in the {scenes.COMPARED} it flies all.",
    f"The starts are those of seed {scenes.SEED}. The rules of `AroundHome` were tried on starts "
    "of seeds from 500 on.",
)

PAGE = Page(TITLE, INTRODUCTION, FIGURE, CAPTION, NOTES)


def _success(row: Results) -> str:
    low, high = row["success_ci95"]
    return f"{report.share(row['success'])}\n[{100 * low:.0f}, {100 * high:.0f}]"


def _steps(row: Results) -> str:
    return report.figure(row["steps"], ".0f").split("\n")[0]


def _names(results: Results) -> list[str]:
    (flocks, *_) = results["scenes"].values()
    return list(next(iter(flocks.values())))


def _each(results: Results, how: str, tell: Callable[[Results], str]) -> list[list[str]]:
    names = _names(results)
    return [
        [f"{scene}, {sheep} sheep", *(tell(rows[name][how]) for name in names)]
        for scene, flocks in results["scenes"].items()
        for sheep, rows in flocks.items()
    ]


def success_table(results: Results, how: str) -> Table:
    """Success in each scene and flock, of dogs that go `around` or `straight`."""
    return [f"success, {how}", *_names(results)], _each(results, how, _success)


def steps_table(results: Results, how: str) -> Table:
    """Steps in each scene and flock, of dogs that go `around` or `straight`."""
    return [f"steps, {how}", *_names(results)], _each(results, how, _steps)


def compared_table(results: Results) -> Table:
    """Steps around as times those of the straight dog, where that one arrives too."""
    body = []
    for sheep, rows in results["scenes"][scenes.COMPARED].items():
        cells = []
        for row in rows.values():
            low, high = row["less than straight"]["ci95"]
            cells.append(
                f"{row['times straight']:.2f}\n{row['less than straight']['mean']:+.0f} "
                f"[{low:+.0f}, {high:+.0f}]"
            )
        body.append([f"{scenes.COMPARED}, {sheep} sheep", *cells])
    return ["steps, times the straight dog's; less those", *_names(results)], body


def grounded_table(results: Results) -> Table:
    """Dogs that go around obstacles too."""
    body = [
        [
            f"{scene}, {scenes.GROUNDED_SHEEP} sheep",
            *(f"{_success(row)}, {_steps(row)}" for row in rows.values()),
        ]
        for scene, rows in results["grounded"].items()
    ]
    return ["success, steps", *_names(results)], body


def sections(results: Results) -> dict[str, list[Table]]:
    """Every table of the study, by the title of its section."""
    return {
        "By the field, around obstacles": [
            success_table(results, "around"),
            steps_table(results, "around"),
        ],
        "Straight on, for comparison": [success_table(results, "straight")],
        "What the way around costs in clutter": [compared_table(results)],
        f"Dogs on the ground, {scenes.GROUNDED_CASES} starts": [grounded_table(results)],
    }


def summary(results: Results) -> RichTable:
    """Success in each scene, for a terminal."""
    head, body = success_table(results, "around")
    return terminal(head, [[cell.replace("\n", " ") for cell in cells] for cells in body])


def document(results: Results, command: str) -> str:
    """The study as Markdown."""
    return PAGE.markdown(sections(results), command)


def page(results: Results, figure: str, player: str, command: str) -> str:
    """The study as one HTML page; `figure` is inline SVG and `player` a replay as markup."""
    return PAGE.html(sections(results), figure, player, command)
