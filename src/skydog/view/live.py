"""The live view: a flock to play with in the browser. Needs: pip install 'skydog[watch]'.

A page has a game of its own: its choices, its world, and the flights in it. The game is pure:
`told` takes an order of the page, `turn` lets time pass. Around it stands a server on loopback,
which computes, while the page draws.
"""

import asyncio
import errno
import json
import logging
import math
import secrets
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.study.report import fill
from skydog.view.colours import ROLES
from skydog.world import herding, mission, params
from skydog.world.mission import Shepherd, State
from skydog.world.params import World
from skydog.world.vectors import norm

MOST_SHEEP, MOST_DOGS = 200, 8
LONGEST_ARENA = 1000.0  # metres
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # multiples of real time
PACE = 10.0  # steps a second that a preset's own speed comes near to
MODES = ("watch", "fly", "race")  # race: fly, beside a second world that the shepherd flies
CASES = 2**31 - 1

TICK = 1 / 60  # seconds between frames, at least
HICCUP = 0.1  # seconds that a game makes up for at most, after a pause of the machine
AHEAD = 3  # frames sent and not yet drawn, at most: a slow page gets fewer, and the latest
RATE = 500  # orders a second that are listened to
PENDING = 64  # orders that a game is behind its page, at most
LONGEST = 4096  # characters of an order that are read
LARGEST = 1 << 16  # bytes of a message; beyond it the connection is closed
COMPILED = 100  # kinds of worlds whose compiled code is kept

HOVER, TOWARD, ALONG = 0, 1, 2  # how a player flies

log = logging.getLogger("skydog.live")
# What is no HTTP or comes from elsewhere is turned away without a page of traceback each.
log.addFilter(lambda record: record.msg != "opening handshake failed")


@dataclass(frozen=True)
class Settings:
    """What a page chooses. Metres, m/s; `speed` in multiples of real time."""

    policy: str
    preset: str = "paper"
    arena: float | None = None  # None is as wide as the flock needs
    sheep: int = 3
    dogs: int = 1
    case: int = 1  # the seed of start and noise
    mode: str = "watch"
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
    named = {name: order[name] for name in _SETTINGS if name in order}
    settings = replace(settings, **named)
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
    pilot = _traced(shepherds[settings.policy])
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
            world, lambda world, seen: _steered(world, shepherd, seen, before, hand), CASES, key
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


def parsed(message: str | bytes, policies: list[str]) -> dict[str, Any]:
    """An order of a page, its values checked. Raises `Refusal` for anything else."""
    if isinstance(message, bytes):
        raise Refusal("an order is text; send JSON, not bytes")
    if len(message) > LONGEST:
        raise Refusal(f"an order has at most {LONGEST} characters, got {len(message)}")
    try:
        order = json.loads(message)
    except (ValueError, RecursionError):
        raise Refusal(f"an order is JSON, got {_short(message)}") from None
    if not isinstance(order, dict):
        raise Refusal(f'an order is an object such as {{"sheep": 5}}, got {_short(message)}')
    checks = _ORDERS | {"policy": _choice("policy", policies)}
    unknown = sorted(set(order) - set(checks))
    if unknown:
        raise Refusal(f"no order is called {_short(unknown[0])}; choose from {', '.join(checks)}")
    return {name: checks[name](value) for name, value in order.items()}


def roster(chosen: str) -> dict[str, Shepherd]:
    """The shepherds to choose from: the rule dogs, all that ship, and the chosen one, first.

    `chosen` is a name among them, or a sheepdog's file or run folder. Raises `Refusal` as
    `store.load` does.
    """
    rules = {"strombom": Strombom(), "strombom-arrive": Strombom(at_point="arrive")}
    first = {chosen: rules[chosen] if chosen in rules else store.load(chosen)}
    return first | rules | {name: store.load(name) for name in store.ships()} | first


def page(nonce: str = "") -> str:
    """The page, whose scripts run under a policy that names `nonce`."""
    view = resources.files("skydog.view")
    return fill(
        view.joinpath("live.html").read_text("utf-8"),
        colours=" ".join(f"--{role}: {colour};" for role, colour in ROLES.items()),
        arena=view.joinpath("arena.js").read_text("utf-8"),
        nonce=nonce,
    )


def serve(
    shepherds: dict[str, Shepherd],
    chosen: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
    host: str = "127.0.0.1",
    port: int = 8020,
    ready: Callable[[str], None] = print,
) -> None:
    """Serve the live view until Ctrl-C. `ready` hears its address as soon as it listens.

    Pages choose among `shepherds` by name, and begin with the `chosen` one. A port of 0 is any
    that is free. Raises `Refusal` for a world that cannot be, and for an address that cannot
    be listened at.
    """

    async def run() -> None:
        async with listening(shepherds, begin, host, port) as url:
            ready(url)
            await asyncio.Event().wait()

    begin = opening(shepherds, chosen, preset, arena, sheep, dogs)
    with suppress(KeyboardInterrupt):
        asyncio.run(run())


