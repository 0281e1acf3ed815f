"""The server of a page: at a port that is free, guarded, in our colors.

Guard of the page's server: permitted connections, and accepted messages.

viser checks neither the origin of a connection nor its messages. Any site that somebody visits could so open a web
socket to the page on this machine, play with it and read it; and one message that is none would fill the terminal with
tracebacks, or everybody's panel with NaN.
"""

import asyncio
import contextlib
import functools
import gzip
import http
import io
import ipaddress
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import suppress
from importlib.resources import files
from typing import Annotated, Any, Literal
from urllib.parse import parse_qs, unquote, urlsplit

import msgspec
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from balloon_warp.errors import InputError
from balloon_warp.studio.page import drawings
from balloon_warp.studio.page.controls import key_sheet

MOST_TOLD = 20
"""Largest number of refused origins that are reported on the terminal"""
QUESTION = "/may-i"
"""Path that the page requests to learn whether its own address may connect to the server"""


class Origins:
    """Trusted origins of the page: scheme, host and port, as a browser sends them.

    Args:
        trusted: those that may, beside the page's own address.
        on_refused: told once of each that may not, in a sentence that says how it could.

    Raises:
        InputError: one of them is no origin.
    """

    def __init__(self, trusted: Sequence[str], on_refused: Callable[[str], None]):
        self.trusted = [_checked(origin) for origin in trusted]
        self._on_refused = on_refused
        self._told: set[str] = set()

    @property
    def hosts(self) -> set[str]:
        """Host names of the trusted origins: a proxy may hand on the name by which it was asked."""
        return {str(urlsplit(origin).hostname) for origin in self.trusted}

    def admit(self, origin: str, host: str) -> bool:
        """Return whether an `Origin` header may come with a `Host` header; if not, report it on the terminal."""
        if origin.lower() in self.trusted or origin.partition("://")[2] == host:
            return True
        self.refuse(origin)
        return False

    def refuse(self, origin: str) -> None:
        """Report a refused origin on the terminal, once."""
        if origin not in self._told and len(self._told) < MOST_TOLD and origin.isprintable():
            self._told.add(origin)
            self._on_refused(refusal(origin))

    def answer(self, path: str, host: str) -> str | None:
        """Return the answer to a page that asks whether its own address may connect.

        Empty if it may, and None if the request is another.
        """
        parts = urlsplit(path)
        if parts.path != QUESTION:
            return None
        origin = unquote(parse_qs(parts.query).get("from", [""])[0])
        return "" if self.admit(origin, host) else refusal(origin)


def refusal(origin: str) -> str:
    """Return a sentence on a refused origin, and how to permit it."""
    return (
        f"a page at {origin} is refused; if you opened it there, through a proxy of yours, start the page with "
        f"--origin {origin}, in Python origins=['{origin}']"
    )


def _checked(origin: str) -> str:
    text = str(origin).rstrip("/").lower()
    with suppress(ValueError):  # of a port that is none
        parts = urlsplit(text)
        whole = text == f"{parts.scheme}://{parts.netloc}" and parts.hostname and parts.port != 0
        if whole and parts.scheme in ("http", "https") and "@" not in text:
            return text
    raise InputError(f"origin {origin}: expected http:// or https://, a host and maybe a port, and no path")


MOST_BYTES = 1 << 16
"""Largest size of a message [bytes]; those of a browser have a few hundred"""
Real = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
"""Number as in the scene; neither NaN nor infinite"""
Word = Annotated[str, msgspec.Meta(max_length=300)]
Pixel = tuple[Real, Real]
Place = tuple[Real, Real, Real]
Few = Annotated[list[Real], msgspec.Meta(max_length=4)]


class Said(msgspec.Struct, tag=True, tag_field="type", forbid_unknown_fields=True):
    """A message, named as viser names it, with viser's fields."""


class ViewerCameraMessage(Said):
    """Place of a window's camera."""

    wxyz: tuple[Real, Real, Real, Real]
    position: Place
    fov: Real
    near: Real
    far: Real
    image_height: Real
    image_width: Real
    look_at: Place
    up_direction: Place


class ScenePointerMessage(Said):
    """A click into the scene."""

    event_type: Literal["click"]
    ray_origin: Place
    ray_direction: Place
    screen_pos: tuple[Pixel]
    modifier: Word | None


class SceneNodeDragMessage(Said):
    """A balloon is dragged."""

    phase: Literal["start", "update", "end"]
    name: Word
    instance_index: None
    start_position: Place
    start_screen_pos: Pixel
    end_position: Place
    end_screen_pos: Pixel
    button: Literal["left", "middle", "right"]
    modifier: Word | None
    owner: Word = ""


class Updates(msgspec.Struct, forbid_unknown_fields=True):
    """Update of a control, of which only the value may change."""

    value: bool | Real | Word | Few


class GuiUpdateMessage(Said):
    """A control of the panel is moved, or a button pressed."""

    uuid: Word
    updates: Updates


class GuiButtonHoldMessage(Said):
    """A button of the panel is held."""

    uuid: Word
    frequency: Real


