"""How the free numbers of the physical study were found: speed, gusts and tolerance.

    python benchmarks/fit_physical.py [--cases 12]

The paper prints neither the speeds of its Section 6 nor what disturbed its laboratory. Each number
is fitted on a row of the 6 x 6 dog; the other dog's rows test it, in `skydog reproduce --physical`.
"""

import argparse
from dataclasses import replace

from skydog.commands.physical import draw
from skydog.shepherds import store
from skydog.study import paper, physical
from skydog.study.physical import Mission, Setting
from skydog.study.report import markdown_table
from skydog.twin import DISTURBANCES, Twin
from skydog.world.mission import Fly

SPEEDS = (1 / 6, 0.14, 0.12, 0.10)
GUSTS = (0.2, 0.25, 0.3)
TOLERANCES = (0.09, 0.10, 0.11)
METRICS = physical.METRICS[:2] + physical.METRICS[3:4]
DOG = "h-ddpg-6x6"


def line(row: str, called: str, speed: float, cases: int, fly: Fly, how: Setting) -> list[str]:
    """A row of the table: what comes of it, as a share of what the paper prints."""
    mission = Mission(DOG, how, speed, "paper", cases, 2000, gate_as_paper=True)
    found, _ = physical.fly(mission, store.load(DOG), lambda _: fly, draw)
    shares = [found[name]["mean"] / paper.PHYSICAL[row][name]["mean"] for name in METRICS]
    return [row, called, *(f"{share:.2f}" for share in shares)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=12)
    cases = parser.parse_args().cases
    sim, phy = "H-DDPG-6x6-Sim", "H-DDPG-6x6-Phy"
    rows = [line(sim, f"speed {speed:.3f}", speed, cases, Twin(), physical.SIM) for speed in SPEEDS]
    for gust in GUSTS:
        for tolerance in TOLERANCES:
            disturb = replace(DISTURBANCES["lab"], gust=gust)
            fly = Twin("ardrone2", disturb=disturb, wait=tolerance)
            called = f"gusts {gust:g} m/s², tolerance {tolerance:g} m"
            rows.append(line(phy, called, physical.FITTED_SPEED, cases, fly, physical.PHY))
    head = ["row", "with", "steps (GCM)", "distance", "dog to subgoal"]
    print(markdown_table(head, rows))


if __name__ == "__main__":
    main()
