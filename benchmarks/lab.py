"""Fly the laboratory's chain on this machine, in real time, and write docs/flown.md.

`python benchmarks/lab.py --out docs/flown.md` takes an hour; what was flown before, into
`--runs`, is not flown again. Nothing else should run on the machine meanwhile.
"""

import argparse
import json
import os
import platform
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from skydog import files
from skydog.commands.physical import draw
from skydog.lab.emulation import campaign, faults, flights, verdict
from skydog.lab.emulation.chain import a_site
from skydog.lab.emulation.flights import Emulated, Flown
from skydog.lab.emulation.room import Start
from skydog.lab.setup import Setup
from skydog.lab.setup import base as base_of
from skydog.lab.site import Mission
from skydog.shepherds import store
from skydog.study import evaluate, physical, report
from skydog.study.paper import PHYSICAL_CASES
from skydog.twin import Twin
from skydog.world.presets import at_speed, preset

ROWS = {
    "H-DDPG-6x6-Phy": "ros1",
    "H-DDPG-4x4to6x6-Phy": "ros1",
    "H-DDPG-6x6-Phy over DDS": "dds",
}
ONE = ("crazyflie", "mavlink", "crazyswarm2", "tum-simulator")  # adapters, a mission each
MINUTES = 10
DRAWS = 12  # of what goes wrong, for each start of a row, flown by the twin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=Path, default=Path("runs/flown"))
    parser.add_argument("--only", nargs="*", default=["rows", "adapters", "rates", "faults"])
    options = parser.parse_args()
    runs = files.folder(options.runs)
    if "rows" in options.only:
        for name, transport in ROWS.items():
            cases = 1 if transport == "dds" else PHYSICAL_CASES
            for case in range(cases):
                once(
                    runs / f"{name.replace(' ', '-')}-{case}.json",
                    lambda n=name, t=transport, c=case: row(runs, n, t, c),
                )
    if "adapters" in options.only:
        for adapter in ONE:
            once(runs / f"adapter-{adapter}.json", lambda a=adapter: one(runs, a))
    if "rates" in options.only:
        once(runs / "rates.json", lambda: rates(runs))
    if "faults" in options.only:
        for name in faults.FAULTS:
            once(
                runs / f"fault-{name}.json",
                lambda n=name: campaign.fly(n, fresh(runs / "faults" / n), print)._asdict(),
            )
    files.write_text(options.out, document(runs))


def once(path: Path, fly: Any) -> None:
    """What was flown before is not flown again."""
    if not path.exists():
        print(path.stem, flush=True)
        files.write_text(path, json.dumps(files.plain(fly()), indent=2))


def fresh(path: Path) -> Path:
    """A folder that is not there yet: what an interrupted run left is kept beside it."""
    number = 0
    while path.exists():
        number += 1
        path = path.with_name(f"{path.name.split('~')[0]}~{number}")
    files.folder(path.parent)
    return path


def times(flown: Flown) -> dict[str, Any]:
    """How a flight kept time, in milliseconds."""
    found = {
        name: [
            1e3 * float(np.percentile(getattr(flown.outcome.times, name), q)) for q in (50, 99, 100)
        ]
        for name in ("jitter", "latency", "decide")
    }
    ticks = flown.outcome.times.jitter
    return {
        **found,
        "missed": flown.outcome.times.missed,
        "ticks": len(ticks),
        "blind": flown.outcome.times.blind,
        "beyond": flown.room.beyond,
        "late": flown.room.late,
        "crashed": flown.room.crashed,
    }


