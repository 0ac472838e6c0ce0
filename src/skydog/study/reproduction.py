"""What the study of the paper shows: as one page, and as a document of its claims."""

from html import escape
from typing import Any

from skydog.study import report, transfer
from skydog.study.claims import ALL_SCALES, FOLDED, ONE_SCALE
from skydog.study.report import METRICS, Row, figure, html_table, markdown_table, share

# The lines of the transfer study.
SCALED = "H-DDPG-4x4 through ξ"
UNSCALED = "H-DDPG-4x4, unscaled"
NATIVE = "taught in that arena"
ALL_SEEDS = {
    FOLDED: "H-DDPG-4x4",
    ALL_SCALES: "H-DDPG-4x4-paper-frame",
    ONE_SCALE: "H-DDPG-4x4-one-scale-paper-frame",
}

FIGURES = {  # by caption: the name of its file
    "The 15th case in 6 × 6, flown by each shepherd": "trajectories",
    "From one arena to another: 30 cases in each, with 95 % intervals": "transfer",
    "Learning curves: reward per action, the running mean of 100 episodes (thin line: every 10), "
    "mean and SD over the seeds, lessons and reward as ours": "learning_curves",
    "The same with the paper's lessons and reward, at most 0.1, for as many steps; episodes grow "
    "long, and so are few, and the running mean is of a tenth of them": "learning_curves_paper",
}
MORE = {"steps": ".0f", "steps_gcm": ".0f", "distance": ".1f"}

NOTES = (
    "All shepherds fly the same cases. But where a name says otherwise, all may fly ±1 m/s on each "
    "axis: the rule dog and H-DDPG up to 1.4 m/s along the diagonal, DHRL, whose steps are "
    "axis-parallel, 1 m/s. In the paper's tables its rule dog flies 0.81 m/s, its H-DDPG 0.97 to "
    "1.06: rows named 0.81 m/s are the rule dog at that speed, and rows named 1 m/s have everyone "
    "at 1 m/s in any direction.",
    "A mission that fails counts with all 1000 steps. Steps last until every sheep is home and the "
    "flock gathered; steps (GCM), which the paper counts, until the flock's centre is home; the "
    "ratio is to the fewest that any shepherd could need: the dog flies straight to where the "
    "first sheep sees it, unless two sheep touch; then the sheep that starts furthest out moves "
    "straight home. The best known are missions that a planner found which knows everything, in "
    "minutes of search: upper bounds of the fewest steps, not proven to be the fewest.",
    "The paper does not print its start layouts. The 30 cases here are ours, with the three sheep "
    "at fixed places and the drone's start drawn; in the 1,000 random ones the sheep are drawn "
    "too. So a difference from the paper's figures may come from the starts.",
    "Intervals are of 95 %: bootstrap (BCa) for means, Wilson's for shares of success. Missions of "
    "several seeds are counted together as if they were independent, although they share their "
    "starts: intervals of “all seeds” are somewhat too narrow.",
    "Of several seeds, the one that flies needs the fewest steps for 200 other cases drawn as the "
    "30 are and 200 drawn as the random ones: the 4 × 4 H-DDPG in all arenas of the transfer "
    "study, the others where the paper flies them. The study's own cases have no say in it.",
    "Sheepdogs see in the folded frame: the symmetries of the square turn every direction into one "
    "eighth of them, and a quarter of the lessons draw the goal, or the sheep to collect, "
    "anywhere. Rows of the paper's frame have the world's own axes and lessons with the goal at "
    "(0, 0). In the tables of the paper's scenarios the furthest stray is collected first, as in "
    "the paper; in those of goals, starts, flocks and noise the stray at hand, but where a name "
    "says otherwise.",
)
# How the tables of `robustness` are called.
ROBUSTNESS = {
    "goals": "Any goal: 1,000 random starts for each",
    "starts": "Any start: sheep anywhere, 2,000 missions; in three corners, 1,000",
    "flocks": "Any flock: 1,000 random starts, arenas that grow as the flock",
    "noise": "With noise: 1,000 random starts",
}


