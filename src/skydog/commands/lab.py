"""`skydog lab`: fly a laboratory, or emulate one on this machine."""

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from skydog import files
from skydog.commands.flags import (
    STOPPED,
    FlightSteps,
    Json,
    MaybeOut,
    Seed,
    Sheepdog,
    Speed,
    Wait,
)
from skydog.errors import Refusal, one_line

if TYPE_CHECKING:
    from skydog.lab.orders import Orders
    from skydog.lab.outcome import Outcome
    from skydog.lab.site import Site

VERBS = ("check", "faults", "recover")
USAGE = (
    "try skydog lab SITE.toml, skydog lab --emulate, skydog lab check SITE.toml, "
    "skydog lab faults or skydog lab recover LOG"
)
Adapter = Literal[
    "tum-simulator", "ardrone-autonomy", "twist-dds", "crazyswarm2", "crazyflie", "mavlink"
]


def lab(
    what: Positional[
        Annotated[tuple[str, ...], arg(metavar="SITE.toml|check|faults|recover")]
    ] = (),
    emulate: bool = False,
    faults: Annotated[str | None, arg(metavar="NAME")] = None,
    transport: Literal["ros1", "dds"] | None = None,
    adapter: Adapter | None = None,
    sheepdog: Sheepdog = "h-ddpg-6x6",
    disturb: Annotated[str, arg(metavar="NAME")] = "lab",
    speed: Speed = 1.0,
    wait: Wait = None,
    steps: FlightSteps = 1000,
    seed: Seed = 0,
    out: MaybeOut = None,
    as_json: Json = False,
) -> int:
    """Fly a sheepdog in a laboratory, with motion capture and a safety supervisor.

    SITE.toml describes the laboratory: see docs/lab.md and examples/sites. Nothing takes off
    before you say so. The space key stops: once to hold, twice to land, three times to cut the
    motors.

    skydog lab --emulate runs the whole chain on this machine instead, in real time: the physics
    twin, a tracker over UDP, a ROS master or DDS. skydog lab check SITE.toml says line by line
    what is missing or wrong in a site file. skydog lab faults injects one fault after another in
    emulated flights. skydog lab recover LOG repairs the log of a flight that was killed.

    Example: skydog lab --emulate --faults silent-1

    Args:
        what: A site file to fly; or check and a site file; or faults, with names of faults or
            none for all; or recover and the log of a flight.
        emulate: Fly an emulated laboratory on this machine.
        faults: The fault of an emulated flight, three seconds after the mission begins. The
            flight uses ros1.
        transport: The protocol of an emulated flight: ros1, or dds, which ROS 2 uses. If not
            given, ros1 if rospy is installed, else dds.
        adapter: The emulated drone; if not given, ardrone-autonomy, and over dds twist-dds.
        sheepdog: The shepherd of an emulated flight: a file, run folder or name, or a rule.
        disturb: The disturbances during an emulated flight: none, mild or lab.
        speed: Share of the world's speeds at which an emulated flight moves.
        wait: Take the next set-point only when the drone is nearer than this to the last one.
        steps: Maximum steps of an emulated mission.
        seed: Random seed of an emulated flight: of its start and its disturbances.
        out: The folder of the flight log; runs/lab/ and the time if not given.
        as_json: Print the results as JSON.
    """
    verb = what[0] if what and what[0] in VERBS else ""
    named = what[1:] if verb else what
    if verb == "faults":
        return _campaign(named, out, as_json)
    if faults is not None and not emulate:
        raise Refusal(f"--faults {faults} is for emulated flights; try --emulate too")
    if emulate:
        if what:
            raise Refusal(f"--emulate makes its own site, got {what[0]!r:.60} too; leave it out")
        if faults is not None:
            if transport == "dds" or adapter is not None:
                raise Refusal(
                    "faults are flown by ardrone-autonomy over ros1; leave out the others"
                )
            return _campaign((faults,), out, as_json)
        flown = _emulate(
            transport,
            adapter,
            sheepdog,
            disturb,
            speed,
            wait,
            steps,
            seed,
            _home(out),
        )
        return _report(*flown, as_json)
    if len(named) != 1:
        raise Refusal(f"lab flies one site file, got {len(named)} names; {USAGE}")
    path = Path(named[0])
    if verb == "recover":
        from skydog.lab import flightlog

        flightlog.recover(path)
        print(path)
        return 0
    if verb == "check":
        return _check(path, as_json)
    return _report(*_fly(path, _home(out)), as_json)