class CommandTriggerMessage(Said):
    """A key is pressed."""

    uuid: Word


_decoder = msgspec.msgpack.Decoder(
    ViewerCameraMessage
    | ScenePointerMessage
    | SceneNodeDragMessage
    | GuiUpdateMessage
    | GuiButtonHoldMessage
    | CommandTriggerMessage
)


def understood(raw: bytes, control: Callable[[str], Any]) -> bytes | None:
    """Return a message as it was understood, encoded anew so that nothing else is in it; nothing, if it makes no sense.

    Args:
        raw: as it came, in MessagePack.
        control: the control of the panel that has an id, or None.
    """
    try:
        message = _decoder.decode(raw)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None
    if isinstance(message, GuiUpdateMessage) and not _takes(control(message.uuid), message.updates.value):
        return None
    return msgspec.msgpack.encode(message)


def _takes(control: Any, value: object) -> bool:
    """Return whether a control can have a value: one of its options, or one of its value's type."""
    if control is None:
        return False
    if hasattr(control, "options"):
        return value in control.options
    if isinstance(control.value, tuple):
        return isinstance(value, list) and len(value) == len(control.value)
    if isinstance(control.value, bool):
        return isinstance(value, bool)
    return isinstance(value, float)


CHARSET = b'<meta charset="utf-8" />'
"""Declaration of the page's encoding, which must be among its first bytes: additions come behind it"""
FILES = ("page.css", "ground.js", "look.js", "panel.js", "wait.js", "origin.js")


def add_theme(response: Response) -> None:
    """Add the theme, our additions before viser's own, to the page; other files are unchanged."""
    if "html" in response.headers.get("Content-Type", "") and response.body:
        response.body = _themed(bytes(response.body), response.headers.get("Content-Encoding") == "gzip")
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))


@functools.lru_cache(maxsize=4)
def _themed(page: bytes, zipped: bool) -> bytes:
    folder = files("balloon_warp.studio.page") / "page_files"
    read = {name: (folder / name).read_text(encoding="utf-8") for name in FILES}
    ours = f"<style>{read['page.css']}</style>"
    ours += "".join(f"<script>{read[name]}</script>" for name in read if name.endswith(".js")) + key_sheet()
    page = gzip.decompress(page) if zipped else page
    page = page.replace(CHARSET, CHARSET + ours.encode(), 1)
    return gzip.compress(page) if zipped else page


MOST_CONNECTIONS = 128
"""Largest number of simultaneous connections: a browser takes six to load the page, and one to stay"""
FRAMED = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:* vscode-webview:"
"""Pages that may embed the page: those of this machine, such as notebooks"""
MOST_NONSENSE = 100
"""Number of invalid messages after which a connection is closed"""
_log = logging.getLogger("balloon_warp.studio.page.connections")
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
        add_theme(response)
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


DEFAULT_PORT = 8080


def guarded_server(
    host: str, port: int | None, origins: Sequence[str], on_refused: Callable[[str], None]
) -> viser.ViserServer:
    """Serve an empty page; see `Page`.

    Raises:
        InputError: it cannot be served there, or an origin is none.
    """
    made: list[viser.ViserServer] = []

    def control(uuid: str) -> Any:
        return control_of(made[0], uuid) if made else None

    trusted = Origins(origins, on_refused)
    port = free_port(host, port)
    with guarded(host, control, trusted), contextlib.redirect_stdout(io.StringIO()):  # viser says where it is, too
        made.append(viser.ViserServer(host=host, port=port, label="Balloon Warp", verbose=False))
    server = made[0]
    server.request_share_url = _refuse_to_share  # a page's message would open this machine to the internet
    server.gui.configure_theme(brand_color=drawings.BRAND, show_logo=False, show_share_button=False)
    server.gui.set_panel_label("Balloon Warp")
    server.gui.main_panel.dock_right()
    return server


def control_of(server: viser.ViserServer, uuid: str) -> Any:
    """Return the control of the panel that has an id, or None."""
    return server.gui._gui_input_handle_from_uuid.get(uuid)


def address_of(server: viser.ViserServer) -> str:
    """Return the address of the page."""
    host = server.get_host()
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def close(server: viser.ViserServer) -> None:
    """Stop to serve, without a word."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def free_port(host: str, port: int | None) -> int:
    """Return a port that can be listened on: the given one, or the first free one from `DEFAULT_PORT` on.

    Raises:
        InputError: there is no such address, or the port is taken.
    """
    reason = ""
    for candidate in [port] if port is not None else range(DEFAULT_PORT, DEFAULT_PORT + 100):
        try:
            family = socket.getaddrinfo(host, candidate)[0][0]
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, candidate))
                return probe.getsockname()[1]
        except OSError as error:
            reason = error.strerror or str(error)
    named = f"--port {port}" if port is not None else f"--host {host}"
    raise InputError(f"{named}: cannot listen on {host}: {reason}")


def _refuse_to_share(*_: object, **__: object) -> None:
    return None
