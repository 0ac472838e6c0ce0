"""The game that a page of the live view plays: its choices, its world, and the flights in it.

It is pure: `told` takes an order of the page, `turn` lets time pass, and `shown` is what the page
is sent.
"""

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.errors import Refusal
from skydog.world import herding, mission, params
from skydog.world.mission import Shepherd, State
from skydog.world.params import World
from skydog.world.vectors import norm

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # multiples of real time
PACE = 10.0  # steps a second that a preset's own speed comes near to
HOVER, TOWARD, ALONG = 0, 1, 2  # how a player flies
NEVER = 2**31 - 1  # the step at which a mission runs out of time


@dataclass(frozen=True)
class Settings:
    """What a page chooses. Metres, m/s; `speed` in multiples of real time."""

    policy: str
    preset: str = "paper"
    arena: float | None = None  # None is as wide as the flock needs
    sheep: int = 3
    dogs: int = 1
    case: int = 1  # the seed of start and noise
    mode: str = "watch"  # or fly, or race: fly, beside a second world that the shepherd flies
    speed: float = 1.0
    paused: bool = False
    noise: float = 0.0  # weight of a random unit vector in the sheep's force
    perception: float = 0.0  # SD of each coordinate that a dog sees
    actuation: float = 0.0  # SD of each component of a flown velocity


class Hand(eqx.Module):
    """What the player's hand does: whom it holds and where, in metres, and how it flies."""

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


class Sight(eqx.Module):
    """What a page shows of a flight besides where everyone is. Metres."""

    subgoal: Float[Array, "dogs 2"]
    drives: Bool[Array, " dogs"]
    done: Bool[Array, ""]
    away: Float[Array, ""]  # from the flock's centre to the goal
    spread: Float[Array, ""]  # from the flock's centre to the furthest sheep
    home: Int[Array, ""]  # sheep within the goal


@dataclass(frozen=True)
class Game:
    """The game of one page. Without flights, the next turn starts them."""

    settings: Settings
    world: World
    held: tuple[str, int, tuple[float, float]] | None = None  # who, number, where
    course: tuple[int, tuple[float, float]] = (HOVER, (0.0, 0.0))
    single: int = 0  # steps asked for one by one
    start: int = 1  # counts the starts
    waits: bool = False  # a race, for the player's first move
    flights: tuple[Flight, ...] = ()
    sights: tuple[Sight, ...] = ()

    @property
    def kind(self) -> tuple[Any, ...]:
        """What the compiled turn depends on."""
        chosen = self.settings
        return chosen.preset, chosen.sheep, chosen.dogs, chosen.policy

    @property
    def rests(self) -> bool:
        """Whether nothing moves until the page says so."""
        over = bool(self.sights) and all(bool(sight.done) for sight in self.sights)
        return bool(self.flights) and (self.settings.paused or self.waits or over)


def new(settings: Settings) -> Game:
    """A game that has not begun. Raises `Refusal` as `params.preset` does."""
    return Game(settings, _world(settings))


def with_preset(settings: Settings, preset: str) -> Settings:
    """The settings in another preset's world: with its own arena, noise, and a fitting speed."""
    own = params.preset(preset, None, 1)
    pace = PACE * float(own.arena.dt)
    return replace(
        settings,
        preset=preset,
        arena=None,
        speed=min(SPEEDS, key=lambda speed: abs(math.log(speed / pace))),
        noise=float(own.flock.noise),
        perception=float(own.dog.perception_noise),
        actuation=float(own.dog.actuation_noise),
    )


