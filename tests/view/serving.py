"""The live view's server, for the tests of its manners and of its page."""

import asyncio
import threading
from concurrent.futures import Future
from contextlib import contextmanager

from skydog.shepherds import store
from skydog.shepherds.strombom import Strombom
from skydog.view import live

SHEPHERDS = {"strombom": Strombom(), "h-ddpg-4x4": store.load("h-ddpg-4x4")}


@contextmanager
def serving(shepherds=SHEPHERDS, chosen="h-ddpg-4x4", port=0):
    """A server in a thread of its own, as long as the context lasts."""
    found = Future()

    async def run():
        over = asyncio.Event()
        begin = live.opening(shepherds, chosen)
        async with live.listening(shepherds, begin, "127.0.0.1", port) as url:
            found.set_result((url, asyncio.get_running_loop(), over))
            await over.wait()

    server = threading.Thread(target=lambda: asyncio.run(run()))
    server.start()
    url, loop, over = found.result(60)
    try:
        yield url
    finally:
        loop.call_soon_threadsafe(over.set)
        server.join(60)
        assert not server.is_alive()
