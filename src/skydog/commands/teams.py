"""`skydog reproduce --teams`: several dogs beside one."""

from functools import partial
from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.shepherds import rules
from skydog.study import evaluate, report, teams, teams_page
from skydog.study.options import Results
from skydog.view import figures
from skydog.world import trace as traces


def run(out: Path, command: str) -> Results:
    """Fly the study into a run folder, and return its results."""
    out = files.folder(out)
    shepherds = {name: rules.read(name)[0] for name in teams.NAMES}
    # The metrics need the sheep at the start and at the end alone.
    fly = partial(evaluate.fly, every=None)
    results, shown = teams.fly_all(shepherds, fly, console.track)
    report.write(out, results)
    figures.save(figures.trajectories({"team": shown}), out / teams_page.FIGURE)
    traces.save(out / "traces" / "team.safetensors", shown, "team")
    files.write_text(out / "teams.md", teams_page.document(results, command))
    console.say(f"Everything is in {out}; see {out / 'teams.md'}.")
    return results
