"""Who may open the live view: browsers on this machine, and pages that came from here."""

import errno
import secrets
import socket
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any

from skydog.errors import Refusal
from skydog.view.messages import short
from skydog.view.page import live_page


@dataclass
class Access:
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

    def names(self) -> set[str]:
        """The ways of writing this server's address in a `Host` header."""
        loopback = {"127.0.0.1", "localhost", "[::1]"}
        own = {_bracketed(self.host.lower()), _bracketed(self.address)}
        hosts = own | loopback if own & loopback else own
        return {f"{host}:{self.port}" for host in hosts} | (hosts if self.port == 80 else set())


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def address_of(host: str, port: int) -> str:
    """Where a host is. Raises `Refusal` if that is nowhere, or everywhere."""
    try:
        found = [str(each[4][0]) for each in socket.getaddrinfo(host or "0.0.0.0", port)]
    except OSError as error:
        raise no_address(host, port, error) from error
    except UnicodeError:
        raise Refusal(f"{short(host)} is no name of a host; try --host 127.0.0.1") from None
    if host == "*" or any(ip_address(address).is_unspecified for address in found):
        raise Refusal(
            f"host must be one address, since pages from elsewhere are turned away, got {host!r}; "
            "try --host 127.0.0.1"
        )
    return found[0]


def no_address(host: str, port: int, error: OSError) -> Refusal:
    """What to say when an address cannot be listened at."""
    if error.errno == errno.EADDRINUSE:
        other = port + 1 if port < 65535 else 8020
        return Refusal(f"port {port} is taken; try --port {other}")
    if error.errno in (errno.EACCES, errno.EPERM):
        return Refusal(f"port {port} needs more rights than you have; try --port 8020")
    return Refusal(f"this machine has no address {host!r}; try --host 127.0.0.1")