def opening(
    shepherds: dict[str, Shepherd],
    chosen: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
) -> Settings:
    """What a page begins with. Raises `Refusal` for what the live view does not show."""
    if chosen not in shepherds:
        raise Refusal(f"no shepherd is called {chosen!r}; choose from {', '.join(shepherds)}")
    if not 1 <= sheep <= MOST_SHEEP:
        raise Refusal(f"the live view has 1 to {MOST_SHEEP} sheep, got {sheep}; try --sheep 60")
    if not 1 <= dogs <= MOST_DOGS:
        raise Refusal(f"the live view has 1 to {MOST_DOGS} dogs, got {dogs}; try --dogs 3")
    params.preset(preset, None if arena is None else float(arena), sheep=sheep if arena else 1)
    if arena is not None and arena > LONGEST_ARENA:
        raise Refusal(f"arena must be at most {LONGEST_ARENA:g} m, got {arena}; try --arena 20")
    begin = with_preset(Settings(policy=chosen), preset)
    return replace(begin, arena=None if arena is None else float(arena), sheep=sheep, dogs=dogs)


@asynccontextmanager
async def listening(
    shepherds: dict[str, Shepherd], begin: Settings, host: str = "127.0.0.1", port: int = 8020
) -> AsyncIterator[str]:
    """The live view's server, as long as the context lasts; gives the address of its page.

    Raises `Refusal` if websockets is missing, or host and port cannot be listened at.
    """
    try:
        from websockets.asyncio.server import serve as serving
    except ImportError:
        raise Refusal("the live view needs websockets; run: pip install 'skydog[watch]'") from None
    if not 0 <= port <= 65535:
        raise Refusal(f"a port is 1 to 65535, got {port}; try --port 8020")
    if host in ("", "0.0.0.0", "::", "*"):
        raise Refusal(
            f"host must be one address, since pages from elsewhere are turned away, got {host!r}; "
            "try --host 127.0.0.1"
        )
    gate = Gate(host)
    table = Table(shepherds, begin)
    try:
        server = await serving(
            table.play,
            host,
            port,
            process_request=gate.answer,
            compression=None,
            max_size=LARGEST,
            max_queue=8,
            server_header=None,
            logger=log,
        )
    except OSError as error:
        raise _no_address(host, port, error) from error
    async with server:
        gate.port = next(iter(server.sockets)).getsockname()[1]
        named = f"[{host}]" if ":" in host else host
        yield f"http://{named}:{gate.port}/"


@dataclass
class Gate:
    """Who comes in: browsers that asked for this host by name, and pages that came from here.

    A foreign page, even one whose name was made to lead here (DNS rebinding), stays outside.
    """

    host: str
    port: int = 0  # known once the server listens

    def answer(self, connection: Any, request: Any) -> Any:
        """The response to a request, or None for one that may open the socket."""
        if request.headers.get("Host") not in self.names():
            return connection.respond(403, f"ask for http://{self.host}:{self.port}/\n")
        path = request.path.partition("?")[0]
        if path == "/live":
            home = {None, *(f"http://{name}" for name in self.names())}
            if request.headers.get("Origin") in home:
                return None
            return connection.respond(403, "this page is not from here\n")
        if path != "/":
            return connection.respond(404, "the live view is at /\n")
        response = connection.respond(200, page(nonce := secrets.token_urlsafe(16)))
        del response.headers["Content-Type"]
        response.headers.update(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Security-Policy": "default-src 'none'; img-src data:; "
                f"style-src 'unsafe-inline'; script-src 'nonce-{nonce}'; connect-src 'self'; "
                "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
                "Cache-Control": "no-store",
                "Cross-Origin-Opener-Policy": "same-origin",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
            }
        )
        return response

    def names(self) -> set[str]:
        """The ways of writing this server's address in a `Host` header."""
        loopback = {"127.0.0.1", "localhost", "[::1]"}
        own = {f"[{self.host}]" if ":" in self.host else self.host.lower()}
        hosts = loopback if own <= loopback else own
        return {f"{host}:{self.port}" for host in hosts} | (hosts if self.port == 80 else set())


