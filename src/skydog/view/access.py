"""Who may open the live view: browsers that asked for this machine, and pages that came from it."""

import errno
import re
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any

from skydog.errors import Refusal
from skydog.view.messages import short
from skydog.view.page import live_page

HOST = re.compile(r"(\[[^\[\]]+\]|[^\[\]:]+)(:[0-9]{1,5})?")  # name or address, and the port


@dataclass
class Access:
    """Who comes in: browsers that asked for this machine, and pages that came from here.

    A foreign page whose name was made to lead here (DNS rebinding) stays outside: what a browser
    asks for has to be `localhost`, the host as the user called it, or an address, to which no name
    leads. The port may be any: a tunnel has its own. A proxy has a name of its own, and is known by
    its `X-Forwarded-` headers: no page can have a browser send such a header with the handshake of
    a socket. Whatever was asked for, only a page from there may open the socket.
    """

    host: str  # as the user called it
    address: str  # where that is
    port: int = 0  # known once the server listens

    @property
    def url(self) -> str:
        """The address of the page, on this machine if the server listens at all its addresses."""
        address = ip_address(self.address)
        if address.is_unspecified:
            address = ip_address("127.0.0.1" if address.version == 4 else "::1")
        return f"http://{_bracketed(str(address))}:{self.port}/"

    def answer(self, connection: Any, request: Any) -> Any:
        """The response to a request, or None for one that may open the socket."""
        told = request.headers.get_all
        hosts, origins = told("Host"), told("Origin")
        proxied = any(name.lower().startswith("x-forwarded-") for name in request.headers)
        # Of a header given twice, which no browser does, none counts.
        if len(hosts) != 1 or not (proxied or self.is_asked(hosts[0])):
            return connection.respond(403, f"ask for {self.url}; a proxy says X-Forwarded-Host\n")
        path = request.path.partition("?")[0]
        if path == "/live":
            asked = ",".join(told("X-Forwarded-Host") or hosts).replace(" ", "").split(",")
            home = [[f"{scheme}://{name}"] for scheme in ("http", "https") for name in asked]
            if origins in [[], *home]:
                return None
            return connection.respond(403, "this page is not from here\n")
        if path != "/":
            return connection.respond(404, "the live view is at /\n")
        response = connection.respond(200, live_page(nonce := secrets.token_urlsafe(16)))
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

    def is_asked(self, host: str) -> bool:
        """Whether a `Host` header asks for this machine, and by no name that can be foreign."""
        parts = HOST.fullmatch(host)
        return parts is not None and (
            parts[1] in ("localhost", self.host.lower()) or _is_address(parts[1])
        )


def _is_address(name: str) -> bool:
    """Whether a name is an address as browsers write it."""
    with suppress(ValueError):
        return name == _bracketed(str(ip_address(name.strip("[]"))))
    return False


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def address_of(host: str, port: int) -> str:
    """Where a host is. Raises `Refusal` if that is nowhere."""
    try:
        return str(socket.getaddrinfo(host, port)[0][4][0])
    except OSError as error:
        raise no_address(host, port, error) from error
    except ValueError:
        raise Refusal(f"{short(host)} is no name of a host; try --host 127.0.0.1") from None


def no_address(host: str, port: int, error: OSError) -> Refusal:
    """What to say when an address cannot be listened at."""
    if error.errno == errno.EADDRINUSE:
        other = port + 1 if port < 65535 else 8020
        return Refusal(f"port {port} is taken; try --port {other}")
    if error.errno in (errno.EACCES, errno.EPERM):
        return Refusal(f"port {port} needs more rights than you have; try --port 8020")
    return Refusal(f"this machine has no address {short(host)}; try --host 127.0.0.1")
