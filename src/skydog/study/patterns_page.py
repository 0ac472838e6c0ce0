"""The study of El-Fiqi's six patterns as tables, as Markdown and as a page."""

from rich.table import Table as RichTable

from skydog.study import patterns, report
from skydog.study.options import Results
from skydog.study.page import Page, Table, terminal

TITLE = "El-Fiqi's six patterns"
FIGURE = "patterns"  # the name of its file, without the suffix
CAPTION = (
    "The first mission of each pattern: where the sheep start (dark) and end (light), and the "
    "paths of the dogs arc and elfiqi, which start at the same place."
)

INTRODUCTION = (
    "El-Fiqi et al. 2020 (“The Limits of Reactive Shepherding Approaches for Swarm Guidance”, "
    "IEEE Access 8) start 100 sheep in six patterns, P1 to P6, on a field of 50 m × 50 m. The dog "
    "starts near the goal, which is the disc of 10 m around (25, 50). A mission is accomplished "
    "when every sheep is in the disc. Sheep move 1 m in a step, the dog 2 m.",
    "Their sheep are the law [`RegulatedFlock`](#skydog.world.laws.elfiqi.RegulatedFlock). They "
    "group with those within 3 m, and flee from a dog at any distance; the nearer it is, the "
    "more. Their dog, rebuilt, is the shepherd `elfiqi` "
    "([`ElFiqi`](#skydog.shepherds.elfiqi.ElFiqi)). The shepherd `arc` is ours "
    "([`Arc`](#skydog.shepherds.arc.Arc)). All fly the same starts in the preset `elfiqi2020`, at "
    "the same speed limits.",
)

NOTES = (
    "“As printed” are the steps that the authors report for their own program: a mean of ten "
    "missions, all of them accomplished (github.com/Hebaelfiqi/Shepherding, "
    "docs/web_simulator_validation.md, built natively; built for the browser, the same program "
    "takes 360 steps on P4). “Least” are the steps in which the sheep with the longest way could "
    "go straight to the disc, if a dog stood behind it from the start.",
    "Success has its Wilson 95 % interval. Steps are mean ± SD with the bootstrap 95 % interval "
    f"of the mean; a mission that fails counts with all its {patterns.STEPS:,} steps. The "
    "differences to `elfiqi` are paired by start, with intervals of the same kind.",
    "`arc` differs from `elfiqi` in four ways. It flies around the flock close to the outermost "
    "sheep, at full speed; their circle is 14 m wider than the flock, and on it they turn 0.1 rad "
    "in a step. It collects the stray at hand; they collect the furthest. It collects from 2/3 "
    "f(N) on; they collect from f(N) on. It stands nearer: f(N)/2 behind the flock's centre and "
    "2/3 f(N) behind a stray; they stand f(N) + 4 m and 4 m behind. The table of its parts gives "
    "it one part of theirs at a time.",
    "The six numbers of `arc` were found by a search on these patterns, on starts of other seeds, "
    "and then rounded to simple fractions. They are shares of f(N), so that it has no metres of "
    "its own. The last two tables are of flocks and worlds in which nothing was tuned.",
    "What their description leaves open, and what we did. Their field has no walls; ours has, and "
    "the table without walls shows that it does not matter. On its circle their dog may fly "
    "faster than its 2 m a step, by some 40 % where it flies outwards too; ours keeps its limit. "
    "Their program takes bearings of π and -π for opposite; ours does not. The jitter of their "
    "dog is uniform; ours is normal, with the same SD. The draws of the starts are ours.",
    "They report that Strömbom's model accomplishes 43 of 60 missions on these patterns. That is "
    "no figure to compare with `strombom` here: in theirs the sheep follow Strömbom's forces too, "
    "and the dog stalls.",
)

PAGE = Page(TITLE, INTRODUCTION, FIGURE, CAPTION, NOTES)


