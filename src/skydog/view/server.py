"""The live view's server, in a thread of its own: whoever starts it may have a loop already."""

import asyncio
import logging
import threading
from collections.abc import AsyncIterator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from typing import Any
from weakref import WeakSet

from skydog.errors import Refusal
from skydog.view.access import Access, address_of, no_address
from skydog.view.connection import TICK, Pages

LARGEST = 1 << 16  # bytes of a message; beyond it the connection is closed

log = logging.getLogger("skydog.live")
# What is no HTTP or comes from elsewhere is turned away without a page of traceback each.
log.addFilter(lambda record: record.msg != "opening handshake failed")


class Server:
    """A live view that is being served; its page has the address `url`.

    Used with `with`, it is closed at the end.
    """

    def __init__(self, listens: AbstractAsyncContextManager[str]):
        started: Future[tuple[str, asyncio.AbstractEventLoop, asyncio.Event]] = Future()
        run = _run(listens, started)
        self._thread = threading.Thread(target=asyncio.run, args=[run], daemon=True)
        self._thread.start()
        self.url, self._loop, self._over = started.result()

    def __repr__(self) -> str:
        return f"live view at {self.url}"

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait(self) -> None:
        """Wait until it is closed. Ctrl-C closes it."""
        with suppress(KeyboardInterrupt), self:
            self._thread.join()

    def close(self) -> None:
        """End the server and cut its connections. No thread and no socket stays."""
        with suppress(RuntimeError):  # it was closed before
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()


async def _run(listens: AbstractAsyncContextManager[str], started: Future[Any]) -> None:
    over = asyncio.Event()
    try:
        async with listens as url:
            started.set_result((url, asyncio.get_running_loop(), over))
            await over.wait()
    except Exception as error:
        if started.done():
            raise
        started.set_exception(error)
    # Whoever was just being let in: the task ends, and in the loop's next turn the socket closes.
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for other in others:
        other.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    await asyncio.sleep(TICK)


@asynccontextmanager
async def listening(pages: Pages, host: str, port: int) -> AsyncIterator[str]:
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
