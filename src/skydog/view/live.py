"""The live view: a flock to play with in the browser. Needs: pip install 'skydog[watch]'.

A server on loopback computes, a page draws, and each page has a `game` of its own.
"""

import asyncio
import errno
import json
import logging
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from ipaddress import ip_address
from typing import Any
from weakref import WeakSet

import jax

from skydog.errors import Refusal
from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.view.game import HOVER, SPEEDS, Game, Settings, new, shown, told, turn, with_preset
from skydog.view.orders import LONGEST_ARENA, MOST_DOGS, MOST_SHEEP, parsed, short
from skydog.view.page import filled
from skydog.world import params
from skydog.world.mission import Shepherd

TICK = 1 / 60  # seconds between frames, at least
HICCUP = 0.1  # seconds that a game makes up for at most, after a pause of the machine
AHEAD = 3  # frames sent and not yet drawn, at most: a slow page gets fewer, and the latest
RATE = 500  # orders a second that are listened to
PENDING = 64  # orders that a game is behind its page, at most
LARGEST = 1 << 16  # bytes of a message; beyond it the connection is closed
COMPILED = 100  # kinds of worlds whose compiled code is kept

log = logging.getLogger("skydog.live")
# What is no HTTP or comes from elsewhere is turned away without a page of traceback each.
log.addFilter(lambda record: record.msg != "opening handshake failed")


def roster(chosen: str) -> dict[str, Shepherd]:
    """The shepherds to choose from: the rule dogs, all that ship, and the chosen one, first.

    `chosen` is a name among them, or a sheepdog's file or run folder. Raises `Refusal` as
    `store.load` does.
    """
    rules = {"strombom": Strombom(), "strombom-arrive": Strombom(at_point="arrive")}
    first = {chosen: rules[chosen] if chosen in rules else store.load(chosen)}
    return first | rules | {name: store.load(name) for name in store.ships()} | first


def page(nonce: str) -> str:
    """The page, whose scripts run under a policy that names `nonce`."""
    return filled("live.html", nonce=nonce)


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
    shepherds: dict[str, Shepherd], begin: Settings, host: str, port: int
) -> AsyncIterator[str]:
    """The live view's server, as long as the context lasts; gives the address of its page.

    It ends at once, whatever its pages do: their connections are cut.
    Raises `Refusal` if websockets is missing, or host and port cannot be listened at.
    """
    try:
        from websockets.asyncio.server import ServerConnection
        from websockets.asyncio.server import serve as serving
    except ImportError:
        raise Refusal("the live view needs websockets; run: pip install 'skydog[watch]'") from None
    if not 0 <= port <= 65535:
        raise Refusal(f"a port is 1 to 65535, got {port}; try --port 8020")
    gate = Gate(host, _address(host, port))

    class Link(ServerConnection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            links.add(self)

    links: WeakSet[Link] = WeakSet()
    table = Table(shepherds, begin)
    try:
        server = await serving(
            table.play,
            gate.address,
            port,
            create_connection=Link,
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
        try:
            yield gate.url
        finally:
            # Whoever is just being let in is let in first, to be cut like the others: else Python
            # 3.13 complains of a connection that nobody closed.
            await asyncio.sleep(TICK)
            server.close()
            closed = asyncio.create_task(server.wait_closed())
            while not closed.done():
                for link in links:
                    link.transport.abort()
                await asyncio.wait({closed}, timeout=TICK)


@dataclass
class Gate:
    """Who comes in: browsers that asked for this host by name, and pages that came from here.

    A foreign page, even one whose name was made to lead here (DNS rebinding), stays outside.
    """

    host: str  # as the user called it
    address: str  # where that is: 127.1, say, is 127.0.0.1, and browsers write it so
    port: int = 0  # known once the server listens

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{_bracketed(self.address)}:{self.port}/"

    def answer(self, connection: Any, request: Any) -> Any:
        """The response to a request, or None for one that may open the socket."""
        # Of a header given twice, which no browser does, none counts.
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or hosts[0] not in self.names():
            return connection.respond(403, f"ask for {self.url}\n")
        path = request.path.partition("?")[0]
        if path == "/live":
            home = [[f"http://{name}"] for name in self.names()]
            if origins in [[], *home]:
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
        own = {_bracketed(self.host.lower()), _bracketed(self.address)}
        hosts = own | loopback if own & loopback else own
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
                    inbox.error = f"{game.settings.policy} failed: {short(str(error))}"
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


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _address(host: str, port: int) -> str:
    """Where a host is. Raises `Refusal` if that is nowhere, or everywhere."""
    try:
        found = [str(each[4][0]) for each in socket.getaddrinfo(host or "0.0.0.0", port)]
    except OSError as error:
        raise _no_address(host, port, error) from error
    except UnicodeError:
        raise Refusal(f"{short(host)} is no name of a host; try --host 127.0.0.1") from None
    if host == "*" or any(ip_address(address).is_unspecified for address in found):
        raise Refusal(
            f"host must be one address, since pages from elsewhere are turned away, got {host!r}; "
            "try --host 127.0.0.1"
        )
    return found[0]


def _no_address(host: str, port: int, error: OSError) -> Refusal:
    if error.errno == errno.EADDRINUSE:
        other = port + 1 if port < 65535 else 8020
        return Refusal(f"port {port} is taken; try --port {other}")
    if error.errno in (errno.EACCES, errno.EPERM):
        return Refusal(f"port {port} needs more rights than you have; try --port 8020")
    return Refusal(f"this machine has no address {host!r}; try --host 127.0.0.1")
