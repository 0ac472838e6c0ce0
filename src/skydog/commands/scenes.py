"""`skydog reproduce --scenes`: fly the scenes, around their obstacles and straight on."""

from functools import partial
from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.shepherds import rules
from skydog.study import evaluate, report, scenes, scenes_page
from skydog.study.options import Results
from skydog.view import figures, replay
from skydog.view import scenes as drawn
from skydog.world import trace as traces


def run(out: Path, command: str) -> Results:
    """Fly the study into a run folder, and return its results."""
    out = files.folder(out)
    shepherds = {name: rules.read(name)[0] for name in scenes.NAMES}
    # The metrics need the sheep at the start and at the end alone.
    fly = partial(evaluate.fly, every=None)
    results, shown = scenes.fly_all(shepherds, fly, console.track)
    report.write(out, results)
    figure = drawn.paths(shown)
    figures.save(figure, out / scenes_page.FIGURE)
    files.write_text(out / "obstacles.md", scenes_page.document(results, command))
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    page = scenes_page.page(results, figures.svg(figure), replay.player(shown), command)
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results
