"""The study of mixed flocks as tables, as Markdown and as a page."""

from rich.table import Table as RichTable

from skydog.study import mixed, report
from skydog.study.options import Results
from skydog.study.page import Page, Table, terminal

TITLE = "Mixed flocks"
FIGURE = "mixed"  # the name of its file, without the suffix
CAPTION = (
    "Missions accomplished, by the share of the flock that is of another kind; the bands are "
    f"Wilson 95 % intervals of {mixed.CASES} missions."
)

INTRODUCTION = (
    "The sheep of a mission need not be alike. `--mix loner=0.2` makes a fifth of a flock sheep of "
    "another kind ([`skydog.world.mixing`](#skydog.world.mixing.mixed)); several kinds are "
    "separated by commas. **stubborn** sheep flee with a tenth of the weight of others. "
    "**short-sighted** ones see a dog at 10 m, the others at 65 m. A **loner** flees, but does not "
    "group. A **noisy** one has the noise 1.0, the others 0.3. A **slow** one moves at half the "
    "speed. A **follower** comes to the dog and does not group (Strömbom et al. 2026). The kinds "
    "are lists of the parameters that each sheep may have its own of; the last sheep of a flock "
    "are those of another kind.",
    f"Here {mixed.SHEEP} sheep are herded in the preset `{mixed.PRESET}`, 150 m × 150 m, from "
    f"{mixed.CASES} random starts, by one dog. All shepherds fly the same starts at the same speed "
    f"limits, for at most {mixed.STEPS:,} steps. The shepherd `rearmost` is ours "
    "([`Rearmost`](#skydog.shepherds.rearmost.Rearmost)).",
)

NOTES = (
    "Why the gate fails with loners: it lets a dog drive only while every sheep is within f(N) of "
    "the flock's centre. A loner flees as far as the dog is seen, 65 m, and nothing brings it "
    "back. A dog that fetches it to the centre flies around it, and drives the others away, loners "
    "on the other side furthest. So the flock is never gathered, and the dog never drives; its "
    "table shows for how long.",
    "What `rearmost` changes: no gate and no centre. Each sheep is driven straight to the goal, "
    "the one with the longest way first, and the dog stands 3/2 f(N) behind it instead of 2 m: "
    "from there it pushes all sheep nearly the same way. Sheep that do not see a dog stand still: "
    "it flies to one that stands, and keeps the distance at which it moved. That is what "
    "short-sighted sheep need. It knows neither the kinds nor the parameters of the sheep.",
    "What it needs: the corner. Whoever flees from a dog into a corner stays there, and so "
    "loners that are home stay home. With the goal at an edge or in the middle no loner is kept, "
    "and one dog does not suffice; flocks without loners it brings there too. A follower stays "
    "with the dog, behind the flock, where this dog never leads it home.",
    "The numbers of `rearmost` (3/2, 1/2 and 4/5) were found on starts of other seeds, with sheep "
    "of these kinds and, more coarsely, with the flocks and worlds of later tables, and rounded. "
    "A gathered flock of 100 it brings home more slowly than `strombom`.",
    "Success has its Wilson 95 % interval. Steps are mean ± SD with the bootstrap 95 % interval of "
    f"the mean; a mission that fails counts with all its {mixed.STEPS:,} steps. The share of 0 is "
    "one set of missions, shown with every kind.",
    "Limited sight (`world.sight`, [`Sight`](#skydog.world.sight.Sight)): a dog sees sheep within "
    "a radius, and within the field of its camera, which turns to where the flock's centre was "
    "last known; a nearer sheep, and an obstacle that the dog has to go around, may hide others. "
    "What one dog sees all know, and what none sees is remembered where it was last seen. At the "
    "start every place is known. These dogs do not search: a sheep that fled out of their sight is "
    "not where they last saw it, and they wait for it there. Sight has to reach as far as sheep "
    "flee, 65 m, and loners leave the field of a camera that looks at the flock's centre.",
    "Habituation (`world.habituation`, a rate per second): while a dog is in sight of a sheep, the "
    "weight of its escape falls by exp(-rate · t), and does not rise again within a mission. That "
    "sheep get used to drones is known (their flight distance fell from 60 m to 10 m in two "
    "trials); the rates are ours. At 0.003 a second fear falls to a sixth in ten minutes.",
)