def told(game: Game, order: dict[str, Any]) -> Game:
    """The game after an order that `parsed` let through.

    Raises `Refusal` for what this world does not have: an arena too short, a sheep too many.
    """
    settings = game.settings
    if "preset" in order:
        settings = with_preset(settings, order["preset"])
    own = {each.name for each in fields(Settings)} - {"preset"}
    settings = replace(settings, **{name: order[name] for name in own & set(order)})
    if settings.arena is not None and settings.arena <= _goal_radius(settings):
        if "arena" in order:
            raise Refusal(
                f"the goal's radius is {_goal_radius(settings):.1f} m, an arena of "
                f"{settings.arena:g} m is too short; try {_roomy(settings):g}"
            )
        settings = replace(settings, arena=None)  # the flock outgrew it
    if "step" in order:
        settings = replace(settings, paused=True)

    begins = any(
        getattr(settings, name) != getattr(game.settings, name)
        for name in ("preset", "arena", "sheep", "dogs", "case")
    )
    races = "race" in (settings.mode, game.settings.mode)
    begins |= races and (settings.mode, settings.policy) != (
        game.settings.mode,
        game.settings.policy,
    )
    if begins or "reset" in order:
        waits = settings.mode == "race"
        game = Game(settings, _world(settings), start=game.start + 1, waits=waits)
    elif settings != game.settings:
        place = herding.goal(game.world.arena)
        game = replace(game, settings=settings, world=_with_goal(_world(settings), place))
        if settings.mode == "watch":
            game = replace(game, course=(HOVER, (0.0, 0.0)))
    if "step" in order:
        game = replace(game, single=game.single + 1, waits=False)
    if "fly" in order:
        game = replace(game, course=order["fly"])
        game = replace(game, waits=game.waits and order["fly"][0] == HOVER)
    if "hold" in order:
        game = _holding(game, order["hold"])
    return game


def turn(game: Game, shepherds: dict[str, Shepherd], steps: int) -> Game:
    """The game so many steps later, and those asked for singly."""
    settings, world = game.settings, game.world
    key = jax.random.key(settings.case)
    if not game.flights:
        case = _start(world, key, settings.sheep, settings.dogs)
        begun = Flight(case, jnp.zeros((), int), jnp.zeros(()))
        game = replace(game, flights=(begun,) * (2 if settings.mode == "race" else 1))
    pilot = params.traced(shepherds[settings.policy])
    count = jnp.asarray(0 if game.waits else steps + game.single)
    hands = (_hand(game), _hand(replace(game, held=None), flies=False))
    flown = [
        advance(world, pilot, flight, hand, key, count)
        for flight, hand in zip(game.flights, hands, strict=False)
    ]
    flights, sights = zip(*flown, strict=True)
    return replace(game, flights=flights, sights=sights, single=0)


@eqx.filter_jit
def advance(
    world: World,
    shepherd: Shepherd,
    flight: Flight,
    hand: Hand,
    key: PRNGKeyArray,
    steps: Int[Array, ""],
) -> tuple[Flight, Sight]:
    """The flight so many steps later, or when it is accomplished: as `mission.rollout` flies it.

    Who is held is where the hand is, before and after every step.
    """

    def more(carry):
        taken, flight = carry
        return (taken < steps) & ~mission.accomplished(world, flight.state)

    def one(carry):
        taken, flight = carry
        before = flight.state
        fly = mission.instant(
            world, lambda world, seen: _steered(world, shepherd, seen, before, hand), NEVER, key
        )
        (after, _), _ = fly((before, jnp.asarray(False)), flight.step)
        free = jnp.arange(len(before.dogs)) != hand.dog
        metres = jnp.sum(jnp.where(free, norm(after.dogs - before.dogs), 0.0))
        return taken + 1, Flight(_held(after, hand), flight.step + 1, flight.flown + metres)

    flight = Flight(_held(flight.state, hand), flight.step, flight.flown)
    _, flight = jax.lax.while_loop(more, one, (jnp.asarray(0), flight))
    return flight, _seen(world, flight.state)


def shown(game: Game) -> dict[str, Any]:
    """What a page is sent of its game after a turn: plain data, rounded to the millimetre."""
    world = game.world
    return {
        "settings": asdict(game.settings),
        "world": {
            "size": _rounded(world.arena.size),
            "goal": _rounded(herding.goal(world.arena)),
            "radius": _rounded(world.arena.goal_radius),
            "sensing": _rounded(world.flock.sensing),
            "gathered": _rounded(herding.gathered_radius(world.flock, game.settings.sheep)),
            "airspace": _rounded(world.dog.airspace),
            "dt": _rounded(world.arena.dt),
        },
        "start": game.start,
        "waits": game.waits,
        "flights": [
            {
                "step": int(flight.step),
                "flown": _rounded(flight.flown),
                "sheep": _rounded(flight.state.sheep),
                "dogs": _rounded(flight.state.dogs),
                "subgoal": _rounded(sight.subgoal),
                "drives": np.asarray(sight.drives).tolist(),
                "done": bool(sight.done),
                "away": _rounded(sight.away),
                "spread": _rounded(sight.spread),
                "home": int(sight.home),
            }
            for flight, sight in zip(game.flights, game.sights, strict=True)
        ],
    }


