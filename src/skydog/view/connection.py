"""What goes between a page of the live view and its session: messages in, frames out."""

import asyncio
import json
import logging
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import jax

from skydog.errors import Refusal
from skydog.shepherds import scope
from skydog.view import session as sessions
from skydog.view.messages import MOST_DOGS, MOST_SHEEP, parse, short
from skydog.view.session import HOVER, SPEEDS, Session, Settings, Worlds
from skydog.world.mission import Shepherd
from skydog.world.options import SCENE_NAMES

TICK = 1 / 60  # seconds between frames, at least
HICCUP = 0.1  # seconds that a session makes up for at most, after a pause of the machine
AHEAD = 3  # frames sent and not yet drawn, at most: a slow page gets fewer, and the latest
RATE = 500  # messages per second that are read
PENDING = 64  # messages that a session is behind its page, at most
COMPILED = 100  # kinds of worlds whose compiled code is kept

Cards = Mapping[str, dict[str, Any]]
"""The cards of sheepdogs, by the name that a page calls them."""

log = logging.getLogger("skydog.live")


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
        own = [] if begin.scene is None or begin.scene in SCENE_NAMES else [begin.scene]
        self.scenes = [*own, *SCENE_NAMES]
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
                said = parse(message, list(self.shepherds), list(self.worlds), self.scenes)
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
            if inbox.error:
                error, inbox.error = inbox.error, None
                await socket.send(json.dumps({"error": error}))
                continue
            if sent - inbox.seen >= AHEAD or (session.rests and not inbox.messages):
                await inbox.wait()
                continue
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
            rate = session.settings.speed / float(session.world.arena.dt)
            owed = 0.0 if session.rests else owed + elapsed * rate
            steps, owed = int(owed), owed % 1.0
            if not (messages or steps or not session.flights):
                continue
            if session.kind not in self.compiled:
                await socket.send(json.dumps({"compiling": True}))
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
            loop = asyncio.get_running_loop()
            try:
                work = loop.run_in_executor(None, self._advance_now, session, steps)
            except RuntimeError as over:  # the program ends, and lets nobody begin anything
                raise asyncio.CancelledError from over
            advanced = await work
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
            "scenes": self.scenes,
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