def rows(results: dict[str, Any]) -> list[Row]:
    """The paper's eight scenarios, for a table."""
    return [
        Row(name, row["ours"], row["paper"], row["verdict"].replace(", ", ",\n"))
        for name, row in results["rows"].items()
    ]


def page(results: dict[str, Any], figures: dict[str, str], player: str, command: str) -> str:
    """The report: every table, figure and claim in one HTML page; `figures` are inline SVG."""
    shown = {title: figures[file] for title, file in FIGURES.items()}
    sections = {
        "The eight scenarios": html_table(*_eight(results))
        + f'<p class="quiet">{report.HOW_TO_READ}</p>',
        "What the verdicts mean": "<ul>"
        + "".join(f"<li>{escape(rule)}</li>" for rule in results["rules"])
        + "</ul>",
        "What reproduces": "".join(
            f"<h3>{escape(claim['title'])}: {claim['verdict']}</h3>"
            f"<p><em>{escape(claim['says'])}</em></p><p>{escape(claim['found'])}</p>"
            for claim in results["claims"]
        ),
        "Figures": report.figures_html(shown),
        "All seven metrics": html_table(*_metrics(results["rows"])),
        "On 1,000 random starts": html_table(*_random(results["rows"])),
        "More rules, frames and speeds": html_table(*_others(results)),
        "How near to the best known": html_table(*_best(results)),
        "Against the rule dog on the same cases": html_table(*_differences(results)),
        "From one arena to another": html_table(*_transfer(results["transfer"])),
        **{
            title: html_table(*_robustness(results["robustness"][name]))
            for name, title in ROBUSTNESS.items()
        },
        "Is it luck? Every seed": html_table(*_seeds(results["seeds"])),
        "Replay": player,
        "Notes": "".join(f"<p>{escape(note)}</p>" for note in NOTES),
    }
    return report.document(
        "The paper's simulation study",
        "<p>Every scenario of Nguyen et al. 2020 (arXiv 2004.11543), section “Evaluation in "
        f"Simulation”, flown and measured. Made by <code>{escape(command)}</code>.</p>"
        + "".join(f"<h2>{name}</h2>{body}" for name, body in sections.items()),
    )


def document(results: dict[str, Any], command: str) -> str:
    """What reproduces and what does not: Markdown, one paragraph a claim."""
    lines = [
        "# What reproduces and what does not",
        "",
        f"Made by `{command}`, which writes a report with the figures too. The claims are those of "
        "Nguyen et al. 2020 (arXiv 2004.11543), section “Evaluation in Simulation”. The "
        "[glossary](glossary.md) explains the words.",
        "",
        "## What the verdicts mean",
        "",
        *(f"- {rule}" for rule in results["rules"]),
        "",
    ]
    for claim in results["claims"]:
        lines += [f"## {claim['title']}: {claim['verdict']}", ""]
        lines += [f"> {claim['says']}", "", claim["found"], ""]
    tables = {
        "The eight scenarios": _eight(results),
        "All seven metrics": _metrics(results["rows"]),
        "On 1,000 random starts": _random(results["rows"]),
        "More rules, frames and speeds": _others(results),
        "How near to the best known": _best(results),
        "Against the rule dog on the same cases": _differences(results),
        "From one arena to another": _transfer(results["transfer"]),
        **{title: _robustness(results["robustness"][name]) for name, title in ROBUSTNESS.items()},
        "Is it luck? Every seed": _seeds(results["seeds"]),
    }
    lines += [line for title, file in FIGURES.items() for line in (f"![{title}]({file}.png)", "")]
    for title, (head, body) in tables.items():
        lines += [f"## {title}", "", markdown_table(head, body)]
    lines += ["## How to read this", "", report.HOW_TO_READ, ""]
    for note in NOTES:
        lines += [note, ""]
    return "\n".join(lines)


Table = tuple[list[str], list[list[str]]]


