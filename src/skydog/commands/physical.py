"""`skydog reproduce --physical`: fly the paper's physical study in the twin."""

import json
from collections.abc import Callable
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skydog import files
from skydog.commands import console, training
from skydog.flight import profiles
from skydog.learning.curriculum import Curriculum
from skydog.learning.lessons import HORIZON
from skydog.learning.train import checkpoint_in
from skydog.shepherds import store
from skydog.study import evaluate, physical, report
from skydog.study.options import Results
from skydog.study.physical import Mission, Setting
from skydog.study.scenarios import SIZES
from skydog.twin import Twin
from skydog.twin import starts as pads
from skydog.view import replay
from skydog.world import trace as traces

if TYPE_CHECKING:
    from skydog.world.mission import Fly
    from skydog.world.params import World
    from skydog.world.state import State

ROVERS = "kobuki"
PROFILES = sorted((Path(profiles.__file__).parent / "profiles").glob("*.toml"))
CHOSEN_BY = 60  # starts
CHOSEN_STEPS = 1000
CHOSEN_SEED = 2  # the study's own have 0 and 1


def run(
    out: Path, seeds: int, episodes: int, from_zoo: bool, command: str, on: str | None = None
) -> Results | None:
    """Teach the sheepdogs of the study, fly it into a run folder, and return its results.

    What was taught or flown before is not done again; None if the teaching was stopped.
    """
    out = files.folder(out)
    if not from_zoo and not _teach(out, seeds, episodes, command, on):
        return None
    home = store.ZOO if from_zoo else out / "zoo"
    dogs = (*physical.UNTAUGHT, *physical.TAUGHT)
    lines = physical.missions(dogs)
    results: Results = {}
    for number, (name, line) in enumerate(lines.items(), 1):
        where = out / "lines" / f"{_plain(name)}.json"
        file = (home if line.dog in physical.TAUGHT else store.ZOO) / f"{line.dog}.safetensors"
        asked = files.plain({**asdict(line), "SHA-256": _digest([file, *PROFILES])})
        if (kept := _kept(where, asked)) is None:
            with console.missions(line.cases, f"{number} of {len(lines)}: {name}") as update:
                kept, first = physical.fly(
                    line, store.load(file), lambda how, update=update: _fly(how, update), draw
                )
            if line.starts == "paper":
                traces.save(out / "traces" / f"{_plain(name)}.safetensors", first, name)
            files.write_text(where, json.dumps({"asked": asked, "found": files.plain(kept)}))
        results[name] = kept
    report.write(out, results)
    files.write_text(out / "physical.md", physical.document(results, dogs, command))
    shown = {
        name: traces.load(out / "traces" / f"{_plain(name)}.safetensors")[0]
        for name in lines
        if name.endswith(tuple(physical.SPEEDS)) and name.startswith(tuple(physical.ROWS))
    }
    page = physical.page(results, dogs, replay.player(shown), command)
    files.write_text(out / "report.html", page)
    console.say(f"Everything is in {out}; open {out / 'report.html'} in a browser.")
    return results


def _teach(out: Path, seeds: int, episodes: int, command: str, on: str | None = None) -> bool:
    """Teach `seeds` sheepdogs of each kind, and keep the one that is fastest in the twin.

    It is chosen by other starts than the study's own. Tells whether all was taught.
    """
    steps = episodes * HORIZON["progress"]
    kinds = [
        Curriculum("paper-physical", arena=size, steps=steps, bodies="physical") for size in SIZES
    ]
    folders = {
        kind: [out / "trainings" / kind.dog / f"seed-{seed}" for seed in range(seeds)]
        for kind in kinds
    }
    todo = [
        job
        for kind, places in folders.items()
        for seed, folder in enumerate(places)
        for job in training.jobs(kind, folder, seed, resume=True)
    ]
    training.check(out, todo)
    console.say(f"Training {len(todo)} skills, a core each; Ctrl-C keeps what was learnt:")
    if not training.train_all(todo, on=on):
        training.stopped(command, resumes=True)
        return False
    line = Mission("", physical.SIM, 1.0, "spaced", CHOSEN_BY, CHOSEN_STEPS, seed=CHOSEN_SEED)
    for kind, places in folders.items():
        shipped = out / "zoo" / f"{kind.dog.lower()}.safetensors"
        chosen_of = {
            "skills": _digest(
                [checkpoint_in(folder / skill) for folder in places for skill in kind.skills]
            ),
            "profiles": _digest(PROFILES),
        }
        if shipped.exists() and store.read(shipped)[1].get("chosen_of") == chosen_of:
            continue
        found = []
        for seed, folder in enumerate(places):
            dog, _ = training.fuse(kind, folder, seed)
            with console.missions(line.cases, f"choosing {kind.dog}, seed {seed}") as update:
                flown, _ = physical.fly(
                    line, dog, lambda how, update=update: _fly(how, update), draw
                )
            found.append((flown["steps"]["mean"], seed, dog, flown))
        _, seed, dog, flown = min(found, key=lambda one: one[:2])
        flown.pop("endings", None)
        card = training.card(kind, seed, command, {f"{kind.dog} in the twin": flown})
        store.save(shipped, dog, {**card, "chosen_of": chosen_of})
    return True


def _digest(read: list[Path]) -> str:
    """A mark of what files hold."""
    whole = sha256()
    for file in read:
        whole.update(file.read_bytes())
    return whole.hexdigest()


def draw(world: "World", line: Mission) -> "State":
    """The starts of a line: those that every drone and rover of the study can fly."""
    largest = profiles.uav("ardrone2")
    return pads.draw(
        world, line.cases, line.starts, largest, profiles.rover(ROVERS), seed=line.seed
    )


def _fly(how: Setting, update: Callable[[int, int], None]) -> "Fly":
    if how.profile is None:
        return evaluate.fly
    return Twin(
        how.profile,
        ROVERS,
        how.disturb,
        how.wait,
        how.steering,
        ideal=frozenset(how.ideal),
        progress=update,
    )


def _kept(path: Path, asked: dict[str, Any]) -> dict[str, Any] | None:
    """What was found before for the same line, if it was flown."""
    try:
        before = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    same = isinstance(before, dict) and before.get("asked") == asked
    return before.get("found") if same else None


def _plain(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-." else "-" for letter in name)
