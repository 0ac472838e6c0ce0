"""The base station: one pure step from poses to what robots are sent, with the supervisor in it.

The twin calls it in simulated time and the laboratory in real time, a hundred times a second.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from skydog.flight import altitude, outliers, rovers, setpoints, station, supervisor
from skydog.flight.bounds import clipped
from skydog.flight.limits import Corner, Limits
from skydog.flight.outliers import Believed
from skydog.flight.rovers import Twist
from skydog.flight.setpoints import Slide
from skydog.flight.station import Commands, Frame, Station
from skydog.flight.supervisor import Change, Mode, Order

AT_HEIGHT = 0.1  # m within which a drone is at its height
ON_FLOOR = 0.05  # m above its pad, at most
BLIND_SINK = 0.3  # m/s of a drone that lands unseen; ours
CLEARS_FOR = 8.0  # s for which a landing drone looks for a place without rovers and walls
CLEAR = 0.2  # m between a landing drone and a rover or a wall, besides their sizes
MARGIN = 0.15  # m more that it flies to: the last centimetres take an SNI loop long


class Base(NamedTuple):
    """What the base station is set to."""

    station: Station
    limits: Limits
    airspace: tuple[Corner, Corner]  # m: where set-points of drones may be; the soft fence
    arena: tuple[Corner, Corner]  # m: where those of rovers may be
    height: Float[np.ndarray, "*batch dogs"]  # m, of a mission
    slide: Slide | None = None  # how those of rovers slide along obstacles


class Memory(NamedTuple):
    """What the base station remembers."""

    station: station.Memory
    believed: Believed
    supervisor: supervisor.Memory
    now: float  # s
    decided: Float[np.ndarray, "*batch"]  # s: when a decision was last taken
    pad: Float[np.ndarray, "*batch dogs"]  # m: the altitude from which each took off
    hold: Float[np.ndarray, "*batch dogs"]  # m: the height at which each holds
    told: Float[np.ndarray, "*batch sheep"]  # s: since when each rover moves that is to stand


class Decided(NamedTuple):
    """A decision, as it reaches the base station. Velocities in m/s."""

    dogs: Float[np.ndarray, "*batch dogs 2"]
    sheep: Float[np.ndarray, "*batch sheep 2"]


class Told(NamedTuple):
    """What else the base station is told in an instant."""

    order: Int[np.ndarray, "*batch"]  # of `Order`
    ready: Bool[np.ndarray, "*batch"]  # whether the pre-flight checks pass
    battery: Float[np.ndarray, "*batch dogs"]  # share
    others: Bool[np.ndarray, "*batch"]  # whether somebody else commands a robot
    landed: Bool[np.ndarray, "*batch dogs"]  # the drones say that they stand
    flies: Bool[np.ndarray, "*batch dogs"]  # they say that they fly; silent ones say neither
    lost: Bool[np.ndarray, "*batch"]  # one says that it has no link, or an emergency
    over: Bool[np.ndarray, "*batch"]  # whether the mission is


class Sent(NamedTuple):
    """What robots are sent, and what is known of it."""

    mode: Int[np.ndarray, "*batch"]  # of `Mode`: take-off, landing and stop are read off it
    hover: Bool[np.ndarray, "*batch dogs"]  # hold still by your own sensors: nobody sees you
    commands: Commands
    age: Float[np.ndarray, "*batch bodies"]  # s, of the poses: drones first
    change: Change


def all_well(shape: tuple[int, ...], dogs: int, order: Order = Order.NONE) -> Told:
    """What is told when nothing is wrong, of a batch of missions."""
    no, yes = np.zeros(shape, bool), np.ones(shape, bool)
    return Told(
        np.full(shape, int(order)),
        yes,
        np.ones((*shape, dogs)),
        no,
        np.zeros((*shape, dogs), bool),
        np.zeros((*shape, dogs), bool),
        no,
        no,
    )


def start(base: Base, frame: Frame, now: float = 0.0, mode: Mode = Mode.DISARMED) -> Memory:
    """The memory when all stand where the first frame has them."""
    believed = outliers.start(frame, now)
    whole = frame._replace(dogs=believed.dogs, sheep=believed.sheep, yaw=believed.yaw)
    batch = frame.yaw.shape[:-1]
    pad = believed.dogs[..., 2]
    return Memory(
        station.start(base.station, whole),
        believed,
        supervisor.start(mode, batch, now),
        now,
        np.full(batch, now),
        pad,
        pad,
        np.full(frame.yaw.shape, now),
    )


def step(
    base: Base, memory: Memory, frame: Frame, told: Told, decided: Decided | None, now: float
) -> tuple[Memory, Sent]:
    """The next memory, and what is sent at `now` seconds.

    `decided` is what was decided since the step before, if anything was.
    """
    dt = round(min(max(now - memory.now, 0.001), 0.1), 6)
    mode = memory.supervisor.mode
    grounded = (mode == Mode.DISARMED) | (mode == Mode.EMERGENCY)
    believed, frame = outliers.gate(base.limits, memory.believed, frame, now, grounded)
    age = now - believed.when
    fresh = decided is not None
    if decided is not None:
        finite = _finite(decided.dogs) & _finite(decided.sheep)
        memory = memory._replace(decided=np.where(finite, now, memory.decided))
        fresh = finite
    happens = _happens(base, memory, told, age, now)
    watched, change = supervisor.step(memory.supervisor, told.order, happens, now)
    memory = _entered(base, memory, believed, watched, change, now)
    flies = memory.supervisor.mode == Mode.MISSION
    known = memory.station
    if decided is not None and flies.any():
        taken = station.take(
            base.station,
            known,
            _nothing_but(decided.dogs, flies & fresh),
            _nothing_but(decided.sheep, flies & fresh),
            base.airspace,
            base.arena,
            base.slide,
        )
        known = taken if flies.all() else _where(flies, taken, known)
    known = _restarted(known, memory.believed, frame, now, base.limits.stale)
    known = station.see(known, frame, dt)
    return _sent(base, memory._replace(station=known, believed=believed, now=now), age, change, dt)


def _happens(
    base: Base, memory: Memory, told: Told, age: Float[np.ndarray, "*batch bodies"], now: float
) -> dict[str, Bool[np.ndarray, "*batch"]]:
    """Which of the supervisor's events are the case."""
    limits, known = base.limits, memory.station
    at, watched = known.dogs.position, memory.supervisor
    oldest = age.max(axis=-1)
    # A base station that stood still was blind as long.
    stood = now - memory.now > limits.blind
    for_so_long = now - watched.since
    spans = (limits.x, limits.y, limits.z)
    out = [(at[..., axis] < span[0]) | (at[..., axis] > span[1]) for axis, span in enumerate(spans)]
    outside = (out[0] | out[1] | out[2]).any(axis=-1)
    silent = now - memory.decided > limits.silence
    low = (at[..., 2] < limits.lowest).any(axis=-1)
    high = (np.abs(base.height - at[..., 2]) < AT_HEIGHT).all(axis=-1)
    stale = oldest > limits.stale
    moving = np.hypot(known.sheep.velocity[..., 0], known.sheep.velocity[..., 1])
    runs = (moving > limits.runaway) & (now - memory.told > limits.runs_for)
    on_floor = (at[..., 2] - memory.pad < ON_FLOOR) & (age[..., : at.shape[-2]] <= limits.stale)
    on_floor = on_floor & ~told.flies
    climbing = (memory.hold < base.height - AT_HEIGHT).any(axis=-1)
    happens = {
        "hard fence": outside,
        "eyes stale long": (oldest > limits.blind) | stood,
        "battery low": (told.battery < limits.battery).any(axis=-1),
        "second publisher": told.others,
        "a rover runs away": runs.any(axis=-1),
        "hold too long": (for_so_long > limits.longest_hold) & ~watched.held,
        "take-off too long": for_so_long > limits.longest_take_off,
        "mission over": told.over,
        "landed": (told.landed | on_floor).all(axis=-1) & (for_so_long > 1.0),
        "eyes stale": stale,
        "policy silent": silent,
        "drone too low": low & ~climbing,
        "drone lost": told.lost,
        "drone stands": told.landed.any(axis=-1),
        "climbing": climbing,
        "ready": told.ready & ~stale,
        "well": ~stale & ~silent,
        "at height": high,
    }
    return {name: np.asarray(happening) for name, happening in happens.items()}


