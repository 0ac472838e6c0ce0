"""The options of shepherds, spelled once. Free to import."""

from typing import Literal

AtPoint = Literal["constant", "arrive"]
"""What the rule dog does at its point: see `skydog.shepherds.strombom.Strombom`."""

Frame = Literal["folded", "paper"]
"""The axes that a learnt dog sees and flies along: see `skydog.shepherds.frame`."""

ObservationKind = Literal["compact", "full"]
"""What a dog sees: the paper's four numbers, or where everybody is, seen from it."""
