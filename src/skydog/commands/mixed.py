"""`skydog reproduce --mixed`: fly mixed flocks."""

from functools import partial
from pathlib import Path

from skydog import files
from skydog.commands import console
from skydog.shepherds import rules
from skydog.study import cases, evaluate, mixed, mixed_page, report
from skydog.study.options import Results
from skydog.view import figures, replay
from skydog.view import mixed as drawn
from skydog.world import trace as traces
from skydog.world.mission import Shepherd
from skydog.world.trace import Trace

SHOWN_STEPS = 1000  # of a mission to replay, at most


def run(out: Path, command: str) -> Results:
    """Fly the study into a run folder, and return its results."""
    out = files.folder(out)
    shepherds = {name: rules.read(name)[0] for name in mixed.NAMES}
    # The metrics need the sheep at the start and at the end alone.
    fly = partial(evaluate.fly, every=None)
    results = mixed.fly_all(shepherds, fly, console.track)
    report.write(out, results)
    figure = drawn.shares(results["shares"])
    figures.save(figure, out / mixed_page.FIGURE)
    files.write_text(out / "mixed.md", mixed_page.document(results, command))
    shown = _first_missions({name: shepherds[name] for name in (mixed.OURS, mixed.THEIRS)})
    for name, trace in shown.items():
        traces.save(out / "traces" / f"{name}.safetensors", trace, name)
    page = mixed_page.page(results, figures.svg(figure), replay.player(shown), command)
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


def _first_missions(shepherds: dict[str, Shepherd]) -> dict[str, Trace]:
    """The first mission with loners again, the sheep recorded at every step."""
    world = mixed.world("loner", mixed.AIM)
    starts = cases.cases(world, 1, "random", mixed.SEED, mixed.SHEEP)
    key = evaluate.noise_key(world, mixed.SEED)
    flown = {
        name: evaluate.fly(world, shepherd, starts, SHOWN_STEPS, key)
        for name, shepherd in shepherds.items()
    }
    return {f"loners-{name}": evaluate.one_case(trace, 0) for name, trace in flown.items()}
