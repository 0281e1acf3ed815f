"""Additions to viser's page: a style sheet, scripts and a list of keys."""

import functools
import gzip
from importlib.resources import files

from websockets.http11 import Response

from balloon_warp.viewer.status import key_sheet

CHARSET = b'<meta charset="utf-8" />'
"""Declaration of the page's encoding, which must be among its first bytes: additions come behind it"""

FILES = ("page.css", "ground.js", "look.js", "panel.js", "wait.js", "origin.js")


def dress(response: Response) -> None:
    """Insert our additions before viser's own in the page; other files are unchanged."""
    if "html" in response.headers.get("Content-Type", "") and response.body:
        response.body = _dressed(bytes(response.body), response.headers.get("Content-Encoding") == "gzip")
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))


@functools.lru_cache(maxsize=4)
def _dressed(page: bytes, zipped: bool) -> bytes:
    folder = files("balloon_warp.viewer") / "page_files"
    read = {name: (folder / name).read_text(encoding="utf-8") for name in FILES}
    ours = f"<style>{read['page.css']}</style>"
    ours += "".join(f"<script>{read[name]}</script>" for name in read if name.endswith(".js")) + key_sheet()
    page = gzip.decompress(page) if zipped else page
    page = page.replace(CHARSET, CHARSET + ours.encode(), 1)
    return gzip.compress(page) if zipped else page