def _entered(
    base: Base,
    memory: Memory,
    believed: Believed,
    watched: supervisor.Memory,
    change: Change,
    now: float,
) -> Memory:
    """The memory after the supervisor's step: what a mode sets when it is entered."""
    memory = memory._replace(supervisor=watched)
    entered = watched.mode != change.before
    if not entered.any():
        return memory
    here = memory.station.dogs.position
    takes_off = (entered & (watched.mode == Mode.TAKING_OFF))[..., None]
    takes_off &= (change.before == Mode.READY)[..., None]
    begins = entered & (watched.mode == Mode.MISSION)
    stops = entered & (watched.mode > Mode.MISSION)
    climbing = (stops & (change.before == Mode.TAKING_OFF))[..., None]
    held = np.where(climbing, np.minimum(base.height, here[..., 2]), base.height)
    stood = station.stand(base.station, memory.station)
    held_at = clipped(stood.dog_setpoint.origin, *base.airspace)
    stood = stood._replace(dog_setpoint=setpoints.stand(held_at))
    # Who takes off may have been carried since it was seen first: its loops begin anew.
    level = np.zeros_like(stood.lag)
    begun = stood._replace(lag=level, trim=level, command=np.zeros_like(stood.command))
    return memory._replace(
        station=_where(takes_off[..., 0], begun, _where(stops, stood, memory.station)),
        decided=np.where(begins, now, memory.decided),
        pad=np.where(takes_off, believed.dogs[..., 2], memory.pad),
        hold=np.where((stops | begins)[..., None], held, memory.hold),
    )