@dataclass
class Inbox:
    """What a page has said and its game has not heard yet."""

    orders: list[dict[str, Any]] = field(default_factory=list)
    error: str | None = None  # the latest
    seen: int = 0  # the latest frame that the page has drawn
    bell: asyncio.Event = field(default_factory=asyncio.Event)

    async def news(self) -> None:
        """Wait until the page says something."""
        await self.bell.wait()
        self.bell.clear()

    def put(self, order: dict[str, Any]) -> None:
        """Keep an order for the game; of the moves of a hand in a row, the latest.

        Raises `Refusal` if too many wait: what a page has seen must be read on, or the game,
        which waits for that, would never take them.
        """
        if self.orders and _moves(order) and _moves(self.orders[-1]) == _moves(order):
            self.orders.pop()
        if len(self.orders) >= PENDING:
            raise Refusal(f"{PENDING} orders wait already; send fewer between two frames")
        self.orders += [order] if order else []

    def take(self) -> list[dict[str, Any]]:
        """The orders, in their order, which are then no longer here."""
        orders, self.orders = self.orders, []
        return orders


class Table:
    """Where games are played: what all pages of a server share."""

    def __init__(self, shepherds: dict[str, Shepherd], begin: Settings):
        self.shepherds = shepherds
        self.begin = begin
        self.compiled: set[tuple[Any, ...]] = set()
        self.compiling = asyncio.Semaphore(1)  # so that turns of other pages find a core

    async def play(self, socket: Any) -> None:
        """The game of one page, from its coming to its going."""
        from websockets.exceptions import ConnectionClosed

        inbox = Inbox()
        listens = asyncio.create_task(self._listen(socket, inbox))
        shows = asyncio.create_task(self._show(socket, inbox))
        try:
            await asyncio.wait({listens, shows}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (listens, shows):
                task.cancel()
            ends = await asyncio.gather(listens, shows, return_exceptions=True)
        for end in ends:
            if isinstance(end, Exception) and not isinstance(end, ConnectionClosed):
                raise end

    async def _listen(self, socket: Any, inbox: Inbox) -> None:
        async for message in socket:
            try:
                order = parsed(message, list(self.shepherds))
                inbox.seen = max(inbox.seen, order.pop("seen", 0))
                inbox.put(order)
            except Refusal as refusal:
                inbox.error = str(refusal)
            inbox.bell.set()
            # One page's flood of orders takes no time from the others.
            await asyncio.sleep(1 / RATE)

    async def _show(self, socket: Any, inbox: Inbox) -> None:
        game = new(self.begin)
        clock = asyncio.get_running_loop().time
        sent, owed, before, due = 0, 0.0, clock(), clock()
        known: dict[str, Any] = {}  # what the page need not be told again
        await socket.send(json.dumps({"hello": self._hello()}))
        while True:
            while not inbox.error and (
                sent - inbox.seen >= AHEAD or (game.rests and not inbox.orders)
            ):
                await inbox.news()
            await asyncio.sleep(max(0.0, due - clock()))
            now = clock()
            elapsed, before = min(now - before, HICCUP), now
            due = max(due, now - TICK) + TICK
            orders = inbox.take()
            good = game
            for order in orders:
                try:
                    game = told(game, order)
                except Refusal as refusal:
                    inbox.error = str(refusal)
                await asyncio.sleep(0)
            if inbox.error:
                error, inbox.error = inbox.error, None
                await socket.send(json.dumps({"error": error}))
            rate = game.settings.speed / float(game.world.arena.dt)
            owed = 0.0 if game.rests else owed + elapsed * rate
            steps, owed = int(owed), owed % 1.0
            if orders or steps or not game.flights:
                try:
                    game, frame = await self._turned(game, steps)
                except Exception as error:  # a shepherd may be anybody's
                    if not good.flights:
                        raise
                    log.exception("%s failed", game.settings.policy)
                    inbox.error = f"{game.settings.policy} failed: {_short(str(error))}"
                    game = replace(good, settings=replace(good.settings, paused=True))
                    inbox.orders.insert(0, {"paused": True})  # so that the page hears of it
                    continue
                sent += 1
                fresh = {
                    name: part
                    for name, part in frame.items()
                    if name == "flights" or known.get(name) != part
                }
                known = frame
                await socket.send(json.dumps({"frame": sent, **fresh}, separators=(",", ":")))

    async def _turned(self, game: Game, steps: int) -> tuple[Game, dict[str, Any]]:
        known = game.kind in self.compiled
        if not known and len(self.compiled) >= COMPILED:
            jax.clear_caches()
            self.compiled.clear()
        async with nullcontext() if known else self.compiling:
            turned = await asyncio.to_thread(self._turn, game, steps)
        self.compiled.add(game.kind)
        return turned

    def _turn(self, game: Game, steps: int) -> tuple[Game, dict[str, Any]]:
        game = turn(game, self.shepherds, steps)
        return game, shown(game)

    def _hello(self) -> dict[str, Any]:
        return {
            "policies": list(self.shepherds),
            "presets": {
                name: (make.__doc__ or "").splitlines()[0] for name, make in params.PRESETS.items()
            },
            "speeds": SPEEDS,
            "sheep": MOST_SHEEP,
            "dogs": MOST_DOGS,
        }


def _moves(order: dict[str, Any]) -> str | None:
    """What an order moves, `hold` or `fly`, if that is all it does and it lets nothing go."""
    if len(order) != 1:
        return None
    ((name, value),) = order.items()
    lets_go = value is None or value[0] == HOVER if name in ("hold", "fly") else True
    return None if lets_go else name


def _world(settings: Settings) -> World:
    """The world that the settings ask for, its numbers as arrays: none of them compiles anew."""
    size = _roomy(settings) if settings.arena is None else settings.arena
    world = params.preset(settings.preset, size, settings.sheep)
    noise = settings.noise, settings.perception, settings.actuation
    world = eqx.tree_at(
        lambda w: (w.flock.noise, w.dog.perception_noise, w.dog.actuation_noise), world, noise
    )
    return _traced(world)


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


def _traced(tree: Any) -> Any:
    # Of one type whoever made them, since another would compile anew.
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float32) if isinstance(leaf, int | float) else leaf, tree
    )


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, np.float64), 3).tolist()


