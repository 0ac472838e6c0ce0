import io
import re
from html import unescape

import pytest
from rich.console import Console

from skydog.study import report
from skydog.study.report import Row

OURS = {
    "success": 29 / 30,
    "cases": 30,
    "steps": {"mean": 104.4, "sd": 25.3, "ci95": [96.2, 113.9]},
    "steps_gcm": {"mean": 87.7, "sd": 24.3, "ci95": [79.6, 97.2]},
    "distance": {"mean": 11.87, "sd": 2.88, "ci95": [10.94, 12.96]},
}
PAPER = {
    "success": 1.0,
    "steps": {"mean": 100, "sd": 16},
    "distance": {"mean": 9.7, "sd": 1.5},
}
WORDS = [
    "H-DDPG-4x4",
    "96.67 % of 30",
    "104 ± 25 [96, 114]",
    "88 ± 24 [80, 97]",
    "11.9 ± 2.9 [10.9, 13.0]",
    "100 %",
    "100 ± 16",
    "9.7 ± 1.5",
]


def in_terminal(rows, width=200):
    """The rows of the table as a terminal shows them: a cell's lines joined again."""
    shown = io.StringIO()
    Console(width=width, file=shown).print(report.table(rows))
    return shown.getvalue()


def in_markdown(rows):
    _, _, *lines = report.markdown(rows).splitlines()
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]


def in_html(rows):
    page = report.report(rows, {}, {}, "skydog reproduce", [])
    body = page.partition("<tbody>")[2].partition("</tbody>")[0]
    return [
        [unescape(re.sub(r"<[^>]+>", "", cell.replace("<br>", " "))) for cell in found]
        for found in (re.findall(r"<td>(.*?)</td>", row) for row in body.split("</tr>")[:-1])
    ]


def test_terminal_html_and_markdown_show_the_same_figures():
    row = Row("H-DDPG-4x4", OURS, PAPER)
    assert in_markdown([row]) == in_html([row]) == [WORDS]
    lines = [" ".join(line.split()) for line in in_terminal([row]).splitlines()]
    assert "H-DDPG-4x4 96.67 % 104 ± 25 88 ± 24 11.9 ± 2.9 100 ± 16 steps" in lines
    assert "of 30 [96, 114] [80, 97] [10.9, 13.0] 9.7 ± 1.5 m" in lines


def test_a_scenario_that_the_paper_lacks_shows_dashes():
    cells = in_markdown([Row("mine", OURS)])[0]
    assert cells[:5] == ["mine", *WORDS[1:5]]
    assert cells[5:] == ["—"] * 3


def test_what_was_not_measured_or_printed_shows_a_dash():
    cells = in_html([Row("part", {"success": 1.0}, {"steps": {"mean": 100}})])[0]
    assert cells == ["part", "100 %", "—", "—", "—", "—", "100", "—"]


def test_every_figure_is_whole_in_a_terminal_of_80_columns():
    shown = in_terminal([Row("H-DDPG-4x4to6x6", OURS, PAPER)], width=80)
    for word in " ".join(WORDS[1:]).split():
        assert re.search(rf"(^|\s){re.escape(word)}(\s|$)", shown), word
    assert "H-DDPG-4x4to6x6" in shown
    assert "…" not in shown


@pytest.mark.parametrize("name", ["a|b", "<script>x", "[bold]b", "{{body}}"])
def test_a_scenario_may_have_any_name(name):
    row = Row(name, OURS)
    assert in_html([row])[0][0] == name
    assert in_markdown([row])[0][0] == name.replace("|", "\\|")
    assert name in in_terminal([row])


def test_a_report_holds_command_figures_player_and_notes_and_text_stays_text():
    page = report.report(
        [Row("H-DDPG-4x4", OURS, PAPER)],
        {"Replay": "<section id='player'></section>"},
        {"Paths": {"paths & <b>ends</b>": "<svg id='paths'></svg>"}},
        "skydog reproduce --out <here>",
        ["starts are <ours>"],
    )
    assert "<code>skydog reproduce --out &lt;here&gt;</code>" in page
    assert "<svg id='paths'></svg><figcaption>paths &amp; &lt;b&gt;ends&lt;/b&gt;" in page
    assert "<section id='player'></section>" in page
    assert "starts are &lt;ours&gt;" in page


def test_a_report_refers_to_nothing_outside_itself():
    page = report.report([Row("H-DDPG-4x4", OURS, PAPER)], {}, {}, "make herd", [])
    assert not re.search(r"https?:|\bsrc=|\bhref=|@import|url\(", page)


def test_a_section_without_content_has_no_heading():
    page = report.report([Row("H-DDPG-4x4", OURS)], {}, {}, "make herd", [])
    assert re.findall(r"<h2>(\w+)</h2>", page) == ["Results"]
