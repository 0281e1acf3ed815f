"""Guard of the page's server: permitted connections, and accepted messages.

viser checks neither the origin of a connection nor its messages. Any site that somebody visits could so open a web
socket to the page on this machine, play with it and read it; and one message that is none would fill the terminal with
tracebacks, or everybody's panel with NaN.
"""

import asyncio
import contextlib
import functools
import http
import ipaddress
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from balloon_warp.viewer.dressing import dress
from balloon_warp.viewer.messages import MOST_BYTES, understood
from balloon_warp.viewer.origins import Origins

MOST_CONNECTIONS = 128
"""Largest number of simultaneous connections: a browser takes six to load the page, and one to stay"""
FRAMED = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:* vscode-webview:"
"""Pages that may embed the page: those of this machine, such as notebooks"""
MOST_NONSENSE = 100
"""Number of invalid messages after which a connection is closed"""

_log = logging.getLogger("balloon_warp.viewer.connections")
_log.propagate = False  # messages of strangers are not reported on the terminal
_log.addHandler(logging.NullHandler())

Handler = Callable[[ServerConnection], Awaitable[None]]


@contextlib.contextmanager
def guarded(host: str, control: Callable[[str], Any], origins: Origins) -> Iterator[None]:
    """Guard a `ViserServer` that is made within this context.

    viser leaves no opening for this, so for that moment its way to listen, `websockets.asyncio.server.serve`, is ours.

    Args:
        host: Address that it listens on.
        control: Returns the control of the panel that has an id, or None.
        origins: Origins that may connect.

    Raises:
        RuntimeError: The server listens in another way. It is guarded or it does not start.
    """
    plain, listening = websockets.asyncio.server.serve, []

    def serve(handler: Handler, *place: Any, process_request: Any, **options: Any) -> Any:
        listening.append(place)
        connection: Any = functools.partial(_connection, control)  # a function will do, whatever its type
        asyncio.get_running_loop().set_exception_handler(_note)
        return plain(
            functools.partial(_greet, handler),
            *place,
            process_request=functools.partial(_admit, names_of(host), origins, process_request),
            create_connection=connection,
            logger=_log,
            **{**options, "max_size": MOST_BYTES},
        )

    websockets.asyncio.server.serve = serve
    try:
        yield
    finally:
        websockets.asyncio.server.serve = plain
    if not listening:
        raise RuntimeError(f"viser {viser.__version__} opens connections that are not guarded")


def names_of(host: str) -> set[str]:
    """Return the names of this machine, besides its addresses, in requests for the page.

    A name that somebody else lets point here (DNS rebinding) is none.
    """
    own = socket.gethostname()
    return {name.lower() for name in ("localhost", host, own, f"{own}.local", socket.getfqdn())}


def is_ours(authority: str, names: set[str]) -> bool:
    """Return whether a `Host` header means this machine.

    That is one of its names, or an address, which nobody can let point elsewhere.
    """
    try:
        name = urlsplit(f"//{authority}").hostname or ""
    except ValueError:
        return False
    with contextlib.suppress(ValueError):
        return bool(ipaddress.ip_address(name))
    return name in names


def _admit(
    names: set[str], trusted: Origins, serve_file: Any, connection: ServerConnection, request: Request
) -> Response | None:
    """Return a refusal, a file of the page, or nothing, where a web socket opens."""
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    if len(hosts) != 1 or not is_ours(hosts[0], names | trusted.hosts):
        for host in hosts[:1]:
            trusted.refuse(f"https://{host}")
        said = "Refused: open this page at an address of its machine, or at the name given as --host or --origin.\n"
        return connection.respond(http.HTTPStatus.FORBIDDEN, said)
    if len(origins) > 1 or not all(trusted.admit(origin, hosts[0]) for origin in origins):
        return connection.respond(http.HTTPStatus.FORBIDDEN, "Refused: this page takes no requests from other sites.\n")
    answer = trusted.answer(request.path, hosts[0])
    if answer is not None:
        return connection.respond(http.HTTPStatus.FORBIDDEN if answer else http.HTTPStatus.OK, answer)
    response = serve_file(connection, request)
    if response:
        # Nor may another show it as its own, to have it clicked.
        response.headers["Content-Security-Policy"] = " ".join([FRAMED, *trusted.trusted])
        dress(response)
    return response


async def _greet(handler: Handler, connection: ServerConnection) -> None:
    """Take in a window of this version of the page; one from before an update hears that it is."""
    if connection.subprotocol == f"viser-v{viser.__version__}":
        await handler(connection)
    else:
        await connection.close(1002, "This page is out of date; reload it")


class _Connection(ServerConnection):
    """Connection that hears only valid messages, and ends after `MOST_NONSENSE` others."""

    control: Callable[[str], Any]
    nonsense = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if len(self.server.handlers) > MOST_CONNECTIONS:
            self.transport.abort()

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            message = understood(await super().recv(decode=False), self.control)
            if message is not None:
                return message
            self.nonsense += 1
            if self.nonsense == MOST_NONSENSE:
                self.transport.abort()  # whoever says it would not take part in a farewell


def _connection(control: Callable[[str], Any], *arguments: Any, **options: Any) -> _Connection:
    connection = _Connection(*arguments, **options)
    connection.control = control
    return connection


def _note(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log an error in the handling of a message, which ends that message alone."""
    _log.error(context["message"], exc_info=context.get("exception"))