def _short(value: object) -> str:
    told = repr(value)
    return told if len(told) <= 40 else told[:37] + "..."


def _no_address(host: str, port: int, error: OSError) -> Refusal:
    if error.errno == errno.EADDRINUSE:
        other = port + 1 if port < 65535 else 8020
        return Refusal(f"port {port} is taken; try --port {other}")
    if error.errno in (errno.EACCES, errno.EPERM):
        return Refusal(f"port {port} needs more rights than you have; try --port 8020")
    return Refusal(f"this machine has no address {host!r}; try --host 127.0.0.1")


Check = Callable[[Any], Any]


def _number(name: str, low: float, high: float) -> Check:
    def check(value: Any) -> float:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not low <= value <= high:
            raise Refusal(f"{name} is a number from {low:g} to {high:g}, got {_short(value)}")
        return float(value)

    return check


def _whole(name: str, low: int, high: int) -> Check:
    def check(value: Any) -> int:
        if type(value) is not int or not low <= value <= high:
            raise Refusal(f"{name} is a whole number from {low} to {high}, got {_short(value)}")
        return value

    return check


def _choice(name: str, choices: list[Any]) -> Check:
    def check(value: Any) -> Any:
        if value not in choices or isinstance(value, bool) != (choices[0] in (True, False)):
            told = ", ".join(map(str, choices))
            raise Refusal(f"{name} is one of {told}, got {_short(value)}")
        return value

    return check


def _fields(name: str, value: Any, known: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict) or set(value) != known:
        raise Refusal(f"{name} has {', '.join(sorted(known))}, or is null; got {_short(value)}")
    return value


def _pair(name: str, value: Any, most: float) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise Refusal(f"{name} is a pair of numbers, got {_short(value)}")
    x, y = map(_number(name, -most, most), value)
    return x, y


def _hold(value: Any) -> tuple[str, int, tuple[float, float]] | None:
    if value is None:
        return None
    held = _fields("hold", value, {"who", "number", "at"})
    return (
        _choice("who", ["dog", "sheep", "goal"])(held["who"]),
        _whole("number", 0, MOST_SHEEP)(held["number"]),
        _pair("at", held["at"], 1e6),
    )


def _course(value: Any) -> tuple[int, tuple[float, float]]:
    if value is None:
        return HOVER, (0.0, 0.0)
    if isinstance(value, dict) and "along" in value:
        return ALONG, _pair("along", _fields("fly", value, {"along"})["along"], 1.0)
    return TOWARD, _pair("toward", _fields("fly", value, {"toward"})["toward"], 1e6)


_ORDERS: dict[str, Check] = {
    "preset": _choice("preset", list(params.PRESETS)),
    "arena": _number("arena", 1.0, LONGEST_ARENA),
    "sheep": _whole("sheep", 1, MOST_SHEEP),
    "dogs": _whole("dogs", 1, MOST_DOGS),
    "policy": _choice("policy", []),
    "mode": _choice("mode", list(MODES)),
    "case": _whole("case", 0, CASES),
    "speed": _number("speed", SPEEDS[0], SPEEDS[-1]),
    "noise": _number("noise", 0.0, 2.0),
    "perception": _number("perception", 0.0, 2.0),
    "actuation": _number("actuation", 0.0, 2.0),
    "paused": _choice("paused", [True, False]),
    "step": _choice("step", [True]),
    "reset": _choice("reset", [True]),
    "hold": _hold,
    "fly": _course,
    "seen": _whole("seen", 0, 2**53),
}
_SETTINGS = [
    name for name in _ORDERS if name not in ("preset", "step", "reset", "hold", "fly", "seen")
]
