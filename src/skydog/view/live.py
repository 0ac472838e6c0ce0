"""The live view: a flock to play with in the browser. Needs: pip install 'skydog[watch]'.

A server on loopback computes, a page draws, and each page has a `session` of its own.
"""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakSet

import jax

from skydog.errors import Refusal
from skydog.shepherds import scope, store
from skydog.shepherds.sheepdog import Sheepdog
from skydog.shepherds.strombom import Strombom
from skydog.view import session as sessions
from skydog.view.access import Access, address_of, no_address
from skydog.view.messages import LONGEST_ARENA, MOST_DOGS, MOST_SHEEP, parse, short
from skydog.view.session import HOVER, SPEEDS, Session, Settings, Worlds
from skydog.world.mission import Shepherd
from skydog.world.presets import PRESETS, Point, make

TICK = 1 / 60  # seconds between frames, at least
HICCUP = 0.1  # seconds that a session makes up for at most, after a pause of the machine
AHEAD = 3  # frames sent and not yet drawn, at most: a slow page gets fewer, and the latest
RATE = 500  # messages per second that are read
PENDING = 64  # messages that a session is behind its page, at most
LARGEST = 1 << 16  # bytes of a message; beyond it the connection is closed
COMPILED = 100  # kinds of worlds whose compiled code is kept

Cards = Mapping[str, dict[str, Any]]
"""The cards of sheepdogs, by the name that a page calls them."""

log = logging.getLogger("skydog.live")
# What is no HTTP or comes from elsewhere is turned away without a page of traceback each.
log.addFilter(lambda record: record.msg != "opening handshake failed")


def policies(chosen: str) -> dict[str, Shepherd]:
    """The shepherds to choose from: the rule dogs, all that ship, and the chosen one, first.

    `chosen` is a name among them, or a sheepdog's file or run folder. Raises `Refusal` as
    `store.load` does.
    """
    rules = {"strombom": Strombom(), "strombom-arrive": Strombom(at_point="arrive")}
    first = {chosen: rules[chosen] if chosen in rules else store.load(chosen)}
    return first | rules | {name: store.load(name) for name in store.ships()} | first


def cards(shepherds: Mapping[str, Shepherd]) -> dict[str, dict[str, Any]]:
    """The cards of the sheepdogs among `policies`, by name."""
    learnt = [name for name, steers in shepherds.items() if isinstance(steers, Sheepdog)]
    return {name: store.read(name)[1] for name in learnt}


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
    worlds: Worlds = PRESETS,
    goal: Point | None = None,
    goal_radius: float | None = None,
    cards: Cards | None = None,
) -> None:
    """Serve the live view until Ctrl-C. `ready` is called with its address as soon as it listens.

    Pages choose among `shepherds` and `worlds` by name, and begin with the `chosen` shepherd and
    the `preset`. `cards` tell what each sheepdog was taught for. A port of 0 is any that is free.
    Raises `Refusal` for a world that cannot be, and for an address that cannot be listened at.
    """

    async def run() -> None:
        async with listening(shepherds, begin, host, port, worlds, cards) as url:
            ready(url)
            await asyncio.Event().wait()

    begin = opening(shepherds, chosen, preset, arena, sheep, dogs, worlds, goal, goal_radius)
    with suppress(KeyboardInterrupt):
        asyncio.run(run())


def opening(
    shepherds: dict[str, Shepherd],
    chosen: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
    worlds: Worlds = PRESETS,
    goal: Point | None = None,
    goal_radius: float | None = None,
) -> Settings:
    """What a page begins with. Raises `Refusal` for what the live view does not show."""
    if chosen not in shepherds:
        raise Refusal(f"no shepherd is called {chosen!r}; choose from {', '.join(shepherds)}")
    if not 1 <= sheep <= MOST_SHEEP:
        raise Refusal(f"the live view has 1 to {MOST_SHEEP} sheep, got {sheep}; try --sheep 60")
    if not 1 <= dogs <= MOST_DOGS:
        raise Refusal(f"the live view has 1 to {MOST_DOGS} dogs, got {dogs}; try --dogs 3")
    if goal_radius is not None and not 0.0 < goal_radius <= LONGEST_ARENA / 2:
        raise Refusal(
            f"the goal's radius is at most {LONGEST_ARENA / 2:g} m, got {goal_radius}; "
            "try --goal-radius 2"
        )
    if preset not in worlds:
        raise Refusal(f"no preset is called {preset!r}; choose from {', '.join(worlds)}")
    if arena is not None:
        make(worlds[preset], float(arena), sheep, goal, goal_radius)
    if arena is not None and arena > LONGEST_ARENA:
        raise Refusal(f"arena must be at most {LONGEST_ARENA:g} m, got {arena}; try --arena 20")
    begin = sessions.with_preset(Settings(policy=chosen, sheep=sheep), preset, worlds)
    begin = replace(begin, arena=None if arena is None else float(arena), sheep=sheep, dogs=dogs)
    begin = replace(begin, goal=goal, goal_radius=goal_radius)
    sessions.new(begin, worlds)
    return begin