def _sent(
    base: Base, memory: Memory, age: Float[np.ndarray, "*batch bodies"], change: Change, dt: float
) -> tuple[Memory, Sent]:
    """What is sent in the mode that is now."""
    limits, watched, now = base.limits, memory.supervisor, memory.now
    mode, dogs = watched.mode, base.height.shape[-1]
    blind = age[..., :dogs] > limits.stale
    known, shown = memory.station, mode
    if (mode == Mode.LANDING).any():
        known, clearing = _clear(base, known, mode, now - watched.since, blind)
        shown = np.where(clearing, Mode.HOLD, mode)
    held = (mode >= Mode.HOLD)[..., None]
    height = np.where(held, memory.hold, base.height)
    # The set-point runs on from the latest decision; one that stands stays.
    elapsed = np.minimum(now - memory.decided, base.station.period)
    elapsed = np.where(mode == Mode.MISSION, np.maximum(elapsed, 0.0), 0.0)
    flown, commands = station.act(base.station, known, _rounded(elapsed), height, dt)
    moves = (mode == Mode.TAKING_OFF) | (mode == Mode.MISSION) | (mode >= Mode.HOLD)
    moves &= mode != Mode.EMERGENCY
    hover = blind & moves[..., None]
    velocity, tilt, twist = commands
    if not (mode == Mode.MISSION).all() or hover.any():
        lands = (shown == Mode.LANDING)[..., None]
        sink = np.where(
            blind,
            -BLIND_SINK,
            altitude.land(base.station.uav, known.dogs.position[..., 2] - memory.pad),
        )
        climb = np.where(lands, sink, np.where(blind, 0.0, velocity[..., 2]))
        level = np.where(hover[..., None], 0.0, velocity[..., :2])
        velocity = np.concatenate([level, climb[..., None]], axis=-1)
        velocity = np.where(moves[..., None, None], velocity, 0.0)
        tilt = np.where((hover | ~moves[..., None])[..., None], 0.0, tilt)
        drives = (mode == Mode.MISSION)[..., None]
        still = rovers.within_limits(
            base.station.rover,
            memory.station.twist,
            Twist(np.zeros_like(twist.speed), np.zeros_like(twist.turn_rate)),
            dt,
        )
        cut = (mode == Mode.EMERGENCY)[..., None]
        twist = Twist(
            np.where(drives, twist.speed, np.where(cut, 0.0, still.speed)),
            np.where(drives, twist.turn_rate, np.where(cut, 0.0, still.turn_rate)),
        )
    stands = (np.abs(twist.speed) < 0.02) & (np.abs(twist.turn_rate) < 0.1)
    # Half of it, so that noise neither makes a rover run nor hides one that does.
    rolls = np.hypot(*np.moveaxis(flown.sheep.velocity, -1, 0)) > 0.5 * limits.runaway
    memory = memory._replace(
        station=flown._replace(command=velocity, twist=twist),
        told=np.where(stands & rolls, memory.told, now),
    )
    return memory, Sent(shown, hover, Commands(velocity, tilt, twist), age, change)


