"""A reverse proxy as others run them: https outside, a path and a name of its own."""

import asyncio
import re
import shutil
import ssl
import subprocess
from contextlib import asynccontextmanager
from urllib.parse import urlsplit

import pytest

from skydog.view.server import Server

PATH = "/skydog/"


def proxied(url, folder):
    """A proxy to the live view at an address, as a context; its certificate lies in a folder."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("openssl is not on the PATH, so there is no certificate for https")
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    asks = [
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "1",
        "-subj",
        "/CN=lab.localhost",
    ]
    command = [openssl, *asks, "-keyout", key, "-out", certificate]
    subprocess.run(command, check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    return Server(_listening(urlsplit(url), context))


@asynccontextmanager
async def _listening(inner, context):
    async def let_in(reader, writer):
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        head = head.replace(f" {PATH}", " /", 1)
        head = re.sub("Host: (.*)\r\n", rf"Host: {inner.netloc}\r\nX-Forwarded-Host: \1\r\n", head)
        further, onwards = await asyncio.open_connection(inner.hostname, inner.port)
        onwards.write(head.encode())
        try:
            await asyncio.gather(pour(reader, onwards), pour(further, writer))
        finally:
            onwards.close()
            writer.close()

    async def pour(reader, writer):
        while content := await reader.read(1 << 16):
            writer.write(content)
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(let_in, "127.0.0.1", 0, ssl=context)
    try:
        yield f"https://lab.localhost:{server.sockets[0].getsockname()[1]}{PATH}"
    finally:
        server.close()