PAGE = Page(TITLE, INTRODUCTION, FIGURE, CAPTION, NOTES)


def _success(row: Results, name: str = "success") -> str:
    low, high = row[f"{name}_ci95"]
    return f"{report.share(row[name])}\n[{100 * low:.0f}, {100 * high:.0f}]"


def _short(row: Results) -> str:
    return f"{report.share(row['success'])}, " + report.figure(row["steps"], ".0f").split("\n")[0]


def aim_table(results: Results) -> Table:
    """Success at the share that is aimed at, for each kind."""
    names = list(results["shares"]["loner"]["0"])
    body = [
        [kind, *(_success(by_share[f"{mixed.AIM:g}"][name]) for name in names)]
        for kind, by_share in results["shares"].items()
    ]
    return [f"success, {report.share(mixed.AIM)} of another kind", *names], body


def share_tables(results: Results) -> list[Table]:
    """Success and steps of each kind, by share."""
    names = list(results["shares"]["loner"]["0"])
    tables: list[Table] = []
    for kind, by_share in results["shares"].items():
        body = [
            [report.share(float(share)), *(_short(rows[name]) for name in names)]
            for share, rows in by_share.items()
        ]
        tables.append(([f"{kind}: success, steps", *names], body))
    return tables


def soon_table(results: Results) -> Table:
    """Missions accomplished within the steps that `skydog test` gives by itself."""
    names = list(results["shares"]["loner"]["0"])
    body = [
        [kind, *(_success(by_share[f"{mixed.AIM:g}"][name], "soon") for name in names)]
        for kind, by_share in results["shares"].items()
    ]
    return [f"within {mixed.SOON:,} steps, {report.share(mixed.AIM)} of another kind", *names], body


def why_table(results: Results) -> Table:
    """For how long the gate took the flock for gathered, and how many sheep came home."""
    names = list(next(iter(results["why"].values())))
    body = [
        [
            where,
            *(f"{100 * by[name]['gathered']:.1f} %, {by[name]['home']:.1f}" for name in names),
        ]
        for where, by in results["why"].items()
    ]
    return [f"share of the time gathered, sheep home of {mixed.SHEEP}", *names], body


def other_table(rows: Results, title: str) -> Table:
    """Success and steps of other missions, a line each."""
    names = list(next(iter(rows.values())))
    return [title, *names], [
        [where, *(_short(by[name]) for name in names)] for where, by in rows.items()
    ]


def sections(results: Results) -> dict[str, list[Table]]:
    """Every table of the study, by the title of its section."""
    head = "success, steps"
    return {
        f"A fifth of the flock, {mixed.CASES} missions each": [
            aim_table(results),
            soon_table(results),
        ],
        "From no other sheep to no others": share_tables(results),
        "Why loners are not herded, and what is changed": [
            why_table(results),
            other_table(results["lesser"], head),
        ],
        "Flocks of other sizes": [other_table(results["flocks"], head)],
        "Goals elsewhere": [other_table(results["goals"], head)],
        "In other worlds": [other_table(results["elsewhere"], head)],
        "Limited sight": [other_table(results["sight"], head)],
        "Sheep that get used to dogs": [other_table(results["habituation"], head)],
    }


def summary(results: Results) -> RichTable:
    """Success with a fifth of each kind, for a terminal."""
    head, body = aim_table(results)
    return terminal(head, body)


def document(results: Results, command: str) -> str:
    """The study as Markdown."""
    return PAGE.markdown(sections(results), command)


def page(results: Results, figure: str, player: str, command: str) -> str:
    """The study as one HTML page; `figure` is inline SVG and `player` a replay as markup."""
    return PAGE.html(sections(results), figure, player, command)