def row(runs: Path, name: str, transport: str, case: int) -> dict[str, Any]:
    """A case of a row, flown by the chain, beside the twin's own flight of it."""
    plain = name.removesuffix(" over DDS")
    line = physical.missions(physical.UNTAUGHT)[f"{plain}, fitted, 0.12"]
    setting, world, dog = line.setting, line.world(), store.load(line.dog)
    key, drawn = jax.random.key(line.seed), draw(world, line)
    twin = once_twin(runs, plain, line, world, dog, drawn, key)
    kept: list[Flown] = []
    fly = Emulated(
        transport="dds" if transport == "dds" else "ros1",
        profile=setting.profile,
        disturb=setting.disturb,
        wait=setting.wait,
        steering=setting.steering,
        logs=files.folder(runs / "logs" / f"{name.replace(' ', '-')}-{case}"),
        said=print,
        ended=kept.append,
    )
    keys = np.asarray(jax.random.key_data(jax.random.split(key, line.cases)))[case].tolist()
    begin = jax.tree.map(lambda leaf: leaf[case], drawn)
    trace = fly.one(world, dog, begin, line.steps, keys)
    measured = evaluate.measure(evaluate.stack([trace]))
    return {
        "chain": {metric: float(values[0]) for metric, values in measured.items()},
        "twin": {metric: values[case] for metric, values in twin.items() if metric != "draws"},
        "draws": [one[case] for one in twin["draws"]],
        **times(kept[0]),
    }


def once_twin(runs: Path, name: str, line: Any, world: Any, dog: Any, drawn: Any, key: Any) -> Any:
    """What the twin itself flies of a row: all its cases; and the first ones by other luck."""
    path = runs / f"twin-{name}.json"
    if not path.exists():
        setting = line.setting
        fly = Twin(setting.profile, "kobuki", setting.disturb, setting.wait, setting.steering)
        found = evaluate.measure(fly(world, dog, drawn, line.steps, key))
        again = jax.tree.map(
            lambda leaf: np.tile(
                np.asarray(leaf[:PHYSICAL_CASES]), (DRAWS,) + (1,) * (leaf.ndim - 1)
            ),
            drawn,
        )
        other = evaluate.measure(fly(world, dog, again, line.steps, jax.random.key(7)))["steps"]
        kept = {name: values.tolist() for name, values in found.items()}
        kept["draws"] = other.reshape(DRAWS, PHYSICAL_CASES).tolist()
        files.write_text(path, json.dumps(kept))
    return json.loads(path.read_text())


def one(runs: Path, adapter: Any) -> dict[str, Any]:
    """A mission of another drone, at full speed, in the laboratory's disturbances."""
    world, dog = preset("paper-physical"), store.load("h-ddpg-6x6")
    kept: list[Flown] = []
    fly = Emulated(
        "dds" if adapter == "crazyswarm2" else "ros1",
        adapter,
        disturb="lab",
        logs=files.folder(runs / "logs" / adapter),
        said=print,
        ended=kept.append,
    )
    line = physical.missions(physical.UNTAUGHT)["H-DDPG-6x6-Phy, full"]
    begin = jax.tree.map(lambda leaf: leaf[0], draw(world, line))
    trace = fly.one(world, dog, begin, 1000, [0, 1])
    measured = evaluate.measure(evaluate.stack([trace]))
    return {"chain": {n: float(v[0]) for n, v in measured.items()}, **times(kept[0])}


def rates(runs: Path) -> dict[str, Any]:
    """Ten minutes of one flight, so slow that no mission ends before."""
    world = at_speed(preset("paper-physical"), 0.02)
    dog = store.load("h-ddpg-6x6")
    steps = round(MINUTES * 60.0 / float(world.arena.dt))
    site = a_site(Mission(steps=steps), float(world.arena.size))
    site = replace(site, uav=(replace(site.uav[0], battery_minutes=60.0),))
    line = physical.missions(physical.UNTAUGHT)["H-DDPG-6x6-Phy, full"]
    begin = jax.tree.map(lambda leaf: leaf[0], draw(world, line))
    arena = world.arena
    start = Start(
        flights.pairs(begin.dogs),
        flights.pairs(begin.sheep),
        float(arena.size),
        (float(arena.goal_x), float(arena.goal_y), float(arena.goal_radius)),
        "lab",
        (0, 2),
    )
    before = os.times()
    made = Setup(world, dog, {}, base_of(site, world))
    flown = flights.fly(site, made, start, fresh(runs / "logs" / "rates"), print)
    after = os.times()
    busy = sum(after[:4]) - sum(before[:4])
    load = os.getloadavg()[1]
    return {**times(flown), "seconds": after.elapsed - before.elapsed, "cpu": busy, "load": load}


