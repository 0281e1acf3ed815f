"""Where the page may be shown from, such as a proxy's address: beside its own address, what is named."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from urllib.parse import parse_qs, unquote, urlsplit

from balloon_warp.errors import InputError

MOST_TOLD = 20
"""origins of which the terminal is told that they are refused"""
QUESTION = "/may-i"
"""what the page asks for, to learn whether its own address is one that may talk to the server"""


class Origins:
    """Tells origins that may talk to the page from others: scheme, host and port, as a browser says where it is.

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
        """Host names of the trusted origins: a proxy may hand on what it was asked for as."""
        return {str(urlsplit(origin).hostname) for origin in self.trusted}

    def admit(self, origin: str, host: str) -> bool:
        """Whether an `Origin` header may come with a `Host` header. If not, the terminal is told."""
        if origin.lower() in self.trusted or origin.partition("://")[2] == host:
            return True
        self.refuse(origin)
        return False

    def refuse(self, origin: str) -> None:
        """Tell the terminal, once."""
        if origin not in self._told and len(self._told) < MOST_TOLD and origin.isprintable():
            self._told.add(origin)
            self._on_refused(refusal(origin))

    def answer(self, path: str, host: str) -> str | None:
        """What is said to a page that asks whether its own address may talk to the server: nothing if it may, and None
        if it is not asked."""
        parts = urlsplit(path)
        if parts.path != QUESTION:
            return None
        origin = unquote(parse_qs(parts.query).get("from", [""])[0])
        return "" if self.admit(origin, host) else refusal(origin)


def refusal(origin: str) -> str:
    """Say what is refused, and how it would not be."""
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
    raise InputError(f"--origin {origin}: expected http:// or https://, a host and maybe a port, and no path")
