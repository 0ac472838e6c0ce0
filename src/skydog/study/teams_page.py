"""The study of teams as tables and as Markdown."""

from rich.table import Table as RichTable

from skydog.study import report, teams
from skydog.study.options import Results
from skydog.study.page import Page, Table, terminal

TITLE = "Teams of dogs"
FIGURE = "teams"  # the name of its file, without the suffix
CAPTION = "A mission of three dogs with 30 sheep: the paths of sheep and dogs."

INTRODUCTION = (
    "Several dogs herd one flock. The shepherd `team` ([`Team`](#skydog.shepherds.team.Team)) is "
    "for any number of dogs, which know nothing of each other but positions, and all fly by the "
    "same numbers. Seen from the flock, each dog has a sector: it collects its stray, and "
    "drives from behind it. The dog with the shortest way to the back leads; the others go around "
    "the flock at a distance, so that they do not push it away from home. `team:h-ddpg-4x4` is the "
    "same, but its dogs fly with the skills collect and drive of the sheepdog h-ddpg-4x4.",
    f"All fly the same {teams.CASES} random starts in the preset `{teams.PRESET}`, at the same "
    "speed limit. The sheep start at the same places whatever the number of dogs.",
)

NOTES = (
    "Success has its Wilson 95 % interval. Steps are mean ± SD with the bootstrap 95 % interval of "
    f"the mean; a mission that fails counts with all its {teams.STEPS:,} steps.",
    "Most of a mission cannot be shortened by more dogs. The force on a sheep is normalised, so "
    "that more dogs do not push harder. In a gathered flock, grouping and repulsion use up about "
    "a third of each step: it moves some 0.65 m a step, though a sheep can move 1 m. From the mean "
    "start, 150 m from the goal, that alone takes about 200 steps. What a team saves is the time "
    "until a dog stands behind the flock, and what dogs on the goal's side push it back meanwhile.",
    "Dogs of a team never come nearer to each other than one avoidance length, which is 2 m here: "
    "each dog uses at most half of the room between two of them in a step. Dogs that start nearer "
    "do not come nearer still. The other shepherds do not keep apart.",
)

PAGE = Page(TITLE, INTRODUCTION, FIGURE, CAPTION, NOTES)


def _rows(results: Results, cell: str) -> Table:
    body = []
    for sheep, rows in results["flocks"].items():
        for name, by in rows.items():
            body.append([sheep, name, *(_CELLS[cell](by[str(dogs)]) for dogs in teams.DOGS)])
    return ["sheep", "shepherd", *(f"{n} dog{'s' * (n > 1)}" for n in teams.DOGS)], body


def _success(row: Results) -> str:
    low, high = row["success_ci95"]
    return f"{report.share(row['success'])}\n[{100 * low:.0f}, {100 * high:.0f}]"


def _ratio(name: str, row: Results) -> str:
    low, high = row[name]["ci95"]
    return f"{row[name]['mean']:.2f}\n[{low:.2f}, {high:.2f}]"


_CELLS = {
    "steps": lambda row: report.figure(row["steps"], ".0f"),
    "success": _success,
    "share of one rule dog": lambda row: _ratio("share of one rule dog", row),
    "share of one": lambda row: _ratio("share of one", row),
    "nearest": lambda row: "—" if row["nearest"] is None else f"{row['nearest']:.2f} m",
}


def sections(results: Results) -> dict[str, Table]:
    """Every table of the study, by the title of its section."""
    return {
        "Steps": _rows(results, "steps"),
        "Steps, as a share of one rule dog's": _rows(results, "share of one rule dog"),
        "Steps, as a share of one dog's of the same shepherd": _rows(results, "share of one"),
        "Success": _rows(results, "success"),
        "The nearest that two dogs came to each other": _rows(results, "nearest"),
    }


def summary(results: Results) -> RichTable:
    """Steps by flock, shepherd and dogs, for a terminal."""
    head, body = _rows(results, "steps")
    return terminal(head, body, names=2)


def document(results: Results, command: str) -> str:
    """The study as Markdown."""
    return PAGE.markdown({title: [table] for title, table in sections(results).items()}, command)
