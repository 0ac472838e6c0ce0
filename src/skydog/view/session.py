"""The session of one page of the live view: its choices, its world, and the flights in it.

It is pure: `update` takes a message, `advance` lets time pass, and `view` is what the page is sent.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog import numerics
from skydog.errors import Refusal
from skydog.view import ground
from skydog.world import herding, mission, obstacles, params, scenes
from skydog.world.mission import Shepherd
from skydog.world.params import World
from skydog.world.presets import PRESETS, Point, make
from skydog.world.state import State
from skydog.world.vectors import norm

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # multiples of real time
PACE = 10.0  # steps a second that a preset's own speed comes near to
HOVER, TOWARD, ALONG = 0, 1, 2  # how a player flies
NEVER = 2**31 - 1  # the step at which a mission runs out of time

Worlds = Mapping[str, Callable[..., World]]
"""Functions of `arena` and `sheep` by the name that a page calls them: presets, or one's own."""


@dataclass(frozen=True)
class Settings:
    """What a page chooses. Metres, m/s; `speed` in multiples of real time."""

    policy: str
    preset: str = "paper"  # or the name of a world of one's own
    scene: str | None = None  # obstacles: the name of a scene, or its file
    arena: float | None = None  # None is as wide as the flock needs
    goal: Point | None = None  # None is the world's own
    goal_radius: float | None = None
    sheep: int = 3
    dogs: int = 1
    case: int = 1  # the seed of start and noise
    mode: str = "watch"  # or fly, or race: fly, beside a second world that the shepherd flies
    speed: float = 1.0
    paused: bool = False
    noise: float = 0.0  # weight of a random unit vector in the sheep's force
    perception: float = 0.0  # SD of each coordinate that a dog sees
    actuation: float = 0.0  # SD of each component of a flown velocity


class Control(eqx.Module):
    """What the player does: whom the pointer holds and where, in metres, and how the dog flies."""

    dog: Int[Array, ""]  # the one held; -1 is none
    sheep: Int[Array, ""]
    place: Float[Array, "2"]
    flies: Bool[Array, ""]  # whether the first dog is the player's
    how: Int[Array, ""]  # HOVER, TOWARD a place, or ALONG a direction
    aim: Float[Array, "2"]  # that place in metres, or that share of the speed limit


class Flight(eqx.Module):
    """A world in flight: where everyone is, the steps taken, and the metres that dogs flew."""

    state: State
    step: Int[Array, ""]
    flown: Float[Array, ""]


class Overlay(eqx.Module):
    """What a page shows of a flight besides where everyone is. Metres."""

    subgoal: Float[Array, "dogs 2"]
    drives: Bool[Array, " dogs"]
    done: Bool[Array, ""]
    away: Float[Array, ""]  # from the flock's centre to the goal
    spread: Float[Array, ""]  # from the flock's centre to the furthest sheep
    home: Int[Array, ""]  # sheep within the goal


@dataclass(frozen=True)
class Session:
    """The session of one page. Without flights, the next `advance` starts them."""

    settings: Settings
    world: World
    worlds: Worlds  # those to choose from
    held: tuple[str, int, tuple[float, float]] | None = None  # who, number, where
    steering: tuple[int, tuple[float, float]] = (HOVER, (0.0, 0.0))
    single: int = 0  # steps asked for one by one
    start: int = 1  # counts the starts
    waits: bool = False  # a race, for the player's first move
    flights: tuple[Flight, ...] = ()
    overlays: tuple[Overlay, ...] = ()

    @property
    def kind(self) -> tuple[Any, ...]:
        """What the compiled `fly` depends on."""
        chosen = self.settings
        return chosen.preset, chosen.scene, chosen.sheep, chosen.dogs, chosen.policy

    @property
    def rests(self) -> bool:
        """Whether nothing moves until the page says so."""
        over = bool(self.overlays) and all(bool(overlay.done) for overlay in self.overlays)
        return bool(self.flights) and (self.settings.paused or self.waits or over)


@numerics.ours()
def new(settings: Settings, worlds: Worlds = PRESETS) -> Session:
    """A session that has not begun. Raises `Refusal` as `presets.preset` does."""
    return Session(settings, _world(settings, worlds), worlds)


