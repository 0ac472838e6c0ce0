"""Missions in the twin: `Twin` is a `Fly`, and flies every shepherd by what a laboratory would run.

A decision is the kinematic world's own `decide`, on what motion capture sees; `skydog.flight` makes
of it what drones and rovers are commanded, and physics does the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import inf
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog import numerics, quantities
from skydog.errors import Refusal
from skydog.flight import altitude, base, profiles, rovers, setpoints, station
from skydog.flight.base import Base, Decided
from skydog.flight.limits import Corner, Limits
from skydog.flight.options import Steering
from skydog.flight.station import DT, Frame, Station
from skydog.flight.supervisor import Mode, Order
from skydog.twin import bodies, plant
from skydog.twin import starts as pads
from skydog.twin.deciding import decide, sliding
from skydog.twin.disturbances import DISTURBANCES, Disturbances
from skydog.twin.noise import Drawn, Luck
from skydog.twin.plant import Plant, Truth
from skydog.twin.record import Record, hold
from skydog.world import memory, mission, params
from skydog.world.mission import MAX_STEPS, Decision, Shepherd
from skydog.world.params import World
from skydog.world.state import State
from skydog.world.trace import (
    ACCOMPLISHED,
    DOWN,
    LEFT,
    OUT_OF_TIME,
    STOPPED,
    UPSET,
    Ending,
    Poses,
    Trace,
)

SETTLES = 3.0  # s after the climb, before a mission begins
LONGEST_CLIMB = 600.0  # s, of a take-off; ours
BEYOND = 0.5  # m beyond airspace and walls where the cage hangs; ours


@dataclass(frozen=True)
class Twin:
    """The physics simulation of one kind of drone and one of rover. It is a `Fly`.

    `wait` is the tolerance in metres within which a waypoint counts as reached before the next
    set-point is taken (the paper's laboratory); None takes one at every step. `threads` are the
    cores that missions are flown on, 0 all; what is flown is the same for any number.
    """

    profile: str = "tum-simulator"  # a drone: a name that ships, or a TOML file
    rovers: str = "kobuki"
    disturb: str | Disturbances = "none"
    wait: float | None = None
    steering: Steering = "reference"
    ideal: frozenset[str] = frozenset()  # bodies, "sheep" or "dogs", that move as decided
    threads: int = 0
    timestep: float = bodies.TIMESTEP  # s, of the physics
    # Told the step, and how many missions are over by then.
    progress: Callable[[int, int], None] | None = None

    @numerics.ours()
    def __call__(
        self,
        world: World,
        shepherd: Shepherd,
        starts: State,
        steps: int = MAX_STEPS,
        key: PRNGKeyArray | None = None,
        /,
    ) -> Trace:
        """One mission per start: a trace, cases along its first axis, with poses and endings.

        Drones take off from where they start, and a mission begins once they hold their height.
        `key` draws the disturbances, and the noise that the world asks for; None is the key 0.
        Raises `Refusal` for a start that cannot be flown, for a `world.arena.dt` that is no
        multiple of `station.DT`, and for an option that is none.
        """
        self.check()
        return Flight(self, world, shepherd, starts, mission.count(steps), key).fly()

    def check(self) -> None:
        """Raise `Refusal` for an option that is none."""
        if self.steering not in get_args(Steering):
            raise Refusal(
                f"rovers do not steer by {self.steering!r:.60}; "
                f"choose from {', '.join(get_args(Steering))}"
            )
        if not set(self.ideal) <= {"sheep", "dogs"}:
            raise Refusal(f"ideal bodies are 'sheep' or 'dogs', got {sorted(self.ideal)!r:.60}")
        if self.wait is not None:
            quantities.WAIT.checked(self.wait)
        quantities.THREADS.checked(self.threads)
        amounts = self.disturbances()
        for field in fields(amounts):
            value = getattr(amounts, field.name)
            if not 0.0 <= value < float("inf"):
                raise Refusal(f"a disturbance's {field.name} is at least 0, got {value}; try 0.0")

    def disturbances(self) -> Disturbances:
        """What goes wrong. Raises `Refusal` for a name that is none."""
        if isinstance(self.disturb, Disturbances):
            return self.disturb
        if self.disturb not in DISTURBANCES:
            raise Refusal(
                f"no disturbances are called {self.disturb!r:.60}; "
                f"choose from {', '.join(DISTURBANCES)}"
            )
        return DISTURBANCES[self.disturb]


class Flight:
    """A batch of missions on its way. Arrays have the missions first."""

    def __init__(
        self,
        twin: Twin,
        world: World,
        shepherd: Shepherd,
        starts: State,
        steps: int,
        key: PRNGKeyArray | None,
    ):
        memory.none(world, "the twin")
        self.twin, self.steps = twin, steps
        self.world, self.shepherd = params.traced(world), params.traced(shepherd)
        self.ticks = _ticks(world)
        missions, sheep, _ = starts.sheep.shape
        dogs = starts.dogs.shape[1]
        self.uav, self.rover = profiles.uav(twin.profile), profiles.rover(twin.rovers)
        if "sheep" in twin.ideal:  # its centre is what is steered
            loop = replace(self.rover.tracking, ahead=1e-6)
            self.rover = replace(self.rover, tracking=loop)
        disturb = twin.disturbances()
        arena = world.arena
        wide, high = arena.plain_sides
        self.sides: Corner = wide if wide == high else np.array([wide, high])
        self.airspace = float(world.dog.airspace)
        closed = bodies.closed_to(self.rover, world.obstacles)
        pads.check(starts, self.uav, self.rover, self.sides, closed)
        self.bodies = bodies.build(
            self.uav,
            self.rover,
            (wide, high),
            (float(arena.goal_x), float(arena.goal_y), float(arena.goal_radius)),
            sheep,
            dogs,
            disturb.friction,
            twin.timestep,
            closed=closed,
        )
        self.plant = Plant(self.uav, self.bodies, missions, twin.threads)
        keys = jax.random.split(jax.random.key(0) if key is None else key, missions)
        self.luck = Luck(disturb, self.uav, keys, sheep, dogs)
        self.keys = keys if params.noisy(world) else None
        self.station = Station(
            self.uav,
            self.rover,
            twin.steering,
            twin.wait,
            self.ticks * DT,
            np.asarray(world.sheep.speed, float),
        )
        self.height = altitude.HEIGHT + station.LEVEL * np.arange(dogs) * np.ones((missions, 1))
        beyond = self.airspace + BEYOND
        self.base = Base(
            self.station,
            # An ideal body is where it is to be at once, however far that is. A drone that falls is
            # down, which the twin knows by itself.
            Limits(
                (-beyond, wide + beyond),
                (-beyond, high + beyond),
                (-1.0, float(self.height.max()) + 1.0),
                lowest=-inf,
                drone_speed=inf,
                jump=inf if twin.ideal else Limits.jump,
            ),
            (-self.airspace, self.sides + self.airspace),
            (0.0, self.sides),
            self.height,
            sliding(closed, self.sides),
        )
        self.now = 0  # ticks of the base station
        pad, wheel = bodies.rest(self.uav, self.rover)
        self.plant.place(
            _with_height(starts.dogs, pad), _with_height(starts.sheep, wheel), self.luck.yaw
        )
        self.memory = base.start(self.base, _exact(self.plant.truth()), -DT, Mode.READY)
        self.force = np.zeros((missions, sheep, 2), np.float32)
        self.how = np.full(missions, OUT_OF_TIME)
        # A plain function is compiled for this flight alone: it may read what has changed by then.
        kept = isinstance(shepherd, eqx.Module)
        self._decided = decide if kept else eqx.filter_jit(lambda *given: decide(*given))

    def fly(self) -> Trace:
        """Take off and fly all missions to their ends."""
        self._take_off()
        records: list[Record] = []
        done = stood = np.zeros(len(self.how), bool)
        for now in range(self.steps + 1):
            truth = self.plant.truth()
            decided, home = self._decide(truth, now)
            done = done | ((self.how == OUT_OF_TIME) & home)
            self.how[done] = ACCOMPLISHED
            over = done | (self.how != OUT_OF_TIME) | (now == self.steps)
            record = self._record(truth, decided, done, over)
            records.append(hold(records[-1], record, stood) if records else record)
            if self.twin.progress is not None:
                self.twin.progress(now, int(over.sum()))
            if over.all():
                break
            self._advance(decided, np.flatnonzero(~over))
            stood = over
        return self._trace(records)

    def _take_off(self) -> None:
        """Climb to the height of the mission and hold there, every mission for the same time."""
        seconds = float(self.height.max()) / self.uav.velocity.largest_climb + SETTLES
        if seconds > LONGEST_CLIMB:
            raise Refusal(
                f"{self.uav.name} takes {seconds:.3g} s to climb to {self.height.max():.3g} m, at "
                f"most {LONGEST_CLIMB:g}; give it a larger largest_climb, or fly fewer dogs"
            )
        everyone = np.arange(len(self.how))
        for tick, drawn in enumerate(self.luck.draw(round(seconds / DT))):
            self._tick(0.0, drawn, everyone, order=Order.NONE if tick else Order.TAKE_OFF)
        upset, down = self.plant.crashed()
        self.how[down] = DOWN
        self.how[upset] = UPSET

    def _decide(self, truth: Truth, now: int) -> tuple[Decision, Bool[np.ndarray, " batch"]]:
        """What is decided on what is seen, and which missions are accomplished in truth."""
        memory = self.memory.station
        seen = State(
            sheep=jnp.asarray(station.flock(self.station, memory), jnp.float32),
            dogs=jnp.asarray(memory.dogs.position[..., :2], jnp.float32),
            force=jnp.asarray(self.force),
        )
        real = replace(
            seen,
            sheep=jnp.asarray(truth.sheep, jnp.float32),
            dogs=jnp.asarray(truth.dogs[..., :2], jnp.float32),
        )
        at = jnp.asarray(now)  # an argument: a plain number would be compiled anew each time
        decided, home = self._decided(self.world, self.shepherd, seen, real, self.keys, at)
        return jax.tree.map(np.asarray, decided), np.asarray(home)

    def _advance(self, decided: Decision, flying: Int[np.ndarray, " flying"]) -> None:
        """Fly the missions that are `flying` until the next decision."""
        speed = np.asarray(self.world.sheep.speed, float)
        pushed = decided.force * (speed[..., None] if speed.ndim else speed)
        moves = Decided(np.asarray(decided.velocity, float), np.asarray(pushed, float))
        self.force = decided.force
        for tick, drawn in enumerate(self.luck.draw(self.ticks)):
            self._tick(tick * DT, drawn, flying, None if tick else moves)
        upset, down = self.plant.crashed()
        truth = self.plant.truth()
        out = _beyond(truth.dogs[..., :2], self.airspace + BEYOND, self.sides)
        out |= _beyond(truth.sheep, BEYOND, self.sides)
        out |= np.any(truth.dogs[..., 2] > self.height + 1.0, axis=1)
        stopped = self.memory.supervisor.mode > Mode.HOLD
        for found, how in ((stopped, STOPPED), (out, LEFT), (down, DOWN), (upset, UPSET)):
            self.how[flying[found[flying]]] = how

    def _tick(
        self,
        elapsed: float,
        drawn: Drawn | None,
        flying: Int[np.ndarray, " flying"],
        decided: Decided | None = None,
        order: Order = Order.NONE,
    ) -> None:
        """One tick of the base station, so many seconds after a decision."""
        luck, drone = self.luck, self.plant
        frame = luck.frame(drone.truth(), drawn)
        told = base.all_well(self.how.shape, self.height.shape[1], order)
        self.memory, sent = base.step(self.base, self.memory, frame, told, decided, self.now * DT)
        self.now += 1
        heard = luck.hear(sent.commands, drawn)
        velocity, tilt = heard.velocity, None
        if self.uav.velocity.on_board:
            velocity = luck.shake(velocity, drawn)
        else:
            tilt = luck.shake(heard.tilt, drawn)
        gust = luck.wind(drawn)
        if gust is not None:
            drone.push(gust)
        left, right = rovers.wheels(self.rover, heard.twist)
        grip = luck.grip()
        drone.drive(left * grip[0], right * grip[1])
        drone.step(velocity, tilt, luck.trim, round(DT / plant.DT), flying)
        for who in self.twin.ideal:
            known = self.memory.station
            goal = known.sheep_setpoint if who == "sheep" else known.dog_setpoint
            where = setpoints.at(goal, elapsed + DT)
            drone.carry(who, where, self.height, flying)

    def _record(
        self, truth: Truth, decided: Decision, done: np.ndarray, over: np.ndarray
    ) -> Record:
        memory = self.memory.station
        waypoint = setpoints.at(memory.dog_setpoint, self.station.period)
        setpoint = np.concatenate([waypoint, self.height[..., None]], axis=-1)
        stopped = over[:, None]
        return Record(
            sheep=truth.sheep,
            dogs=truth.dogs[..., :2],
            subgoal=np.asarray(decided.subgoal),
            drives=np.asarray(decided.drives),
            command=np.where(stopped[..., None], 0.0, decided.velocity),
            accomplished=done,
            altitude=truth.dogs[..., 2],
            attitude=truth.attitude,
            setpoint=setpoint,
            yaw=truth.yaw,
            speed=memory.twist.speed,
            turn_rate=memory.twist.turn_rate,
        )

    def _trace(self, records: list[Record]) -> Trace:
        """The trace, whose last instant stands until the steps that were given are over."""
        records += [records[-1]] * (self.steps + 1 - len(records))
        kinds = {"drives": bool, "accomplished": bool}
        arrays = {
            name: jnp.asarray(
                np.stack([getattr(record, name) for record in records], axis=1),
                kinds.get(name, jnp.float32),
            )
            for name in Record._fields
        }
        poses = {name: arrays.pop(name) for name in Poses.__dataclass_fields__}
        missions = len(self.how)
        time = jnp.arange(self.steps + 1) * self.world.arena.dt
        return Trace(
            world=self.world,
            time=jnp.broadcast_to(time, (missions, self.steps + 1)),
            **arrays,
            poses=Poses(**poses),
            ending=Ending(
                how=jnp.asarray(self.how, jnp.int32), steps=jnp.full(missions, self.steps)
            ),
        )


def _ticks(world: World) -> int:
    """The ticks of the base station between two decisions. Raises `Refusal` for a broken number."""
    dt = float(world.arena.dt)
    ticks = round(dt / DT)
    if ticks < 1 or abs(ticks * DT - dt) > 1e-6:
        raise Refusal(f"the twin's decisions are {DT:g} s apart or a multiple of it, got {dt:g} s")
    return ticks


def _exact(truth: Truth) -> Frame:
    """A frame of motion capture that shows the truth."""
    seen = np.ones(truth.dogs.shape[:2], bool), np.ones(truth.yaw.shape, bool)
    return Frame(truth.dogs, truth.sheep, truth.yaw, *seen)


def _with_height(
    position: Float[Array, "batch bodies 2"], height: float
) -> Float[np.ndarray, "batch bodies 3"]:
    flat = np.asarray(position, float)
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), height)], axis=-1)


def _beyond(
    position: Float[np.ndarray, "batch bodies 2"], beyond: float, sides: Corner
) -> Bool[np.ndarray, " batch"]:
    """In which missions a body is out of the arena if that is `beyond` metres larger."""
    inside = (position >= -beyond) & (position <= sides + beyond)
    return ~np.all(inside, axis=(1, 2))
