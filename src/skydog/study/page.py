"""A study as a page: its introduction, figure, sections and notes, as Markdown and as HTML."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable

from skydog.study import report

Table = tuple[list[str], list[list[str]]]
"""The head of a table, and its lines."""


@dataclass(frozen=True)
class Page:
    """What a study's page says besides its tables. `figure` is the file's name, without suffix."""

    title: str
    introduction: Sequence[str]
    figure: str
    caption: str
    notes: Sequence[str]

    def markdown(self, sections: dict[str, list[Table]], command: str) -> str:
        """The page for the docs: tables by the title of their section. `command` made it."""
        lines = [f"# {self.title}", "", f"Made by `{command}`.", ""]
        for paragraph in self.introduction:
            lines += [paragraph, ""]
        lines += [f"![{self.caption}]({self.figure}.png)", "", f"*{self.caption}*", ""]
        for title, tables in sections.items():
            lines += [f"## {title}", ""]
            lines += [report.markdown_table(*table) for table in tables]
        lines += ["## How to read this", ""]
        for note in self.notes:
            lines += [note, ""]
        return "\n".join(lines)

    def html(self, sections: dict[str, list[Table]], figure: str, player: str, command: str) -> str:
        """The page as one file; `figure` is inline SVG and `player` a replay as markup."""
        parts = {
            title: "".join(report.html_table(*table) for table in tables)
            for title, tables in sections.items()
        }
        parts["Figure"] = report.figures_html({self.caption: figure})
        parts["Replay"] = player
        parts["Notes"] = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return report.document(
            self.title,
            f"<p>Made by <code>{escape(command)}</code>.</p>"
            + "".join(f"<h2>{escape(title)}</h2>{body}" for title, body in parts.items()),
        )


def terminal(head: list[str], body: list[list[str]], names: int = 1) -> RichTable:
    """A table for a terminal. The first `names` columns are text, the others numbers."""
    drawn = RichTable(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for number, name in enumerate(head):
        justify = "left" if number < names else "right"
        drawn.add_column(name, justify=justify, overflow="fold")
    for cells in body:
        drawn.add_row(*cells)
    return drawn