def with_preset(settings: Settings, preset: str, worlds: Worlds = PRESETS) -> Settings:
    """The settings in another preset's world: with its own arena, noise, and a fitting speed."""
    own = _own(worlds, preset, settings.sheep)
    pace = PACE * float(own.arena.dt)
    return replace(
        settings,
        preset=preset,
        arena=None,
        goal=None,
        goal_radius=None,
        speed=min(SPEEDS, key=lambda speed: abs(math.log(speed / pace))),
        noise=ground.greatest(own.flock, "noise") or 0.0,
        perception=float(own.dog.perception_noise),
        actuation=float(own.dog.actuation_noise),
    )


@numerics.ours()
def update(session: Session, message: dict[str, Any]) -> Session:
    """The session after a message that `parse` let through.

    Raises `Refusal` for what this world does not have: an arena too short, a sheep too many.
    """
    settings = session.settings
    if "preset" in message:
        settings = with_preset(settings, message["preset"], session.worlds)
    own = {each.name for each in fields(Settings)} - {"preset"}
    settings = replace(settings, **{name: message[name] for name in own & set(message)})
    if settings.arena is not None and settings.arena <= _goal_radius(settings, session.worlds):
        if "arena" in message:
            raise Refusal(
                f"the goal's radius is {_goal_radius(settings, session.worlds):.1f} m, an arena of "
                f"{settings.arena:g} m is too short; try {_roomy(settings, session.worlds):g}"
            )
        settings = replace(settings, arena=None)  # the flock outgrew it
    if "scene" in message:
        settings = replace(settings, arena=None, goal=None)
    if settings.goal and "goal" not in message and _outside(settings, session):
        settings = replace(settings, goal=None)
    if "step" in message:
        settings = replace(settings, paused=True)

    begins = any(
        getattr(settings, name) != getattr(session.settings, name)
        for name in ("preset", "scene", "arena", "sheep", "dogs", "case")
    )
    races = "race" in (settings.mode, session.settings.mode)
    begins |= races and (settings.mode, settings.policy) != (
        session.settings.mode,
        session.settings.policy,
    )
    if begins or "reset" in message:
        waits = settings.mode == "race"
        world = _world(settings, session.worlds)
        session = Session(settings, world, session.worlds, start=session.start + 1, waits=waits)
    elif settings != session.settings:
        world = _world(settings, session.worlds)
        session = replace(session, settings=settings, world=world)
        if settings.mode == "watch":
            session = replace(session, steering=(HOVER, (0.0, 0.0)))
    if "step" in message:
        session = replace(session, single=session.single + 1, waits=False)
    if "fly" in message:
        session = replace(session, steering=message["fly"])
        session = replace(session, waits=session.waits and message["fly"][0] == HOVER)
    if "hold" in message:
        session = _holding(session, message["hold"])
    return session


@numerics.ours()
def advance(session: Session, shepherds: dict[str, Shepherd], steps: int) -> Session:
    """The session so many steps later, and those asked for singly."""
    settings, world = session.settings, session.world
    key = jax.random.key(settings.case)
    if not session.flights:
        case = _start(world, key, settings.sheep, settings.dogs)
        begun = Flight(case, jnp.zeros((), int), jnp.zeros(()))
        session = replace(session, flights=(begun,) * (2 if settings.mode == "race" else 1))
    pilot = params.traced(shepherds[settings.policy])
    count = jnp.asarray(0 if session.waits else steps + session.single)
    controls = (_control(session), _control(replace(session, held=None), flies=False))
    flown = [
        fly(world, pilot, flight, control, key, count)
        for flight, control in zip(session.flights, controls, strict=False)
    ]
    flights, overlays = zip(*flown, strict=True)
    return replace(session, flights=flights, overlays=overlays, single=0)