@asynccontextmanager
async def listening(
    shepherds: dict[str, Shepherd],
    begin: Settings,
    host: str,
    port: int,
    worlds: Worlds = PRESETS,
    cards: Cards | None = None,
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
    access = Access(host, address_of(host, port))

    class Link(ServerConnection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            links.add(self)

    links: WeakSet[Link] = WeakSet()
    pages = Pages(shepherds, begin, worlds, cards or {})
    try:
        server = await serving(
            pages.serve,
            access.address,
            port,
            create_connection=Link,
            process_request=access.answer,
            compression=None,
            max_size=LARGEST,
            max_queue=8,
            server_header=None,
            logger=log,
        )
    except OSError as error:
        raise no_address(host, port, error) from error
    async with server:
        access.port = next(iter(server.sockets)).getsockname()[1]
        try:
            yield access.url
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
class Inbox:
    """The messages of a page that its session has not read yet."""

    messages: list[dict[str, Any]] = field(default_factory=list)
    error: str | None = None  # the latest
    seen: int = 0  # the latest frame that the page has drawn
    arrived: asyncio.Event = field(default_factory=asyncio.Event)

    async def wait(self) -> None:
        """Wait until the page says something."""
        await self.arrived.wait()
        self.arrived.clear()

    def put(self, message: dict[str, Any]) -> None:
        """Keep a message for the session; of the moves of a pointer in a row, the latest.

        Raises `Refusal` if too many wait: what a page has seen must be read on, or the session,
        which waits for that, would never take them.
        """
        if self.messages and _moves(message) and _moves(self.messages[-1]) == _moves(message):
            self.messages.pop()
        if len(self.messages) >= PENDING:
            raise Refusal(f"{PENDING} messages wait already; send fewer between two frames")
        self.messages += [message] if message else []

    def take(self) -> list[dict[str, Any]]:
        """The messages, the first one first, which are then no longer here."""
        messages, self.messages = self.messages, []
        return messages


class Pages:
    """What all pages of a server share."""

    def __init__(
        self, shepherds: dict[str, Shepherd], begin: Settings, worlds: Worlds, cards: Cards
    ):
        self.shepherds = shepherds
        self.worlds = worlds
        self.cards = cards
        self.begin = begin
        self.compiled: set[tuple[Any, ...]] = set()
        self.compiling = asyncio.Semaphore(1)  # so that other pages find a core

    async def serve(self, socket: Any) -> None:
        """The session of one page, from its coming to its going."""
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
                said = parse(message, list(self.shepherds), list(self.worlds))
                inbox.seen = max(inbox.seen, said.pop("seen", 0))
                inbox.put(said)
            except Refusal as refusal:
                inbox.error = str(refusal)
            inbox.arrived.set()
            # One page's flood of messages takes no time from the others.
            await asyncio.sleep(1 / RATE)

    async def _show(self, socket: Any, inbox: Inbox) -> None:
        session = sessions.new(self.begin, self.worlds)
        clock = asyncio.get_running_loop().time
        sent, owed, before, due = 0, 0.0, clock(), clock()
        known: dict[str, Any] = {}  # what need not be sent again
        await socket.send(json.dumps({"hello": self._hello()}))
        while True:
            while not inbox.error and (
                sent - inbox.seen >= AHEAD or (session.rests and not inbox.messages)
            ):
                await inbox.wait()
            await asyncio.sleep(max(0.0, due - clock()))
            now = clock()
            elapsed, before = min(now - before, HICCUP), now
            due = max(due, now - TICK) + TICK
            messages = inbox.take()
            good = session
            for message in messages:
                try:
                    session = sessions.update(session, message)
                except Refusal as refusal:
                    inbox.error = str(refusal)
                await asyncio.sleep(0)
            if inbox.error:
                error, inbox.error = inbox.error, None
                await socket.send(json.dumps({"error": error}))
            rate = session.settings.speed / float(session.world.arena.dt)
            owed = 0.0 if session.rests else owed + elapsed * rate
            steps, owed = int(owed), owed % 1.0
            if messages or steps or not session.flights:
                try:
                    session, frame = await self._advance(session, steps)
                except Exception as error:  # a shepherd may be anybody's
                    if not good.flights:
                        raise
                    log.exception("%s failed", session.settings.policy)
                    inbox.error = f"{session.settings.policy} failed: {short(str(error))}"
                    session = replace(good, settings=replace(good.settings, paused=True))
                    inbox.messages.insert(0, {"paused": True})  # so that the page is sent it
                    continue
                sent += 1
                fresh = {
                    name: part
                    for name, part in frame.items()
                    if name == "flights" or known.get(name) != part
                }
                known = frame
                await socket.send(json.dumps({"frame": sent, **fresh}, separators=(",", ":")))

    async def _advance(self, session: Session, steps: int) -> tuple[Session, dict[str, Any]]:
        known = session.kind in self.compiled
        if not known and len(self.compiled) >= COMPILED:
            jax.clear_caches()
            self.compiled.clear()
        async with nullcontext() if known else self.compiling:
            advanced = await asyncio.to_thread(self._advance_now, session, steps)
        self.compiled.add(session.kind)
        return advanced

    def _advance_now(self, session: Session, steps: int) -> tuple[Session, dict[str, Any]]:
        session = sessions.advance(session, self.shepherds, steps)
        return session, {**sessions.view(session), "beyond": self._beyond(session)}

    def _beyond(self, session: Session) -> list[str]:
        chosen = session.settings
        return scope.beyond(self.cards.get(chosen.policy, {}), session.world, chosen.sheep)

    def _hello(self) -> dict[str, Any]:
        return {
            "policies": list(self.shepherds),
            "presets": {
                name: (maker.__doc__ or name).splitlines()[0] for name, maker in self.worlds.items()
            },
            "speeds": SPEEDS,
            "sheep": MOST_SHEEP,
            "dogs": MOST_DOGS,
        }


def _moves(message: dict[str, Any]) -> str | None:
    """What a message moves, `hold` or `fly`, if that is all it does and it lets nothing go."""
    if len(message) != 1:
        return None
    ((name, value),) = message.items()
    lets_go = value is None or value[0] == HOVER if name in ("hold", "fly") else True
    return None if lets_go else name