def _success(row: Results) -> str:
    low, high = row["success_ci95"]
    return f"{report.share(row['success'])}\n[{100 * low:.0f}, {100 * high:.0f}]"


def _steps(row: Results) -> str:
    return report.figure(row["steps"], ".0f")


def _difference(summary: Results) -> str:
    low, high = summary["ci95"]
    return f"{summary['mean']:+.0f}\n[{low:+.0f}, {high:+.0f}]"


def _names(results: Results) -> list[str]:
    return [name for name in next(iter(results["patterns"].values())) if name != "least"]


def ten_table(results: Results) -> Table:
    """The first ten missions of each pattern, as many as they print of."""
    names = _names(results)
    head = ["first ten missions", "elfiqi, as printed", *names]
    body = []
    for pattern, rows in results["patterns"].items():
        cells = [f"{patterns.PRINTED_CASES} of 10, {patterns.PRINTED[pattern]:.0f}"]
        for name in names:
            ten = rows[name]["first"]
            done = round(ten["success"] * ten["cases"])
            cells.append(f"{done} of {ten['cases']}, {ten['steps']['mean']:.0f}")
        body.append([pattern, *cells])
    return head, body


def success_table(results: Results) -> Table:
    """Success on each pattern."""
    names = _names(results)
    body = [
        [pattern, *(_success(rows[name]) for name in names)]
        for pattern, rows in results["patterns"].items()
    ]
    return ["success", *names], body


def steps_table(results: Results) -> Table:
    """Steps on each pattern, beside theirs and the least."""
    names = _names(results)
    body = [
        [
            pattern,
            f"{rows['least']['mean']:.0f}",
            f"{patterns.PRINTED[pattern]:.0f}",
            *(_steps(rows[name]) for name in names),
        ]
        for pattern, rows in results["patterns"].items()
    ]
    return ["steps", "least", "elfiqi, as printed", *names], body


def difference_table(results: Results) -> Table:
    """Steps less than those of their dog, from the same starts."""
    names = [name for name in _names(results) if name != patterns.THEIR_DOG]
    body = [
        [
            pattern,
            *(_difference(rows[name]["less than theirs"]) for name in names),
        ]
        for pattern, rows in results["patterns"].items()
    ]
    return ["steps, less those of elfiqi", *names], body


def other_table(rows: Results, title: str) -> Table:
    """Success and steps of other missions, a line each."""
    names = list(next(iter(rows.values())))
    body = [
        [
            where,
            *(
                f"{report.share(by[name]['success'])}, " + _steps(by[name]).split("\n")[0]
                for name in names
            ),
        ]
        for where, by in rows.items()
    ]
    return [title, *names], body


def sections(results: Results) -> dict[str, list[Table]]:
    """Every table of the study, by the title of its section."""
    return {
        "Ten missions a pattern, as they report": [ten_table(results)],
        f"{patterns.CASES} missions a pattern": [
            success_table(results),
            steps_table(results),
            difference_table(results),
        ],
        "What each part of arc is worth": [other_table(results["lesser"], "success, steps")],
        "Without walls": [other_table(results["without walls"], "success, steps")],
        "Flocks of other sizes": [
            other_table(
                results["flocks"], f"{patterns.FLOCK_CASES} missions a pattern: success, steps"
            )
        ],
        "In worlds that nothing was tuned in": [
            other_table(results["elsewhere"], f"{patterns.CASES} random starts: success, steps")
        ],
    }


def summary(results: Results) -> RichTable:
    """Steps and success on each pattern, for a terminal."""
    head, body = ten_table(results)
    return terminal(head, body)


def document(results: Results, command: str) -> str:
    """The study as Markdown."""
    return PAGE.markdown(sections(results), command)


def page(results: Results, figure: str, player: str, command: str) -> str:
    """The study as one HTML page; `figure` is inline SVG and `player` a replay as markup."""
    return PAGE.html(sections(results), figure, player, command)
