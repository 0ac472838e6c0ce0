"""The paper's own numbers, as printed, by the names of its scenarios."""

from typing import Any

PAPER = "Nguyen et al. 2020, arXiv 2004.11543"


Printed = tuple[float | int, float | int]  # mean and SD


def _row(steps: Printed, distance: Printed, success: float | int) -> Any:
    return {
        "success": success / 100.0,
        "steps": {"mean": steps[0], "sd": steps[1]},
        "distance": {"mean": distance[0], "sd": distance[1]},
    }


# Tables "Averages and standard deviations of number of steps, travelled distance, and
# success rates" in the 4 × 4 and the 6 × 6 environment: 30 cases each. Steps are those at
# which the flock's centre arrived; distance is in metres.
PRINTED: dict[str, Any] = {
    "Strombom-4x4": _row((135, 119), (11, 9.3), 96.67),
    "DHRL-4x4": _row((107, 16), (8.3, 1.2), 100),
    "H-DDPG-4x4": _row((100, 16), (9.7, 1.5), 100),
    "Strombom-6x6": _row((187, 21), (15.2, 1.8), 96.67),
    "DHRL-6x6": _row((224, 32), (16.9, 2.4), 100),
    "DHRL-4x4to6x6": _row((206, 29), (15.9, 2.3), 100),
    "H-DDPG-6x6": _row((188, 44), (19.9, 5.4), 100),
    "H-DDPG-4x4to6x6": _row((205, 20), (16.7, 1.8), 100),
}
