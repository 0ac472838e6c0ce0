"""How our figures look, whatever other programs have told matplotlib."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.edgecolor": "#444444",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "svg.hashsalt": "skydog",  # the same figure is the same file
}


@contextmanager
def drawing() -> Iterator[None]:
    """Figures that are made and drawn here have our style; those of others keep theirs."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield
