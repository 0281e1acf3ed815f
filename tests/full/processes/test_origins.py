"""Page behind a proxy: its allowed origins, and refusals that name the remedy."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from meshes import quad_sphere

viser = pytest.importorskip("viser")

from test_guard import ask, talks  # noqa: E402

from balloon_warp import Balloon, InputError, Scene, Simulator, show  # noqa: E402
from balloon_warp.viewer.origins import MOST_TOLD, Origins  # noqa: E402
from balloon_warp.viewer.page import Page  # noqa: E402
from balloon_warp.viewer.session import Session  # noqa: E402

PROXY, OTHER = "https://me-8471.app.example", "https://other.example"


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def page(told: list[str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2))])
    session = Session("ball", scene, "cpu", tmp_path_factory.mktemp("recordings"))
    page = Page(session, port=None, origins=[f"{PROXY}/"], on_refused=told.append)
    page.start()
    yield page
    page.stop()


def test_a_proxy_that_is_named_may_hand_the_page_on(page: Page):
    """A named proxy may forward the page, whether it replaces the host by this machine's or passes the original on."""
    here = f"localhost:{page.server.get_port()}"
    assert talks(page, here, PROXY).startswith("HTTP/1.1 101")
    assert talks(page, "me-8471.app.example", PROXY).startswith("HTTP/1.1 101")
    shown = ask(page, "/", f"Host: {here}", "Connection: close")
    assert f"vscode-webview: {PROXY}" in shown  # a notebook at the proxy may have it in a cell


def test_another_is_refused_and_the_terminal_and_the_page_say_how_it_would_not_be(page: Page, told: list[str]):
    here = f"localhost:{page.server.get_port()}"
    told.clear()
    for _ in range(2):
        assert talks(page, here, OTHER).startswith("HTTP/1.1 403")
    assert len(told) == 1
    assert f"--origin {OTHER}" in told[0]
    answer = ask(page, f"/may-i?from={OTHER.replace(':', '%3A').replace('/', '%2F')}", f"Host: {here}")
    assert answer.startswith("HTTP/1.1 403")
    assert answer.endswith(told[0])
    for origin in (PROXY, f"http://{here}"):
        assert ask(page, f"/may-i?from={origin}", f"Host: {here}").startswith("HTTP/1.1 200")
    assert talks(page, "other.example", OTHER).startswith("HTTP/1.1 403")
    assert talks(page, here, f"{PROXY}.evil.example").startswith("HTTP/1.1 403")


def test_strangers_do_not_fill_the_terminal():
    told: list[str] = []
    origins = Origins([], told.append)
    for number in range(3 * MOST_TOLD):
        assert not origins.admit(f"https://{number}.example", "localhost:8080")
    assert not origins.admit("https://\x1b[2J.example", "localhost:8080")
    assert len(told) == MOST_TOLD


@pytest.mark.parametrize(
    "origin",
    ["hub.example", "https://", "ftp://hub.example", "https://hub.example/user/me", "https://a@b", "*", "null"],
)
def test_what_is_no_origin_is_refused(origin: str, tmp_path: Path):
    with pytest.raises(InputError, match=r"^--origin .*: expected http:// or https://, a host"):
        show(Simulator(Scene(balloon=[Balloon(mesh=quad_sphere(2))]), "cpu"), folder=tmp_path, origins=[origin])
