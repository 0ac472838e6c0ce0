"""The options of a study, spelled once. Free to import."""

from typing import Literal

Starts = Literal["paper", "random"]
"""How starts are drawn, see `skydog.study.cases.cases`; and the fixed sets of them that ship."""
