"""The paper's claims about its simulations, each held against what we measured."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skydog.study import statistics

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

    def holds(self, measured: Measured) -> tuple[str, str]:
        """The verdict, "reproduced", "undecided" or "not reproduced", and a sentence of figures."""
        ours, theirs = measured[self.less][self.metric], measured[self.more][self.metric]
        difference = statistics.paired(ours, theirs)
        low, high = difference["ci95"]
        verdict = "reproduced" if high < 0 else "not reproduced" if low > 0 else "undecided"
        unit, form = UNITS[self.metric]
        return verdict, (
            f"{self.less} has {np.mean(ours):{form}} {unit}, {self.more} {np.mean(theirs):{form}}: "
            f"a difference of {difference['mean']:+{form}} [{low:+{form}}, {high:+{form}}] "
            f"on the same {len(ours)} cases."
        )


@dataclass(frozen=True)
class Claim:
    """A claim, what the paper says of it, and the comparisons that it comes to."""

    title: str
    says: str
    comparisons: tuple[Less, ...]


@dataclass(frozen=True)
class Finding:
    """What came of a claim: a verdict, and a paragraph of figures."""

    title: str
    says: str
    verdict: str
    found: str


CLAIMS = (
    Claim(
        "H-DDPG beats Strömbom in 4 × 4",
        '"H-DDPG outperforms the Strömbom approach on the three metrics": steps, distance and '
        "success.",
        (
            Less("steps_gcm", "H-DDPG-4x4", "Strombom-4x4"),
            Less("distance", "H-DDPG-4x4", "Strombom-4x4"),
        ),
    ),
    Claim(
        "Strömbom beats the learners in 6 × 6, but for success",
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
        "Beyond the paper: fewer steps than Strömbom at equal speed",
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
        "Beyond the paper: fewer steps than DHRL at equal speed",
        "DHRL's steps are axis-parallel, 1 m/s; H-DDPG may fly both axes at once, at up to 1.4 "
        "m/s. Here H-DDPG too flies no faster than 1 m/s in any direction.",
        (
            Less("steps", "H-DDPG-4x4, 1 m/s", "DHRL-4x4"),
            Less("steps", "H-DDPG-6x6, 1 m/s", "DHRL-6x6"),
        ),
    ),
)


def compared(measured: Measured) -> list[Finding]:
    """What came of each of `CLAIMS`: reproduced if every comparison of it holds."""
    findings = []
    for claim in CLAIMS:
        held, sentences = zip(*(less.holds(measured) for less in claim.comparisons), strict=True)
        verdict = held[0] if len(set(held)) == 1 else "reproduced in part"
        if "reproduced" not in held and len(set(held)) > 1:
            verdict = "not reproduced"
        findings.append(Finding(claim.title, claim.says, verdict, " ".join(sentences)))
    return findings


def accomplished(rows: dict[str, Any], random: dict[str, Any]) -> list[Finding]:
    """What came of the claims about success, from rows by scenario on both sets of cases."""
    learnt = [name for name in rows if not name.startswith("Strombom")]
    rule = [name for name in rows if name.startswith("Strombom")]

    def shares(names: list[str]) -> str:
        return " ".join(f"{name}: {of_all(rows[name])}, {of_all(random[name])}." for name in names)

    def of_all(row: dict[str, Any]) -> str:
        return f"{round(row['success'] * row['cases']):,} of {row['cases']:,} {_interval(row)}"

    every = all(rows[name]["success"] == 1.0 for name in learnt)
    fails = all(rows[name]["success_ci95"][0] <= 29 / 30 for name in rule)
    return [
        Finding(
            "The learnt dogs accomplish every mission",
            "Success of 100 % in all six scenarios of DHRL and H-DDPG, the scaled ones included.",
            "reproduced" if every else "not reproduced",
            shares(learnt),
        ),
        Finding(
            "The rule dog fails one mission in thirty",
            "Success of 96.67 % for Strömbom in both arenas.",
            "reproduced" if fails else "not reproduced",
            shares(rule) + " 29 of 30 lies within the interval of 30 of 30, so that the two "
            "studies do not contradict each other; on our cases the rule dog does not fail.",
        ),
    ]


def any_goal(goals: dict[str, dict[str, Any]]) -> list[Finding]:
    """What came of the folded frame, from the rows of `robustness` by shepherd and arena."""

    def told(name: str) -> str:
        cells = goals[name]
        failed, cases = (sum(cell[what] for cell in cells.values()) for what in ("failed", "cases"))
        worst = min(cells, key=lambda goal: cells[goal]["success"])
        corners = [row["steps"]["mean"] for goal, row in cells.items() if goal.startswith("corner")]
        fewest, most = min(corners), max(corners)
        at_worst = f", {cells[worst]['success']:.1%} at worst ({worst})" if failed else ""
        return (
            f"{name}: {cases - failed:,} of {cases:,}{at_worst}; {fewest:.0f} to {most:.0f} steps "
            "to the corners."
        )

    learnt = [name for name in goals if name.startswith(("H-DDPG", "DHRL"))]
    folded = [name for name in learnt if "paper-frame" not in name]
    least = {name: 0.999 if name.startswith("H-DDPG") else 0.99 for name in folded}
    every = all(cell["success"] >= least[name] for name in folded for cell in goals[name].values())
    return [
        Finding(
            "Beyond the paper: one sheepdog herds to any goal",
            "The paper has one goal. In the folded frame, with the paper's four inputs, what was "
            "learnt serves corners, edges and the centre: H-DDPG accomplishes 99.9 % of the "
            "missions to each, DHRL 99 %. In the paper's frame it serves one corner.",
            "reproduced" if every else "not reproduced",
            " ".join(map(told, learnt)),
        )
    ]


def carried_over(moved: dict[str, dict[str, Any]]) -> list[Finding]:
    """What came of ξ, from the transfer study, if it has flown several seeds."""
    if ONE_SCALE not in moved:
        return []
    plain, ours = moved[ONE_SCALE]["6"], moved[ALL_SCALES]["6"]

    def further(line: str) -> str:
        return ", ".join(f"{moved[line][size]['success']:.1%} in {size} m" for size in FURTHER)

    found = Finding(
        "What is learnt in 4 × 4 herds in 6 × 6 through ξ",
        "Success of 100 % for H-DDPG-4×4to6×6.",
        "reproduced" if plain["success"] >= 29 / 30 else "not reproduced",
        "In the paper's frame, with lessons at one scale, as the paper has them, "
        f"{plain['success']:.1%} of {plain['cases']} missions {_interval(plain)}; with lessons at "
        f"scales from 0.1 to 1.4, {ours['success']:.1%} of {ours['cases']} {_interval(ours)}. "
        f"In larger arenas the first fail: {further(ONE_SCALE)}; the second: "
        f"{further(ALL_SCALES)}. ξ scales distances, "
        "but not the flock: what a skill misses by at home, 1/ξ magnifies, and a dog that stands a "
        "few centimetres too far from its sheep moves nothing. Lessons with the flock at every "
        "scale cure that: the dog that herds in a large arena has met small flocks in its own.",
    )
    return [found]


def learnt(curves: dict[str, list[tuple[np.ndarray, np.ndarray]]]) -> list[Finding]:
    """What came of the learning curves, from those of the paper's own lessons, a seed each."""
    sentences, good = [], []
    for name, seeds in curves.items():
        rewards = [reward for _, reward in seeds if len(reward)]
        if not rewards:  # lessons so short that ten episodes did not end
            return []
        early = np.array([reward[:10][-1] for reward in rewards])  # episodes 91 to 100
        late = np.array([reward[-(len(reward) // 10 or 1) :].mean() for reward in rewards])
        good.append(late.mean() >= PLATEAU)
        sentences.append(
            f"{name}: {early.mean():.3f} ± {early.std():.3f} after 100 episodes, "
            f"{late.mean():.3f} ± {late.std():.3f} over the last tenth."
        )
    found = Finding(
        "Learning converges within 100 episodes, to 0.085 or more an action",
        '"The cumulative total rewards per action [...] increase significantly in the first 100 '
        'episodes, and then becomes relatively stable with a value of approximately 0.09."',
        "reproduced" if all(good) else "reproduced in part" if any(good) else "not reproduced",
        " ".join(sentences)
        + " A high reward is no herding: the paper's pays for never arriving too.",
    )
    return [found]


def _interval(row: dict[str, Any]) -> str:
    low, high = row["success_ci95"]
    return f"[{low:.1%}, {high:.1%}]"