def _world(settings: Settings) -> World:
    """The world that the settings ask for, its numbers as arrays: none of them compiles anew."""
    size = _roomy(settings) if settings.arena is None else settings.arena
    world = params.preset(settings.preset, size, settings.sheep)
    noise = settings.noise, settings.perception, settings.actuation
    world = eqx.tree_at(
        lambda w: (w.flock.noise, w.dog.perception_noise, w.dog.actuation_noise), world, noise
    )
    return params.traced(world)


def _roomy(settings: Settings) -> float:
    """The side, in metres, of the preset's own arena, or of one that leaves the flock a way."""
    own = params.PRESETS[settings.preset](sheep=settings.sheep).arena
    return max(float(own.size), float(math.ceil(2 * float(own.goal_radius))))


def _goal_radius(settings: Settings) -> float:
    return float(params.PRESETS[settings.preset](sheep=settings.sheep).arena.goal_radius)


def _with_goal(world: World, place: Float[Array, "2"]) -> World:
    return eqx.tree_at(lambda w: (w.arena.goal_x, w.arena.goal_y), world, (place[0], place[1]))


def _holding(game: Game, held: tuple[str, int, tuple[float, float]] | None) -> Game:
    """The game with someone, or the goal, in the player's hand; None lets go."""
    if held is None or not game.flights:
        return replace(game, held=None)
    who, number, place = held
    size = float(game.world.arena.size)
    many = {"goal": 1, "dog": game.settings.dogs, "sheep": game.settings.sheep}[who]
    if number >= many:
        raise Refusal(f"this world has {many} {who}, counted from 0; nobody is {who} {number}")
    beyond = float(game.world.dog.airspace) if who == "dog" else 0.0
    x, y = (min(max(at, -beyond), size + beyond) for at in place)
    if who == "goal":
        goal = jnp.asarray((x, y), jnp.float32)
        return replace(game, held=None, world=_with_goal(game.world, goal))
    if game.settings.mode == "race":
        raise Refusal("in a race nobody is carried; fly the dog instead")
    game = replace(game, held=(who, number, (x, y)))
    own, *others = game.flights
    moved = Flight(_held(own.state, _hand(game)), own.step, own.flown)
    return replace(game, flights=(moved, *others))


def _hand(game: Game, flies: bool = True) -> Hand:
    who, number, place = game.held or ("nobody", -1, (0.0, 0.0))
    how, aim = game.course
    return Hand(
        dog=jnp.asarray(number if who == "dog" else -1),
        sheep=jnp.asarray(number if who == "sheep" else -1),
        place=jnp.asarray(place, jnp.float32),
        flies=jnp.asarray(flies and game.settings.mode != "watch"),
        how=jnp.asarray(how),
        aim=jnp.asarray(aim, jnp.float32),
    )


@eqx.filter_jit
def _held(state: State, hand: Hand) -> State:
    """The state with whoever is held where the hand is."""
    dogs = (jnp.arange(len(state.dogs)) == hand.dog)[:, None]
    sheep = (jnp.arange(len(state.sheep)) == hand.sheep)[:, None]
    return State(
        sheep=jnp.where(sheep, hand.place, state.sheep),
        dogs=jnp.where(dogs, hand.place, state.dogs),
        force=state.force,
    )


def _steered(
    world: World, shepherd: Shepherd, seen: State, state: State, hand: Hand
) -> Float[Array, "dogs 2"]:
    """Velocities in m/s: the shepherd's, but the player's for the dog that is the player's."""
    way = hand.aim - state.dogs
    fast, there = mission.fastest(world.dog, way), way / world.arena.dt
    toward = jnp.where(norm(there)[:, None] < norm(fast)[:, None], there, fast)
    along = jnp.broadcast_to(world.dog.speed * hand.aim, toward.shape)
    own = jnp.where(hand.how == TOWARD, toward, jnp.where(hand.how == ALONG, along, 0.0))
    players = hand.flies & (jnp.arange(len(state.dogs)) == 0)
    return mission.limited(world.dog, jnp.where(players[:, None], own, shepherd(world, seen)))


def _seen(world: World, state: State) -> Sight:
    subgoal, drives = herding.gate(world, state.sheep, state.dogs)
    centre, goal = herding.gcm(state.sheep), herding.goal(world.arena)
    return Sight(
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


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, np.float64), 3).tolist()
