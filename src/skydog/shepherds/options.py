"""The options of shepherds, spelled once. Free to import."""

from typing import Literal

AtPoint = Literal["constant", "arrive"]
"""What the rule dog does at its point: see `skydog.shepherds.strombom.Strombom`."""

Frame = Literal["folded", "paper"]
"""The axes that a learnt dog sees and flies along: see `skydog.shepherds.frame`."""