def _transport() -> Literal["ros1", "dds"]:
    """ROS 1 where it is installed."""
    from importlib.util import find_spec

    there = find_spec("rospy") is not None and find_spec("rosmaster") is not None
    return "ros1" if there else "dds"


def _home(out: Path | None) -> Path:
    home = out or Path("runs") / "lab" / time.strftime("flight-%Y%m%d-%H%M%S")
    if files.exists(home):
        raise Refusal(f"{home} is there already; choose another folder for the log")
    return home


def _fly(path: Path, log: Path) -> tuple["Outcome", Path]:
    """Fly a site file, a human at the keys."""
    from skydog.lab import check, running, setup, site
    from skydog.lab.orders import Orders

    found = site.load(path)
    wrong = [line for line in check.lines(found) if not line.ok]
    if wrong:
        raise Refusal(f"{path}: {wrong[0].what}: {wrong[0].write}; try skydog lab check {path}")
    made = setup.setup(found)
    orders = Orders()
    with _operator(orders), ExitStack() as stack:
        board = stack.enter_context(_board(found))
        outcome = running.fly(
            found,
            orders,
            running.Operated(orders),
            log,
            path.read_text("utf-8"),
            board.show,
            board.said,
            made,
            path.parent,
        )
    return outcome, log


def _emulate(
    transport: Literal["ros1", "dds"] | None,
    adapter: Adapter | None,
    sheepdog: str,
    disturb: str,
    speed: float,
    wait: float | None,
    steps: int,
    seed: int,
    log: Path,
) -> tuple["Outcome", Path]:
    """Fly an emulated laboratory; it arms and takes off by itself."""
    import jax
    import numpy as np

    from skydog.commands import console
    from skydog.flight import profiles
    from skydog.lab import running, setup
    from skydog.lab.emulation.chain import Chain, a_site
    from skydog.lab.emulation.room import Start
    from skydog.lab.orders import Orders
    from skydog.lab.site import Mission
    from skydog.twin import Twin, starts
    from skydog.world import presets

    Twin(disturb=disturb, wait=wait).check()
    world = presets.preset("paper-physical")
    size = float(world.arena.size)
    mission = Mission(sheepdog=sheepdog, speed=speed, wait=wait, steps=steps)
    chosen = transport or _transport()
    site = a_site(mission, size, chosen, adapter)
    made = setup.setup(site)
    uav, rover = profiles.uav(site.uav[0].profile), profiles.rover(site.ugv[0].profile)
    drawn = starts.draw(world, 1, "spaced", uav, rover, seed)
    arena = world.arena
    start = Start(
        dogs=tuple((float(x), float(y)) for x, y in np.asarray(drawn.dogs[0])),
        sheep=tuple((float(x), float(y)) for x, y in np.asarray(drawn.sheep[0])),
        size=size,
        goal=(float(arena.goal_x), float(arena.goal_y), float(arena.goal_radius)),
        disturb=disturb,
        key=tuple(np.asarray(jax.random.key_data(jax.random.key(seed))).tolist()),
    )
    if chosen != (transport or "ros1"):
        console.say("There is no ROS 1 here (make ros, or apt install python3-rospy): over DDS.")
    console.say("Starting the emulated laboratory: its room, its tracker, its robots.")
    orders = Orders()
    with _operator(orders), Chain(site, start) as chain, ExitStack() as stack:
        board = stack.enter_context(_board(chain.site))
        outcome = running.fly(
            chain.site,
            orders,
            running.Automatic(orders),
            log,
            running.as_json(chain.site),
            board.show,
            board.said,
            made,
            log.parent,
        )
    return outcome, log


def _board(site: "Site") -> Any:
    from skydog.commands import console
    from skydog.lab.dashboard import Dashboard

    return Dashboard(console.progress_console, site)


