"""The paper's claims about its simulations, each held against what we measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skydog.study import paper, statistics, verdict

Measured = dict[str, dict[str, np.ndarray]]
"""Every metric of every mission (`evaluate.measure`), by the name of the scenario."""

# What is compared, as it is written, and with how many digits.
UNITS = {
    "steps_gcm": ("steps until the centre is home", ".0f"),
    "steps": ("steps until all are home", ".0f"),
    "distance": ("metres flown", ".1f"),
    "turn": ("degrees turned a step", ".0f"),
}


# The lines of the transfer study that fly every seed. Those of the paper's frame differ in their
# lessons alone: at all scales, and at one.
FOLDED = "all seeds, through ξ"
ALL_SCALES = "all seeds, paper's frame, through ξ"
ONE_SCALE = "all seeds, paper's frame, lessons at one scale, through ξ"
FURTHER = ("8", "10", "15", "20")  # metres
PLATEAU = 0.085  # paper, "Training": the reward per action at which its models converge


@dataclass(frozen=True)
class Less:
    """One scenario has less of a metric than another does, on the same cases."""

    metric: str
    less: str
    more: str

    def compare(self, measured: Measured) -> tuple[int, str]:
        """Whether it has (1), has more (-1) or neither is sure (0), and a sentence of figures."""
        ours, theirs = measured[self.less][self.metric], measured[self.more][self.metric]
        difference = statistics.paired(ours, theirs)
        low, high = difference["ci95"]
        unit, form = UNITS[self.metric]
        return (high < 0) - (low > 0), (
            f"{self.less} has {np.mean(ours):{form}} {unit}, {self.more} {np.mean(theirs):{form}}: "
            f"a difference of {difference['mean']:+{form}} [{low:+{form}}, {high:+{form}}] "
            f"on the same {len(ours)} cases."
        )


@dataclass(frozen=True)
class MoreSuccess:
    """One scenario accomplishes more missions than another does, of the same cases."""

    more: str
    less: str

    def compare(self, measured: Measured) -> tuple[int, str]:
        """Whether it does (1), does less (-1) or neither is sure (0), and a sentence of figures."""
        ours, theirs = (measured[name]["success"] > 0 for name in (self.more, self.less))
        test = statistics.mcnemar(ours, theirs)
        return test.sign, (
            f"{self.more} accomplishes {ours.sum()} of {len(ours)} missions, {self.less} "
            f"{theirs.sum()} of the same: p = {test.p:.2g}."
        )


@dataclass(frozen=True)
class Claim:
    """A claim, what the paper says of it, and the comparisons that it comes to."""

    title: str
    says: str
    comparisons: tuple[Less | MoreSuccess, ...]


@dataclass(frozen=True)
class Finding:
    """What came of a claim: a verdict (`verdict.RULES`), and a paragraph of figures."""

    title: str
    says: str
    verdict: str
    found: str


BEYOND = "Beyond the paper: "
"""So begins the title of a claim that is ours."""


def judged(title: str, outcomes: Sequence[int]) -> str:
    """The verdict on a claim, from each comparison: 1 as claimed, -1 the other way, 0 unsure."""
    ours = title.startswith(BEYOND)
    as_claimed, against = ("holds", "does not hold") if ours else ("reproduced", "not reproduced")
    if all(outcome == 1 for outcome in outcomes):
        return as_claimed
    if 1 in outcomes:
        return f"{as_claimed} in part"
    return against if -1 in outcomes else "undecided"


def as_printed(tests: Sequence[statistics.Outcome]) -> str:
    """The verdict on a figure that the paper prints, from a test of it in each row."""
    return "not reproduced" if any(test.sign for test in tests) else "compatible"


CLAIMS = (
    Claim(
        "H-DDPG beats Strömbom in 4 × 4",
        '"H-DDPG outperforms the Strömbom approach on the three metrics": steps, distance and '
        "success.",
        (
            Less("steps_gcm", "H-DDPG-4x4", "Strombom-4x4"),
            Less("distance", "H-DDPG-4x4", "Strombom-4x4"),
            MoreSuccess("H-DDPG-4x4", "Strombom-4x4"),
        ),
    ),
    Claim(
        "Strömbom beats the learners in 6 × 6 in steps and distance",
        '"In the larger environment of 6×6, it seems that the Strömbom model performs better than '
        'the learning methods in both the number of steps and the travelled distance."',
        (
            Less("steps_gcm", "Strombom-6x6", "H-DDPG-6x6"),
            Less("distance", "Strombom-6x6", "H-DDPG-6x6"),
            Less("steps_gcm", "Strombom-6x6", "DHRL-6x6"),
            Less("distance", "Strombom-6x6", "DHRL-6x6"),
        ),
    ),
    Claim(
        "H-DDPG takes fewer steps than DHRL",
        '"H-DDPG used slightly less number of steps than DHRL in both the 4×4 and 6×6 '
        'environments."',
        (
            Less("steps_gcm", "H-DDPG-4x4", "DHRL-4x4"),
            Less("steps_gcm", "H-DDPG-6x6", "DHRL-6x6"),
        ),
    ),
    Claim(
        "H-DDPG flies further than DHRL",
        '"The travelled distance of the H-DDPG is slightly longer", since DHRL cuts corners.',
        (
            Less("distance", "DHRL-4x4", "H-DDPG-4x4"),
            Less("distance", "DHRL-6x6", "H-DDPG-6x6"),
        ),
    ),
    Claim(
        "DHRL zigzags, H-DDPG flies smoothly",
        '"The movement of DHRL is zigzag being less smoother that of HDDPG."',
        (
            Less("turn", "H-DDPG-6x6", "DHRL-6x6"),
            Less("turn", "H-DDPG-4x4to6x6", "DHRL-4x4to6x6"),
        ),
    ),
    Claim(
        "The scaled dog flies a shorter way, in more steps",
        '"The trained 4×4 H-DDPG model outperforms the H-DDPG model trained in the larger '
        'environment of 6×6 in terms of the travelled distance, but [...] takes some more steps."',
        (
            Less("distance", "H-DDPG-4x4to6x6", "H-DDPG-6x6"),
            Less("steps_gcm", "H-DDPG-6x6", "H-DDPG-4x4to6x6"),
        ),
    ),
    Claim(
        BEYOND + "fewer steps than Strömbom at equal speed",
        "The paper's learners were faster than its rule dog. Here both may fly ±1 m/s on each "
        "axis, and then both 1 m/s in any direction.",
        (
            Less("steps", "H-DDPG-4x4", "Strombom-4x4"),
            Less("steps", "H-DDPG-6x6", "Strombom-6x6"),
            Less("steps", "H-DDPG-4x4, 1 m/s", "Strombom-4x4, 1 m/s"),
            Less("steps", "H-DDPG-6x6, 1 m/s", "Strombom-6x6, 1 m/s"),
        ),
    ),
    Claim(
        BEYOND + "fewer steps than DHRL at equal speed",
        "DHRL's steps are axis-parallel, 1 m/s; H-DDPG may fly both axes at once, at up to 1.4 "
        "m/s. Here H-DDPG too flies no faster than 1 m/s in any direction.",
        (
            Less("steps", "H-DDPG-4x4, 1 m/s", "DHRL-4x4"),
            Less("steps", "H-DDPG-6x6, 1 m/s", "DHRL-6x6"),
        ),
    ),
)


def compared(measured: Measured) -> list[Finding]:
    """What came of each of `CLAIMS`."""
    findings = []
    for claim in CLAIMS:
        outcomes, told = zip(*(one.compare(measured) for one in claim.comparisons), strict=True)
        word = judged(claim.title, outcomes)
        findings.append(Finding(claim.title, claim.says, word, " ".join(told)))
    return findings


def accomplished(rows: dict[str, Any], random: dict[str, Any]) -> list[Finding]:
    """What came of the claims about success, from rows by scenario on both sets of cases.

    The missions of both sets are taken together: the paper's own starts are not known.
    """

    def finding(title: str, says: str, names: list[str]) -> Finding:
        tests, told = [], []
        for name in names:
            (ours, cases), (others, more) = _successes(rows[name]), _successes(random[name])
            theirs = round(paper.PRINTED[name]["success"] * paper.CASES)
            test = statistics.fisher(ours + others, cases + more, theirs, paper.CASES)
            tests.append(test)
            told.append(
                f"{name}: {_of_all(rows[name])}, {_of_all(random[name])}; both, against the "
                f"paper's {theirs} of {paper.CASES}: p = {test.p:.2g}."
            )
        return Finding(title, says, as_printed(tests), " ".join(told))

    return [
        finding(
            "The learnt dogs have a success of 100 %",
            "100 % in all six scenarios of DHRL and H-DDPG, the scaled ones included.",
            [name for name in rows if not name.startswith("Strombom")],
        ),
        finding(
            "The rule dog has a success of 96.67 %",
            "96.67 % for Strömbom in both arenas: one mission in thirty fails.",
            [name for name in rows if name.startswith("Strombom")],
        ),
    ]


SERVED = 0.99  # the least success of a sheepdog to any goal


def any_goal(goals: dict[str, dict[str, Any]]) -> list[Finding]:
    """What came of the folded frame, from the rows of `robustness` by shepherd and arena."""

    def told(name: str) -> str:
        cells = goals[name]
        failed, cases = (sum(cell[what] for cell in cells.values()) for what in ("failed", "cases"))
        worst = min(cells, key=lambda goal: cells[goal]["success"])
        corners = [row["steps"]["mean"] for goal, row in cells.items() if goal.startswith("corner")]
        fewest, most = min(corners), max(corners)
        at_worst = f", {_of_all(cells[worst])} at worst ({worst})" if failed else ""
        return (
            f"{name}: {cases - failed:,} of {cases:,}{at_worst}; {fewest:.0f} to {most:.0f} steps "
            "to the corners."
        )

    learnt = [name for name in goals if name.startswith(("H-DDPG", "DHRL"))]
    folded = [name for name in learnt if "paper-frame" not in name]
    intervals = [cell["success_ci95"] for name in folded for cell in goals[name].values()]
    outcomes = [(low >= SERVED) - (high < SERVED) for low, high in intervals]
    title = BEYOND + "one sheepdog herds to any goal"
    return [
        Finding(
            title,
            "The paper has one goal. In the folded frame, with the paper's four inputs, what was "
            "learnt serves corners, edges and the centre: to each goal, the 95 % interval of "
            f"success lies above {SERVED:.0%}. Of the paper's frame this is not claimed.",
            judged(title, outcomes),
            " ".join(map(told, learnt)),
        )
    ]


def carried_over(moved: dict[str, dict[str, Any]]) -> list[Finding]:
    """What came of ξ, from the transfer study, if it has flown several seeds."""
    if ONE_SCALE not in moved:
        return []
    plain, ours = moved[ONE_SCALE]["6"], moved[ALL_SCALES]["6"]
    test = verdict.success(plain, paper.PRINTED["H-DDPG-4x4to6x6"]["success"])

    def further(line: str) -> str:
        return ", ".join(f"{moved[line][size]['success']:.1%} in {size} m" for size in FURTHER)

    found = Finding(
        "What is learnt in 4 × 4 herds in 6 × 6 through ξ",
        "Success of 100 % for H-DDPG-4×4to6×6.",
        as_printed([test]),
        "In the paper's frame, with lessons at one scale, as the paper has them, "
        f"{_of_all(plain)} (the paper: 30 of 30, p = {test.p:.2g}); with lessons at scales from "
        f"0.1 to 1.4, {_of_all(ours)}. In larger arenas, after lessons at one scale: "
        f"{further(ONE_SCALE)}; at many scales: {further(ALL_SCALES)}; at many scales and in the "
        f"folded frame: {further(FOLDED)}. ξ scales distances, but not the flock: 1/ξ magnifies "
        "the errors of a skill, and a dog that stands a few centimetres too far from its sheep "
        "moves nothing. That is why our lessons have flocks of many scales.",
    )
    return [found]


def learnt(curves: dict[str, list[tuple[np.ndarray, np.ndarray]]]) -> list[Finding]:
    """What came of the learning curves, from those of the paper's own lessons, a seed each.

    Of each model two comparisons: the reward rises within 100 episodes, and at the end it is
    `PLATEAU` or more.
    """
    title = "Learning rises within 100 episodes, then stays at 0.085 or more an action"
    sentences, outcomes = [], []
    for name, seeds in curves.items():
        rewards = [reward for _, reward in seeds if len(reward)]
        if not rewards:  # lessons so short that ten episodes did not end
            return []
        first = np.array([reward[0] for reward in rewards])  # episodes 1 to 10
        early = np.array([reward[:10][-1] for reward in rewards])  # episodes 91 to 100
        late = np.array([reward[-(len(reward) // 10 or 1) :].mean() for reward in rewards])
        rise, end = statistics.student(early - first, 0.0), statistics.student(late, PLATEAU)
        outcomes += [rise.sign, end.sign]
        sentences.append(
            f"{name}: {first.mean():.3f} ± {first.std():.3f} in the first ten episodes, "
            f"{early.mean():.3f} ± {early.std():.3f} after 100 (p = {rise.p:.2g}), "
            f"{late.mean():.3f} ± {late.std():.3f} over the last tenth (p = {end.p:.2g})."
        )
    found = Finding(
        title,
        '"The cumulative total rewards per action [...] increase significantly in the first 100 '
        'episodes, and then becomes relatively stable with a value of approximately 0.09."',
        judged(title, outcomes),
        " ".join(sentences)
        + " A high reward is no herding: the paper's pays for never arriving too.",
    )
    return [found]


def _successes(row: dict[str, Any]) -> tuple[int, int]:
    return round(row["success"] * row["cases"]), row["cases"]


def _of_all(row: dict[str, Any]) -> str:
    successes, cases = _successes(row)
    low, high = row["success_ci95"]
    return f"{successes:,} of {cases:,} [{low:.1%}, {high:.1%}]"
