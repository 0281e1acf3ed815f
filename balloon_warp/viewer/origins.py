"""Origins that may show the page besides its own address, such as a reverse proxy."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from urllib.parse import parse_qs, unquote, urlsplit

from balloon_warp.errors import InputError

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