@contextmanager
def _operator(orders: "Orders") -> Iterator[None]:
    """Keys give orders, and signals do not kill what flies: Ctrl-C is a stop, others land."""
    from skydog.flight.supervisor import Order
    from skydog.lab.orders import Keys

    def stop(*_: object) -> None:
        orders.quits = True
        orders.give(Order.STOP, "Ctrl-C")

    def land(*_: object) -> None:
        orders.quits = True
        orders.give(Order.LAND, "a signal to end")

    heard = {signal.SIGINT: stop, signal.SIGQUIT: stop, signal.SIGTSTP: stop}
    heard |= {signal.SIGTERM: land, signal.SIGHUP: land}  # a terminal that is closed lands, too
    before = {number: signal.signal(number, handler) for number, handler in heard.items()}
    try:
        with Keys(orders):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _check(path: Path, as_json: bool) -> int:
    """Print what a site file has, and what to write."""
    import json

    from skydog.commands import console
    from skydog.lab import check, site

    lines = check.lines(site.load(path))
    if as_json:
        print(json.dumps([line._asdict() for line in lines], indent=2))
    else:
        screen = console.ResultConsole()
        for line in lines:
            mark = "[green]ok[/]   " if line.ok else "[red]write[/]"
            screen.print(mark, end=" ")
            screen.print(one_line(line.what), highlight=False, markup=False)
            if line.write:
                write = f"      {one_line(line.write)}"
                screen.print(write, highlight=False, markup=False, soft_wrap=True)
    return 0 if all(line.ok for line in lines) else 2


def _campaign(names: tuple[str, ...], out: Path | None, as_json: bool) -> int:
    """Break one thing after another in emulated flights, and print what came of each."""
    import json

    from rich.table import Table

    from skydog.commands import console
    from skydog.lab.emulation import campaign, faults, verdict
    from skydog.study import report

    chosen = [faults.named(name).name for name in names or faults.FAULTS]
    home = files.folder(out or Path("runs") / "lab" / time.strftime("faults-%Y%m%d-%H%M%S"))
    rows: list[verdict.Row] = []

    def keep(row: verdict.Row) -> None:
        rows.append(row)
        found = [each._asdict() for each in rows]
        files.write_text(home / "faults.json", json.dumps(files.plain(found), indent=2))
        files.write_text(home / "faults.md", report.markdown_table(*verdict.table(rows)))
        said = "as expected" if row.as_expected else row.problem
        console.say(f"{len(rows)} of {len(chosen)}: {row.name}: {said}")

    console.say(f"Flying {len(chosen)} faults, half a minute each; Ctrl-C keeps what was flown.")
    # Ctrl-C must end the processes of the chain too, so it is no sudden end here.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        campaign.campaign(chosen, home, None, keep)
    finally:
        signal.signal(signal.SIGINT, before)
    if as_json:
        print(json.dumps(files.plain([row._asdict() for row in rows]), indent=2))
    else:
        head, body = verdict.table(rows)
        shown = Table(*head)
        for cells in body:
            shown.add_row(*cells)
        console.print_table(shown)
    console.say(f"Everything is in {home}.")
    if len(rows) < len(chosen):
        return STOPPED
    return 0 if all(row.as_expected for row in rows) else 1


def _report(outcome: "Outcome", log: Path, as_json: bool) -> int:
    """Print how a flight went: its metrics if it flew a mission, and how it kept time."""
    import json

    import numpy as np

    from skydog.commands import console
    from skydog.lab import flightlog
    from skydog.study import evaluate

    console.say(f"The flight log is {log}; see it by skydog replay {log}")
    times = {
        name: {f"p{share}": float(np.percentile(values, share)) for share in (50, 99, 100)}
        for name in ("jitter", "latency", "decide")
        if (values := getattr(outcome.times, name))
    }
    result: dict[str, Any] = {
        "ended": outcome.how,
        "steps": outcome.steps,
        "times": times,
        "ticks": len(outcome.times.jitter),
        "missed": outcome.times.missed,
        "blind": outcome.times.blind,
    }
    if outcome.steps:
        result |= evaluate.row(evaluate.stack([flightlog.load(log)[0]]))
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        print(f"{outcome.how} after {outcome.steps} steps")
        for name, values in times.items():
            print(f"{name}: " + ", ".join(f"{p} {1e3 * v:.2f} ms" for p, v in values.items()))
        print(f"deadlines missed: {outcome.times.missed} of {len(outcome.times.jitter)}")
    return 0 if outcome.how == "accomplished" else 1
