"""The five scenes in the twin, beside the kinematic world: the same starts, three sheep.

python benchmarks/twin_scenes.py [--cases 20]
"""

import argparse

import jax

from skydog.flight import profiles
from skydog.shepherds import store
from skydog.study import evaluate
from skydog.study.report import figure, markdown_table, share
from skydog.twin import Twin, starts
from skydog.world.presets import preset
from skydog.world.scenes import SCENES

DOG, STEPS = "h-ddpg-4x4", 5000


def row(scene: str, cases: int) -> list[str]:
    """A scene, and how often and how fast the sheepdog succeeds: as points, then with physics."""
    world, dog = preset("paper-physical", scene=scene), store.load(DOG)
    uav, rover = profiles.uav("tum-simulator"), profiles.rover("kobuki")
    begins = starts.draw(world, cases, "spaced", uav, rover)
    cells = [f"`{scene}`"]
    for disturb in (None, "none", "lab"):
        fly = evaluate.fly if disturb is None else Twin(disturb=disturb)
        found = evaluate.row(fly(world, dog, begins, STEPS, jax.random.key(0)))
        cells += [share(found["success"], found["cases"]), figure(found["steps"], ".0f")]
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    cases = parser.parse_args().cases
    kinds = "kinematic", "twin", "twin, `lab`"
    head = ["scene", *(f"{kind}: {what}" for kind in kinds for what in ("success", "steps"))]
    print(markdown_table(head, [row(scene, cases) for scene in SCENES]))


if __name__ == "__main__":
    main()
