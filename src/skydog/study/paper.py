"""The paper's simulation study as data: its eight scenarios, and what it printed for each."""

from dataclasses import dataclass
from typing import Any, Literal

PAPER = "Nguyen et al. 2020, arXiv 2004.11543"
CASES = 30

Printed = tuple[float | int, float | int]  # mean and SD


@dataclass(frozen=True)
class Scenario:
    """A shepherd, the arena it learnt in, if it learnt, and the one it is flown in, in metres."""

    shepherd: Literal["Strombom", "DHRL", "H-DDPG"]
    learnt: int | None
    flown: int


# Table "Testing scenarios on 4 × 4 and 6 × 6 environments".
SCENARIOS = {
    "Strombom-4x4": Scenario("Strombom", None, 4),
    "DHRL-4x4": Scenario("DHRL", 4, 4),
    "H-DDPG-4x4": Scenario("H-DDPG", 4, 4),
    "Strombom-6x6": Scenario("Strombom", None, 6),
    "DHRL-6x6": Scenario("DHRL", 6, 6),
    "DHRL-4x4to6x6": Scenario("DHRL", 4, 6),
    "H-DDPG-6x6": Scenario("H-DDPG", 6, 6),
    "H-DDPG-4x4to6x6": Scenario("H-DDPG", 4, 6),
}


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

# Its rule dog was slower than its learners, which the paper does not say: m/s, from its
# tables, metres over steps of 0.1 s in both arenas (11 / 13.5 and 15.2 / 18.7).
STROMBOM_SPEED = 0.81


def _physical(
    steps: Printed, distance: Printed, error: Printed, subgoal: Printed, target: Printed
) -> Any:
    names = ("steps_gcm", "distance", "error_per_step", "dog_to_subgoal", "centre_to_target")
    figures = (steps, distance, error, subgoal, target)
    return {
        "success": 1.0,
        **{name: {"mean": mean, "sd": sd} for name, (mean, sd) in zip(names, figures, strict=True)},
    }


# Table "Averages and standard deviations of number of steps, travelled distance, cumulative error
# and success rates of three testing cases of the four setups": NS, TD, EPS, DS, CT; metres.
PHYSICAL: dict[str, Any] = {
    "H-DDPG-6x6-Sim": _physical((505, 23), (17.4, 1.4), (0.026, 0.003), (0.63, 0.03), (0.006, 0.0)),
    "H-DDPG-4x4to6x6-Sim": _physical(
        (533, 55), (13.4, 0.9), (0.018, 0.001), (0.72, 0.04), (0.006, 0.0)
    ),
    "H-DDPG-6x6-Phy": _physical((911, 93), (27.6, 2.6), (0.05, 0.0), (1.35, 0.05), (0.003, 0.0)),
    "H-DDPG-4x4to6x6-Phy": _physical(
        (881, 88), (24.1, 1.7), (0.05, 0.001), (1.29, 0.06), (0.003, 0.0)
    ),
}
PHYSICAL_CASES = 3