def _eight(results: dict[str, Any]) -> Table:
    head = [*report.COLUMNS, "verdict"]
    return head, [[*report.cells(row), row.verdict or ""] for row in rows(results)]


def _metrics(by_name: dict[str, Any]) -> Table:
    head = ["scenario", "success", *(title for title, _ in METRICS.values())]
    body = [
        [
            name,
            _success(row["ours"]),
            *(figure(row["ours"][metric], form) for metric, (_, form) in METRICS.items()),
        ]
        for name, row in by_name.items()
    ]
    return head, body


def _random(by_name: dict[str, Any]) -> Table:
    head = ["scenario", "success", "steps", "steps, as a ratio to the least", "distance (m)"]
    return head, [[name, *_short(row["random"])] for name, row in by_name.items()]


def _others(results: dict[str, Any]) -> Table:
    head = [
        "scenario",
        "success",
        "steps",
        "steps, as a ratio to the least",
        "steps (GCM)",
        "distance (m)",
        "verdict",
    ]
    everything = results["rows"] | results["others"]
    body = []
    for name, row in everything.items():
        *steps, distance = _short(row["ours"])
        centre = figure(row["ours"]["steps_gcm"], ".0f")
        body.append([name, *steps, centre, distance, row.get("verdict", "—")])
    return head, body


def _best(results: dict[str, Any]) -> Table:
    head = [
        "steps, as times the best known",
        "30 cases",
        "200 random starts",
        "30 cases, as a ratio to the least",
    ]
    everything = results["rows"] | results["others"]
    return head, [
        [
            name,
            *(figure(row["times_best"].get(starts), ".3f") for starts in ("paper", "random")),
            figure(row["ours"]["steps_ratio"], ".2f"),
        ]
        for name, row in everything.items()
        if row["times_best"]
    ]


def _differences(results: dict[str, Any]) -> Table:
    head = ["scenario", "steps more", "steps (GCM) more", "metres more"]
    everything = results["rows"] | results["others"]
    body = [
        [name, *(figure(row["more_than_strombom"][metric], form) for metric, form in MORE.items())]
        for name, row in everything.items()
        if "more_than_strombom" in row
    ]
    return head, body


def _transfer(lines: dict[str, Any]) -> Table:
    head = ["success / steps", *(f"{arena:g} m" for arena in transfer.ARENAS)]
    body = [
        [
            name,
            *(
                f"{share(by[arena]['success'])}\n{by[arena]['steps']['mean']:.0f}"
                if arena in by
                else "—"
                for arena in (f"{arena:g}" for arena in transfer.ARENAS)
            ),
        ]
        for name, by in lines.items()
    ]
    return head, body


def _robustness(rows: dict[str, Any]) -> Table:
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    head = ["success, and steps", *columns]
    return head, [
        [name, *(_cell(row[column]) if column in row else "—" for column in columns)]
        for name, row in rows.items()
    ]


def _cell(row: dict[str, Any]) -> str:
    low, high = row["success_ci95"]
    interval = f"[{100 * low:.2f}, {100 * high:.2f}]"
    return f"{share(row['success'])}, {figure(row['steps'], '.0f').split(chr(10))[0]}\n{interval}"


def _seeds(kinds: dict[str, Any]) -> Table:
    head = ["sheepdog", "success", "steps", "steps, as a ratio to the least", "distance (m)"]
    body = [
        [f"{name}, seed {seed}" + " (flies)" * (seed == kind["chosen"]), *_short(row)]
        for name, kind in kinds.items()
        for seed, row in enumerate(kind["rows"])
    ]
    return head, body


def _short(row: dict[str, Any]) -> list[str]:
    return [
        _success(row),
        figure(row["steps"], ".0f"),
        figure(row["steps_ratio"], ".2f"),
        figure(row["distance"], ".1f"),
    ]


def _success(row: dict[str, Any]) -> str:
    low, high = row["success_ci95"]
    return f"{share(row['success'])} of {row['cases']:,}\n[{100 * low:.1f}, {100 * high:.1f}]"