def _clear(
    base: Base,
    known: station.Memory,
    mode: Int[np.ndarray, "*batch"],
    landing_for: Float[np.ndarray, "*batch"],
    blind: Bool[np.ndarray, "*batch dogs"],
) -> tuple[station.Memory, Bool[np.ndarray, "*batch"]]:
    """Set-points beside rovers and walls, and which drones still fly there before they land.

    The walls of an arena stand just outside it. A drone that lands on one slides on, to the fence.
    """
    uav, rover = base.station.uav.body, base.station.rover.body
    needed = uav.radius + rover.radius + CLEAR
    least, most = base.arena[0] + uav.radius + CLEAR, base.arena[1] - uav.radius - CLEAR
    spot = known.dog_setpoint.origin
    for _ in range(4):
        away = spot[..., :, None, :] - known.sheep.position[..., None, :, :]
        far = np.hypot(away[..., 0], away[..., 1])
        nearest = np.argmin(far, axis=-1)[..., None]
        gap = np.take_along_axis(far, nearest, axis=-1)
        to = np.take_along_axis(away, nearest[..., None], axis=-2)[..., 0, :]
        to = np.where(gap > 1e-6, to / np.maximum(gap, 1e-6), (1.0, 0.0))
        spot = spot + np.maximum(needed + MARGIN - gap, 0.0) * to
        spot = clipped(spot, least + MARGIN, most - MARGIN)
    here = known.dogs.position[..., :2]
    away = here[..., :, None, :] - known.sheep.position[..., None, :, :]
    covers = (np.hypot(away[..., 0], away[..., 1]) < needed).any(axis=(-1, -2))
    covers |= ((here < least) | (here > most)).any(axis=(-1, -2))
    x, y = base.limits.x, base.limits.y
    # Who is beyond the fence comes down there, rather than fly on by poses that may be wrong.
    inside = (here[..., 0] >= x[0]) & (here[..., 0] <= x[1])
    inside &= (here[..., 1] >= y[0]) & (here[..., 1] <= y[1])
    covers &= inside.all(axis=-1)
    clearing = (mode == Mode.LANDING) & covers & (landing_for < CLEARS_FOR) & ~blind.any(axis=-1)
    lands = (mode == Mode.LANDING)[..., None, None]
    origin = np.where(lands, spot, known.dog_setpoint.origin)
    return known._replace(dog_setpoint=setpoints.Setpoint(origin, known.dog_setpoint.velocity)), (
        clearing
    )


def _restarted(
    known: station.Memory, before: Believed, frame: Frame, now: float, stale: float
) -> station.Memory:
    """The estimates, begun anew for a body that is seen again after a while."""
    lost = now - before.when > stale
    dogs = frame.dogs_seen.shape[-1]
    again = lost & np.concatenate([frame.dogs_seen, frame.sheep_seen], axis=-1)
    if not again.any():
        return known
    return station.anew(known, frame, again[..., :dogs], again[..., dogs:])


def _where(which: Bool[np.ndarray, "*batch"], some: Any, others: Any) -> Any:
    """The trees of some missions, and those of the others. Arrays of any depth."""
    if isinstance(some, tuple):
        parts = [_where(which, one, other) for one, other in zip(some, others, strict=True)]
        return type(some)(*parts)
    return np.where(which.reshape(which.shape + (1,) * (some.ndim - which.ndim)), some, others)


def _finite(velocity: Float[np.ndarray, "*batch bodies 2"]) -> Bool[np.ndarray, "*batch"]:
    return np.asarray(np.isfinite(velocity).all(axis=(-1, -2)))


def _nothing_but(
    velocity: Float[np.ndarray, "*batch bodies 2"], which: Bool[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch bodies 2"]:
    """The velocities of missions that count, and zero of the others."""
    return np.where(which[..., None, None], velocity, 0.0)


def _rounded(elapsed: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 1 1"]:
    return np.round(elapsed, 6)[..., None, None]
