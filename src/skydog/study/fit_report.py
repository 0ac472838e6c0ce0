"""What a fit found: as plain figures, and as tables."""

from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from skydog.study import fitting
from skydog.study.fitting import Fitted
from skydog.study.options import Results
from skydog.study.tracks import Windows

MEANS = {
    "avoidance": "R_ππ (m): sheep nearer than this push each other",
    "sensing": "R_πβ (m): a sheep sees a dog nearer than this",
    "inertia": "weight of the step before",
    "grouping": "weight of the pull to the flock",
    "escape": "weight of the push from dogs",
    "repulsion": "weight of the push from sheep",
    "alignment": "weight of the flock's direction",
    "noise": "weight of chance",
    "graze": "chance a step that an idle sheep moves",
    "speed": "m/s of a sheep that moves",
}
CAPTION = (
    "In brackets: 95 % intervals, by a bootstrap over events. Only the ratios of weights can be "
    "known; their sum is set to Strömbom's 4.55."
)
ERRORS_CAPTION = (
    "Heading error 1 - cos on events that were held out, in three folds: 0 is right, 1 a right "
    "angle, 2 the opposite."
)


def results(
    fitted: Fitted, errors: dict[str, list[list[float]]], windows: Windows, step: float
) -> Results:
    """The figures of a fit: of the tracks, each parameter, and each way to predict."""
    values = {**vars(fitted.flock), "speed": fitted.speed}
    persistence = np.array(errors["persistence"])
    return {
        "tracks": {
            "events": len(np.unique(windows.event)),
            "instants": len(windows.sheep),
            "sheep": windows.sheep.shape[2],
            "dogs": windows.dogs.shape[2],
            "step_s": step,
        },
        "parameters": {
            name: {"value": values[name], "ci95": list(fitted.intervals[name])}
            for name in fitting.PARAMETERS
        },
        "ahead_s": [step * (number + 1) for number in range(fitting.HORIZON)],
        "heading_error": {
            name: {
                "folds": folds,
                "mean": np.mean(folds, axis=0).tolist(),
                "below_persistence": (1.0 - np.array(folds) / persistence)[:, 0].tolist(),
            }
            for name, folds in errors.items()
        },
        "notes": _notes(fitted, windows),
    }


def parameters_table(found: Results) -> Table:
    """The fitted parameters, beside Strömbom's, for a terminal."""
    table = _table(CAPTION, "parameter", "fitted", "Strömbom 2014", "is")
    for name, each in found["parameters"].items():
        low, high = each["ci95"]
        theirs = {"noise": 0.3, "graze": 0.05, "alignment": 0.0, "speed": 1.0}
        usual = theirs.get(name, getattr(fitting.STROMBOM, name, None))
        shown = f"{each['value']:#.3g} [{low:#.3g}, {high:#.3g}]"
        table.add_row(name, shown, f"{usual:g}", MEANS[name])
    return table


def errors_table(found: Results) -> Table:
    """The heading errors one step ahead, for a terminal."""
    ahead = f"{found['ahead_s'][0]:g} s ahead"
    table = _table(ERRORS_CAPTION, ahead, "fold 1", "fold 2", "fold 3", "below persistence")
    for name, each in found["heading_error"].items():
        below = [f"{100 * share:.0f}" for share in each["below_persistence"]]
        shown = "" if name == "persistence" else f"{', '.join(below)} %"
        table.add_row(name, *(f"{fold[0]:.3f}" for fold in each["folds"]), shown)
    return table


def _table(caption: str, *columns: str) -> Table:
    table = Table(
        box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0), caption=caption,
        caption_justify="left",
    )  # fmt: skip
    for name in columns:
        table.add_column(name, overflow="fold")
    return table


def _notes(fitted: Fitted, windows: Windows) -> list[str]:
    """What the tracks cannot tell."""
    away = np.linalg.norm(windows.sheep[:, 1, :, None] - windows.dogs[:, 1, None], axis=-1)
    furthest = float(np.percentile(away.min(axis=-1), 99))
    notes: list[Any] = []
    if fitted.flock.sensing > furthest:
        notes.append(
            f"No sheep was further than {furthest:.3g} m from a dog, as good as: sensing is that "
            "much or more."
        )
    return notes
