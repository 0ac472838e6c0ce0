"""The command `skydog`: parse, call, print. What a command needs is imported when it runs."""

import json
import os
import platform
import shlex
import signal
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg

from skydog.errors import Refusal
from skydog.words import AtPoint, Learner, Reward, Starts

STOPPED = 130  # what a shell says of a command that Ctrl-C ended

Out = Annotated[Path, arg(metavar="FOLDER")]
Preset = Annotated[str, arg(metavar="NAME")]

app = tyro.extras.SubcommandApp()


@app.command
def herd(
    out: Out = Path("runs/herd"),
    seed: int = 0,
    steps: int = 150_000,
    arena: Annotated[float, arg(metavar="METRES")] = 4.0,
    reward: Reward = "progress",
    cases: int = 30,
    resume: bool = False,
    as_json: Annotated[bool, arg(name="json")] = False,
) -> int:
    """Teach a sheepdog from nothing, and fly it beside the rule dog.

    Trains collect and drive, flies the test cases with the sheepdog and with Strömbom's rule
    dog, prints the table beside the paper's, and writes a run folder with results.json, the
    sheepdog, figures, and report.html with an animated replay. Ctrl-C keeps what was learnt.

    Example: skydog herd --out runs/mine --seed 3

    Args:
        out: The run folder.
        seed: Of the networks, the lessons' starts and the noise.
        steps: Of training, for each of the two skills.
        arena: Side of the arena in metres, for the lessons and the test.
        reward: How a lesson pays; `paper` is the paper's ±0.1.
        cases: Missions that each shepherd flies.
        resume: Continue an interrupted run, bit for bit.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog import herd as job

    course = job.Course(arena=arena, reward=reward, steps=steps)
    results = job.herd(out, course, seed, cases, resume, _command())
    if results is None:
        return STOPPED
    _show(results, as_json)
    return 0


@app.command
def train(
    out: Out = Path("runs/train"),
    seed: int = 0,
    seeds: int = 1,
    steps: int = 150_000,
    preset: Preset = "paper",
    arena: Annotated[float | None, arg(metavar="METRES")] = None,
    sheep: int = 3,
    learner: Learner = "ddpg",
    reward: Reward = "progress",
    resume: bool = False,
    tensorboard: bool = False,
    as_json: Annotated[bool, arg(name="json")] = False,
) -> int:
    """Teach one sheepdog, or several at once, and test each.

    Every sheepdog is two trainings, collect and drive, and every training has a core of its
    own. Its folder holds learning curves as CSV, checkpoints, and at the end the sheepdog.
    Ctrl-C keeps what was learnt, and --resume continues bit for bit.

    Example: skydog train --seeds 8 --out runs/eight

    Args:
        out: The run folder; of several sheepdogs each has its own in it, such as seed-3.
        seed: Of the first sheepdog.
        seeds: How many sheepdogs, one a seed.
        steps: Of training, for each of the two skills.
        preset: The world of the lessons; see skydog presets.
        arena: Side of the arena in metres; the preset's own if not given.
        sheep: Sheep in the flock.
        learner: `ddpg` makes the paper's H-DDPG; `dqn` its predecessor DHRL, of four actions.
        reward: How a lesson pays; `paper` is the paper's ±0.1.
        resume: Continue an interrupted run, bit for bit.
        tensorboard: Write the curves for TensorBoard too, in the run folder.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog import herd as job

    course = job.Course(preset, arena, sheep, reward, steps, learner)
    results = job.train(out, course, seed, seeds, resume, tensorboard, _command())
    if results is None:
        return STOPPED
    _show(results, as_json, as_paper=preset == "paper")
    return 0


