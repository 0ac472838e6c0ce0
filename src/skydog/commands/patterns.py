"""`skydog reproduce --patterns`: fly El-Fiqi's six patterns."""

from functools import partial
from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.shepherds import rules
from skydog.study import evaluate, patterns, patterns_page, report
from skydog.study.options import Results
from skydog.view import figures, replay
from skydog.view import patterns as drawn
from skydog.world import trace as traces
from skydog.world.mission import Shepherd
from skydog.world.presets import preset
from skydog.world.trace import Trace

SHOWN_STEPS = 300  # of a mission to replay, at most


def run(out: Path, command: str) -> Results:
    """Fly the study into a run folder, and return its results."""
    out = files.folder(out)
    shepherds = {name: rules.read(name)[0] for name in patterns.NAMES}
    # The metrics need the sheep at the start and at the end alone.
    fly = partial(evaluate.fly, every=None)
    results, first = patterns.fly_all(shepherds, fly, console.track)
    report.write(out, results)
    figure = drawn.paths(first, patterns.OURS, patterns.THEIR_DOG)
    figures.save(figure, out / patterns_page.FIGURE)
    files.write_text(out / "patterns.md", patterns_page.document(results, command))
    shown = _first_missions(shepherds[patterns.OURS])
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    page = patterns_page.page(results, figures.svg(figure), replay.player(shown), command)
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


def _first_missions(shepherd: Shepherd) -> dict[str, Trace]:
    """The first mission on each pattern again, the sheep recorded at every step."""
    world = preset("elfiqi2020", sheep=patterns.SHEEP)
    key = evaluate.noise_key(world, patterns.SEED)
    shown = {}
    for pattern in patterns.PATTERNS:
        starts = patterns.cases(world, pattern, 1, patterns.SEED, patterns.SHEEP)
        flown = evaluate.fly(world, shepherd, starts, SHOWN_STEPS, key)
        shown[f"{pattern}-{patterns.OURS}"] = evaluate.one_case(flown, 0)
    return shown