@eqx.filter_jit
def fly(
    world: World,
    shepherd: Shepherd,
    flight: Flight,
    control: Control,
    key: PRNGKeyArray,
    steps: Int[Array, ""],
) -> tuple[Flight, Overlay]:
    """The flight so many steps later, or when it is accomplished: as `mission.rollout` flies it.

    Who is held is where the pointer is, before and after every step.
    """

    def more(carry):
        taken, flight = carry
        return (taken < steps) & ~mission.accomplished(world, flight.state)

    def one(carry):
        taken, flight = carry
        before = flight.state
        fly = mission.instant(
            world, lambda world, seen: _steered(world, shepherd, seen, before, control), NEVER, key
        )
        (after, _), _ = fly((before, jnp.asarray(False)), flight.step)
        free = jnp.arange(len(before.dogs)) != control.dog
        metres = jnp.sum(jnp.where(free, norm(after.dogs - before.dogs), 0.0))
        return taken + 1, Flight(_held(after, control), flight.step + 1, flight.flown + metres)

    flight = Flight(_held(flight.state, control), flight.step, flight.flown)
    _, flight = jax.lax.while_loop(more, one, (jnp.asarray(0), flight))
    return flight, _overlay(world, flight.state)


@numerics.ours()
def view(session: Session) -> dict[str, Any]:
    """What a page is sent of its session after `advance`: plain data, rounded to the millimetre."""
    world = session.world
    return {
        "settings": asdict(session.settings),
        "world": ground.numbers(world, session.settings.sheep)
        | {"airspace": ground.rounded(world.dog.airspace), "dt": ground.rounded(world.arena.dt)},
        "start": session.start,
        "waits": session.waits,
        "flights": [
            {
                "step": int(flight.step),
                "flown": ground.rounded(flight.flown),
                "sheep": ground.rounded(flight.state.sheep),
                "dogs": ground.rounded(flight.state.dogs),
                "subgoal": ground.rounded(overlay.subgoal),
                "drives": np.asarray(overlay.drives).tolist(),
                "done": bool(overlay.done),
                "away": ground.rounded(overlay.away),
                "spread": ground.rounded(overlay.spread),
                "home": int(overlay.home),
            }
            for flight, overlay in zip(session.flights, session.overlays, strict=True)
        ],
    }


def _world(settings: Settings, worlds: Worlds) -> World:
    """The world that the settings ask for, its numbers as arrays: none of them compiles anew."""
    roomy = settings.arena is None and settings.scene is None
    size = _roomy(settings, worlds) if roomy else settings.arena
    goal = settings.goal, settings.goal_radius
    world = make(worlds[settings.preset], size, settings.sheep, *goal, settings.scene)
    noise = settings.perception, settings.actuation
    world = eqx.tree_at(lambda w: (w.dog.perception_noise, w.dog.actuation_noise), world, noise)
    # A law of one's own need not know of noise; what each sheep has its own of, stays.
    noise = getattr(world.flock, "noise", None)
    if any(leaf is noise and np.ndim(leaf) == 0 for leaf in jax.tree.leaves(world.flock)):
        world = eqx.tree_at(lambda w: w.flock.noise, world, settings.noise)
    if settings.preset not in PRESETS:
        mission.check(world, settings.sheep, settings.dogs)
    return params.traced(world)


def _own(worlds: Worlds, name: str, sheep: int) -> World:
    """A world as it is by itself, whether or not the flock has room in its arena."""
    return params.check(worlds[name](sheep=sheep))


def _roomy(settings: Settings, worlds: Worlds) -> float:
    """The side, in metres, of the preset's own arena, or of one that leaves the flock a way."""
    own = _own(worlds, settings.preset, settings.sheep).arena
    if settings.preset not in PRESETS:
        return float(own.size)
    return max(float(own.size), float(math.ceil(2 * _goal_radius(settings, worlds))))


def _outside(settings: Settings, session: Session) -> bool:
    """Whether the goal lies outside the arena that the settings ask for."""
    side = settings.arena or _roomy(settings, session.worlds)
    sides = (side, side) if settings.scene is None else session.world.arena.plain_sides
    return any(at > side * (1 + 1e-6) for at, side in zip(settings.goal or (), sides, strict=False))


def _goal_radius(settings: Settings, worlds: Worlds) -> float:
    if settings.goal_radius is not None:
        return settings.goal_radius
    return float(_own(worlds, settings.preset, settings.sheep).arena.goal_radius)


