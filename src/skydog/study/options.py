"""The options of a study, spelled once, and what its parts hand to each other. Free to import."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal

Starts = Literal["paper", "random", "anywhere"]
"""How starts are drawn, see `skydog.study.cases.cases`."""

FlyableStarts = Literal["paper", "spaced"]
"""How starts for bodies with physics are drawn: as `paper` or `random`, until they can be flown."""

ShippedStarts = Literal["paper", "random"]
"""The sets of starts that ship as fixed cases, see `skydog.study.cases.shipped`."""

PAPER_FRAME = "-paper-frame"
"""How the name of a sheepdog of the paper's frame ends."""

Results = dict[str, Any]
"""Figures by name, as plain data."""

Progress = Callable[[int, int], None]
"""Is told the step of runs that are herded together, and how many are over by then."""

Track = Callable[[str, Iterable[Any]], Iterator[Any]]
"""Goes through things, and shows under a title how many are done."""
