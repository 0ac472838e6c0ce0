"""Fly a shepherd through test cases: apart from training and drawing, so that it starts at once."""

from pathlib import Path
from typing import Any

from skydog import files
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study import evaluate, report, traces
from skydog.study.cases import cases
from skydog.words import AtPoint, Starts
from skydog.world.params import World


def test(
    shepherd: str,
    world: World,
    count: int,
    starts: Starts,
    seed: int,
    sheep: int,
    dogs: int,
    at_point: AtPoint,
    out: Path | None,
) -> dict[str, Any]:
    """Fly `strombom`, or a sheepdog by its file or run folder, through cases of a world.

    With `out`, the results and every mission's trace are written there.
    """
    rule_dog = shepherd == "strombom"
    steers = Strombom(at_point=at_point) if rule_dog else store.load(shepherd)
    name = evaluate.scenario(steers, world)
    if out is not None:
        files.folder(out)
    flown = evaluate.fly_noisily(
        world, steers, cases(world, count, starts, seed, sheep, dogs), seed
    )
    results = {name: evaluate.row(flown)}
    if out is not None:
        report.write(out, results)
        for case in range(count):
            path = out / "traces" / f"{name}-{case + 1}.safetensors"
            traces.save(path, evaluate.one_case(flown, case), name)
    return results