@app.command
def test(
    shepherd: Positional[Annotated[str, arg(metavar="SHEEPDOG|strombom")]],
    preset: Preset = "paper",
    arena: Annotated[float | None, arg(metavar="METRES")] = None,
    sheep: int = 3,
    dogs: int = 1,
    cases: int = 30,
    starts: Starts = "paper",
    seed: int = 0,
    at_point: AtPoint = "constant",
    out: Annotated[Path | None, arg(metavar="FOLDER")] = None,
    as_json: Annotated[bool, arg(name="json")] = False,
) -> int:
    """Fly a shepherd through test cases, and print how good it is.

    A sheepdog is named by its file, its run folder, or its name among those that ship, such as
    h-ddpg-4x4; flown in an arena other than the one it learnt in, it scales what it sees and
    does by ξ, as in the paper.

    Example: skydog test runs/herd --arena 6 --cases 1000 --starts random

    Args:
        shepherd: A sheepdog's file, run folder or name, or the rule dog, strombom.
        preset: The world of the missions; see skydog presets.
        arena: Side of the arena in metres; the preset's own if not given.
        sheep: Sheep in the flock.
        dogs: Dogs, which all fly the same shepherd.
        cases: How many missions.
        starts: `paper` varies where the dogs start, `random` where the sheep do too.
        seed: Of the starts.
        at_point: Whether strombom keeps its speed at its point, or stops there.
        out: Where to write results.json and a trace a mission, if given.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog import testing as job
    from skydog.world import params

    world = params.preset(preset, arena, sheep)
    results = job.test(shepherd, world, cases, starts, seed, sheep, dogs, at_point, out)
    _show(results, as_json, as_paper=(preset, starts, dogs) == ("paper", "paper", 1))
    return 0


@app.command
def reproduce(
    out: Out = Path("runs/reproduce"),
    seeds: int = 8,
    episodes: int = 3_000,
    from_zoo: bool = False,
    as_json: Annotated[bool, arg(name="json")] = False,
) -> int:
    """Regenerate the paper's simulation study beside its own numbers.

    Trains every sheepdog of the study, flies the paper's eight scenarios and more, and writes
    report.html and results.json with every table, figure and claim, and a verdict on each.
    Stopped by Ctrl-C, it continues where it was when it is called again.

    Example: skydog reproduce --from-zoo

    Args:
        out: The run folder.
        seeds: Sheepdogs of each kind.
        episodes: Of each skill's lessons; the paper has 3000.
        from_zoo: Train nothing; fly the sheepdogs that ship.
        as_json: Print the results as JSON instead of a table.
    """
    from skydog import reproduce as job
    from skydog.study import reproduction

    results = job.reproduce(out, job.Plan(seeds, episodes), from_zoo, _command())
    if results is None:
        return STOPPED
    if as_json:
        print(json.dumps(results, indent=2))
    else:
        from rich.console import Console

        from skydog.study import report

        Console().print(report.table(reproduction.rows(results)))
    return 0


@app.command
def replay(
    traces: Positional[Annotated[tuple[Path, ...], arg(metavar="TRACE")]],
    out: Annotated[Path, arg(aliases=["-o"], metavar="FILE")] = Path("replay.html"),
) -> int:
    """Show missions again: an animated page for the browser, a GIF or an MP4.

    Example: skydog replay runs/herd/traces/H-DDPG-4x4.safetensors -o flock.mp4

    Args:
        traces: Missions, as skydog herd and skydog test --out write them.
        out: The page; or, by its ending, .gif or .mp4, a film of the missions side by side.
    """
    from skydog.study import traces as store
    from skydog.view import replay as view

    if not traces:
        raise Refusal("replay needs a trace; try skydog replay runs/herd/traces/*.safetensors")
    stems = [path.stem for path in traces]
    named = {path.stem if stems.count(path.stem) == 1 else str(path): path for path in traces}
    view.save(out, {name: store.load(path)[0] for name, path in named.items()})
    print(out)
    return 0


@app.command
def watch(
    shepherd: Positional[Annotated[str, arg(metavar="SHEEPDOG|strombom")]] = "h-ddpg-4x4",
    preset: Preset = "paper",
    arena: Annotated[float | None, arg(metavar="METRES")] = None,
    sheep: int = 3,
    dogs: int = 1,
    host: str = "127.0.0.1",
    port: int = 8020,
    open_browser: bool = False,
) -> int:
    """Play with a flock in the browser: drag the dog or the goal, or fly against the sheepdog.

    Serves a page at an address of this machine until Ctrl-C. On the page, choose who flies, the
    preset, the arena, sheep, dogs, speed and noise; pause, step, and race the sheepdog.

    Example: skydog watch h-ddpg-4x4 --sheep 12 --open-browser

    Args:
        shepherd: A sheepdog's file, run folder or name, or the rule dog, strombom.
        preset: The world that pages begin with; see skydog presets.
        arena: Side of the arena in metres; as wide as the flock needs if not given.
        sheep: Sheep in the flock, 1 to 200.
        dogs: Dogs, 1 to 8.
        host: The address to listen at; another than 127.0.0.1 lets others in.
        port: The port to listen at; 0 is any that is free.
        open_browser: Open the page in the browser at once.
    """
    from skydog.view import live

    def ready(url: str) -> None:
        print(f"{url}  (Ctrl-C ends)", flush=True)
        if open_browser:
            import webbrowser

            webbrowser.open(url)

    live.serve(live.roster(shepherd), shepherd, preset, arena, sheep, dogs, host, port, ready)
    return 0


@app.command
def export(
    sheepdog: Positional[Annotated[str, arg(metavar="SHEEPDOG")]],
    onnx: bool = False,
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")] = None,
    preset: Preset = "paper",
    arena: Annotated[float | None, arg(metavar="METRES")] = None,
) -> int:
    """Write a sheepdog as one file that flies without skydog.

    An ONNX file holds the gate, both skills and the dog's limits: positions in metres go in, and
    a velocity in m/s comes out, for one dog and any number of sheep. The world is inside, so
    that another arena is another file. See docs/export.md.

    Example: skydog export h-ddpg-4x4 --onnx -o dog.onnx --arena 6

    Args:
        sheepdog: Its file, run folder or name, such as h-ddpg-4x4.
        onnx: As ONNX, the only format so far.
        out: The file; if not given, the sheepdog's name, or its run folder's, and .onnx.
        preset: The world that it is to fly in; see skydog presets.
        arena: Side of the arena in metres; the one that it learnt in if not given.
    """
    if not onnx:
        raise Refusal("export needs a format; add --onnx")
    from skydog.shepherds import exporting, store
    from skydog.world import params

    dog, card = store.read(sheepdog)
    world = params.preset(preset, float(dog.arena) if arena is None else arena)
    file = store.find(Path(sheepdog))
    own = file.absolute().parent.name if file.name == store.FILE else file.stem
    out = out or Path(f"{own}.onnx")
    exporting.export(out, dog, world, card)
    print(out)
    return 0


@app.command
def presets(as_json: Annotated[bool, arg(name="json")] = False) -> int:
    """List the named sets of parameters, with their values in SI units.

    Example: skydog presets --json

    Args:
        as_json: Print them as JSON instead of a table.
    """
    from rich.console import Console
    from rich.table import Table

    from skydog.world import params

    values = {name: params.flatten(params.preset(name)) for name in params.PRESETS}
    if as_json:
        print(json.dumps(values, indent=2))
        return 0
    table = Table("Parameter", *values, title="Presets (metres, seconds, m/s)")
    for name in next(iter(values.values())):
        table.add_row(name, *(str(preset[name]) for preset in values.values()))
    console = Console()
    console.print(table)
    for name, preset in params.PRESETS.items():
        console.print(f"[bold]{name}[/]: {(preset.__doc__ or '').splitlines()[0]}")
    return 0


def main() -> None:
    """Run the command line; a `Refusal` is one line and exit code 2."""
    _keep_compiled()
    # At once and without unwinding: files are written whole or not at all, and an exception
    # that is raised inside a callback of jax gets lost. Trainings listen for themselves.
    before = signal.signal(signal.SIGINT, _stop)
    try:
        code = app.cli(
            prog="skydog",
            description="Aerial shepherding: one drone herds a swarm of ground robots.\n\n"
            "Example: skydog herd",
            config=(OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
        )
    except Refusal as refusal:
        print(f"skydog: {refusal}", file=sys.stderr)
        code = 2
    finally:
        signal.signal(signal.SIGINT, before)
    sys.exit(code)


def _keep_compiled() -> None:
    """Let jax keep what it compiles, for the next call and for the workers of this one.

    In the user's own cache folder, which nobody else may write to, since what lies there is run;
    a folder for each kind of processor, since homes are shared between machines.
    """
    with suppress(OSError, RuntimeError):  # a home that cannot be written has no cache
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        kept = home / "skydog" / f"compiled-{_processor()}"
        kept.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(kept))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
        # XLA warns, in pages, that its own tuning hints are no features of the processor. What
        # goes wrong in earnest is raised, too. 1 is what jax sets where nobody has.
        if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":
            os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"


def _processor() -> str:
    """A mark of what the processor can do."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else [platform.processor()]
    able = next((line for line in lines if line.startswith(("flags", "Features"))), lines[0])
    return f"{platform.machine()}-{zlib.crc32(able.encode()):08x}"


def _stop(*_: object) -> None:
    print("\nskydog: stopped", file=sys.stderr, flush=True)
    os._exit(STOPPED)


def _command() -> str:
    return shlex.join(["skydog", *sys.argv[1:]])


def _show(results: dict[str, Any], as_json: bool, as_paper: bool = True) -> None:
    if as_json:
        print(json.dumps(results if len(results) > 1 else next(iter(results.values())), indent=2))
        return
    from rich.console import Console

    from skydog.study import report

    Console().print(report.table(report.rows(results, as_paper)))


if __name__ == "__main__":
    main()
