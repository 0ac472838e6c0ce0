"""`skydog fit`: fit a flock's parameters to tracks of sheep and dogs."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from skydog import files
from skydog.commands.flags import Json, MaybeStep, Out, Seed, Tracks
from skydog.errors import Refusal

if TYPE_CHECKING:
    from skydog.study.options import Track
    from skydog.study.tracks import Event

STEP = 0.5  # seconds: sheep turn within less, and tags are off by centimetres


def fit(
    tracks: Positional[Tracks],
    out: Out = Path("runs/fit"),
    step: MaybeStep = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Fit a flock's parameters to tracks of sheep and dogs.

    Finds the radii and weights by which the flock's law best predicts where each sheep moves in
    the next step. Prints them with 95 % intervals; and how well they predict events that were
    held out, beside sheep that just go on (persistence) and Strömbom's weights. Writes a run
    folder with results.json, a figure, and world.json, a world that the other commands fly with
    --world.

    The tracks are a CSV file with the columns event,time,kind,id,x,y: seconds, metres, and sheep
    or dog for the kind; an event is one occasion, such as a trial. The open data of Jadhav et al.
    2024 is read too: sheepR.dat, or drives_data.mat. See docs/fit.md.

    Example: skydog fit tracks.csv --out runs/mine

    Args:
        tracks: A file of tracks.
        out: The run folder.
        step: Seconds of a step of the fitted law; if not given 0.5, or what lies between two
            instants of the tracks, if that is more.
        seed: Random seed of the bootstrap.
        as_json: Print the results as JSON instead of tables.
    """
    from skydog.commands import console
    from skydog.study import fit_report, report
    from skydog.study import tracks as reading

    with files.claimed(out):
        if files.exists(out / report.RESULTS):
            raise Refusal(f"{out} holds results already; choose another --out")
        found = run(reading.read(tracks), step, seed, out, console.track)
    if as_json:
        print(json.dumps(files.plain(found), indent=2))
        return 0
    for table in (fit_report.parameters_table(found), fit_report.errors_table(found)):
        console.print_table(table)
    for note in found["notes"]:
        console.say(note)
    console.say(f"Fly it: skydog test strombom --world {out / 'world.json'} --starts random")
    return 0


def run(
    events: "list[Event]", step: float | None, seed: int, out: Path, track: "Track"
) -> dict[str, Any]:
    """Fit, judge and write everything to a run folder; return the figures."""
    from skydog.study import fit_report, fitting, report, tracks
    from skydog.view import figures, headings
    from skydog.world import loading

    interval = tracks.interval(events)
    step = max(STEP, interval) if step is None else step
    if step < 0.999 * interval:
        raise Refusal(
            f"a step of {step:g} s is shorter than the {interval:g} s between two instants of "
            f"these tracks; try --step {interval:g}"
        )
    windows = tracks.windows(tracks.parts(events), step, fitting.HORIZON + 2)
    errors = fitting.held_out(windows, step, track)
    fitted = fitting.fit_all(windows, step, track, seed)
    found = fit_report.results(fitted, errors, windows, step)
    report.write(out, found)
    loading.write(
        out / "world.json", fitting.world(fitted, windows, step), found["tracks"]["sheep"]
    )
    figures.save(headings.heading_errors(found), out / "heading_error")
    return found