def document(runs: Path) -> str:
    """What was flown, as Markdown."""
    found = {path.stem: json.loads(path.read_text()) for path in sorted(runs.glob("*.json"))}
    lines = [
        "# Emulated flights",
        "",
        "Made by `python benchmarks/lab.py --out docs/flown.md`. The whole chain of [the lab]"
        "(lab.md) runs in real time on one machine of "
        f"{os.cpu_count()} cores ({platform.python_implementation()} "
        f"{platform.python_version()}). The [twin](glossary.md#twin) replaces the room; UDP, "
        "ROS 1's master and DDS are real. No real robot has flown.",
        "",
        "## The paper's physical rows",
        "",
        "Each [case](glossary.md#case) is flown twice from the same start with the same setting: "
        "by the twin alone, and by the chain. The setting is the profile `ardrone2`, the "
        "disturbances `lab`, waypoints reached to 0.1 m, and 0.12 of full speed.",
        "",
    ]
    lines += [report.markdown_table(*rows_table(found)), "", "## Other drones", ""]
    lines += [report.markdown_table(*adapters_table(found)), "", "## Ten minutes", ""]
    lines += [report.markdown_table(*rates_table(found)), "", "## Faults", ""]
    rows = [verdict.Row(**one) for name, one in found.items() if name.startswith("fault-")]
    lines += [report.markdown_table(*verdict.table(rows)), ""]
    return "\n".join(lines)


def rows_table(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    head = [
        "row",
        "case",
        "accomplished",
        "steps, chain",
        "steps, twin",
        f"twin, {DRAWS} other draws",
        "pose to command p50 / p99",
    ]
    body = []
    for name in ROWS:
        stem = name.replace(" ", "-")
        cases = [
            one for key, one in found.items() if key.rpartition("-")[0] == stem and "draws" in one
        ]
        for number, case in enumerate(cases, 1):
            p50, p99, _ = case["latency"]
            cells = [
                name,
                str(number),
                "yes" if case["chain"]["success"] else "no",
                f"{case['chain']['steps']:.0f}",
                f"{case['twin']['steps']:.0f}",
                f"{np.mean(case['draws']):.0f}, SD {np.std(case['draws']):.0f}",
                f"{p50:.1f} / {p99:.1f} ms",
            ]
            body.append(cells)
        if len(cases) > 1:
            passed = sum(case["chain"]["success"] for case in cases)
            ours, twins = (np.mean([c[w]["steps"] for c in cases]) for w in ("chain", "twin"))
            draws = np.mean([case["draws"] for case in cases], axis=0)
            more = 100 * (ours / draws.mean() - 1)
            cells = [
                f"{name}, mean",
                "",
                f"{passed:.0f} of {len(cases)}",
                f"{ours:.0f}",
                f"{twins:.0f} ({100 * (ours / twins - 1):+.1f} %)",
                f"{draws.mean():.0f}, SD {draws.std():.0f} ({more:+.1f} %)",
                "",
            ]
            body.append(cells)
    return head, body


def adapters_table(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    head = [
        "adapter",
        "accomplished",
        "steps",
        "pose to command p50 / p99",
        "furthest, inside the fence",
    ]
    body = []
    for adapter in ONE:
        if (one := found.get(f"adapter-{adapter}")) is None:
            continue
        p50, p99, _ = one["latency"]
        body.append([
            adapter, "yes" if one["chain"]["success"] else "no", f"{one['chain']['steps']:.0f}",
            f"{p50:.1f} / {p99:.1f} ms", f"{-one['beyond']:.2f} m",
        ])  # fmt: skip
    return head, body


def rates_table(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    one = found.get("rates")
    if one is None:
        return ["", ""], []
    form = lambda values: " / ".join(f"{value:.2f}" for value in values) + " ms"  # noqa: E731
    return ["ten minutes at 100 Hz", "p50 / p99 / longest"], [
        ["a tick's lateness", form(one["jitter"])],
        ["pose to command", form(one["latency"])],
        ["a decision", form(one["decide"])],
        ["ticks later than 5 ms", f"{one['missed']} of {one['ticks']}"],
        ["ticks of the room that were late", f"{100 * one['late']:.2f} %"],
        ["processor time of all processes", f"{one['cpu'] / one['seconds']:.2f} cores"],
        ["load of the machine, over its last five minutes", f"{one['load']:.2f}"],
    ]


if __name__ == "__main__":
    main()
