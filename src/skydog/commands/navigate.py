"""`skydog reproduce --navigate`: fly with a map, with eyes and with neither."""

from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.study import navigate, navigate_page, report
from skydog.study.options import Results


def run(out: Path, command: str) -> Results:
    """Fly the study into a run folder, and return its results."""
    out = files.folder(out)
    results = navigate.fly_all(console.track)
    report.write(out, results)
    files.write_text(out / "navigate.md", navigate_page.document(results, command))
    console.say(f"Everything is in {out}.")
    return results
