"""The options of flight, spelled once. Free to import."""

from typing import Literal

Steering = Literal["reference", "track", "turn"]
"""How rovers obey a force.

`reference` and `track` integrate it to a set-point and follow that (`rovers.track`). Of `reference`
the set-points are the flock: everything is decided on them, and rovers follow within their leash.
Of `track` the flock is where the rovers are seen. `turn` turns to the force and drives
(`rovers.turn_then_drive`), as the paper reads.
"""