def _holding(session: Session, held: tuple[str, int, tuple[float, float]] | None) -> Session:
    """The session with someone, or the goal, in the player's hand; None lets go."""
    if held is None or not session.flights:
        return replace(session, held=None)
    who, number, place = held
    many = {"goal": 1, "dog": session.settings.dogs, "sheep": session.settings.sheep}[who]
    if number >= many:
        raise Refusal(f"this world has {many} {who}, counted from 0; nobody is {who} {number}")
    beyond = float(session.world.dog.airspace) if who == "dog" else 0.0
    sides = session.world.arena.plain_sides
    x, y = (min(max(at, -beyond), side + beyond) for at, side in zip(place, sides, strict=True))
    if who == "goal":
        settings = replace(session.settings, goal=(x, y))
        place = jnp.asarray((x, y), jnp.float32)
        world = eqx.tree_at(
            lambda w: (w.arena.goal_x, w.arena.goal_y), session.world, (place[0], place[1])
        )
        world = params.traced(scenes.renewed(world))
        return replace(session, held=None, settings=settings, world=world)
    if session.settings.mode == "race":
        raise Refusal("in a race you cannot drag anybody; fly the dog instead")
    walls = session.world.obstacles
    if walls is not None and (who == "sheep" or walls.tall):
        x, y = obstacles.outside(walls, jnp.asarray([[x, y]], jnp.float32))[0].tolist()
    session = replace(session, held=(who, number, (x, y)))
    own, *others = session.flights
    moved = Flight(_held(own.state, _control(session)), own.step, own.flown)
    return replace(session, flights=(moved, *others))


def _control(session: Session, flies: bool = True) -> Control:
    who, number, place = session.held or ("nobody", -1, (0.0, 0.0))
    how, aim = session.steering
    return Control(
        dog=jnp.asarray(number if who == "dog" else -1),
        sheep=jnp.asarray(number if who == "sheep" else -1),
        place=jnp.asarray(place, jnp.float32),
        flies=jnp.asarray(flies and session.settings.mode != "watch"),
        how=jnp.asarray(how),
        aim=jnp.asarray(aim, jnp.float32),
    )


@eqx.filter_jit
def _held(state: State, control: Control) -> State:
    """The state with whoever is held where the pointer is."""
    dogs = (jnp.arange(len(state.dogs)) == control.dog)[:, None]
    sheep = (jnp.arange(len(state.sheep)) == control.sheep)[:, None]
    return replace(
        state,
        sheep=jnp.where(sheep, control.place, state.sheep),
        dogs=jnp.where(dogs, control.place, state.dogs),
    )


def _steered(
    world: World, shepherd: Shepherd, seen: State, state: State, control: Control
) -> Float[Array, "dogs 2"]:
    """Velocities in m/s: the shepherd's, but the player's for the dog that is the player's."""
    way = control.aim - state.dogs
    fast, there = mission.fastest(world.dog, way), way / world.arena.dt
    toward = jnp.where(norm(there)[:, None] < norm(fast)[:, None], there, fast)
    along = jnp.broadcast_to(world.dog.speed * control.aim, toward.shape)
    own = jnp.where(control.how == TOWARD, toward, jnp.where(control.how == ALONG, along, 0.0))
    players = control.flies & (jnp.arange(len(state.dogs)) == 0)
    return mission.limited(world.dog, jnp.where(players[:, None], own, shepherd(world, seen)))


def _overlay(world: World, state: State) -> Overlay:
    subgoal, drives = herding.gate(world, state.sheep, state.dogs)
    centre, goal = herding.gcm(state.sheep), herding.goal(world.arena)
    return Overlay(
        subgoal=subgoal,
        drives=drives,
        done=mission.accomplished(world, state),
        away=norm(centre - goal),
        spread=jnp.max(norm(state.sheep - centre)),
        home=jnp.sum(norm(state.sheep - goal) <= world.arena.goal_radius),
    )


@eqx.filter_jit
def _start(world: World, key: PRNGKeyArray, sheep: int, dogs: int) -> State:
    return mission.reset(world, key, sheep, dogs)
