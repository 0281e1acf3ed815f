"""Page among strangers, and behind a proxy: access control, its answers, and refusals that name the remedy."""

import contextlib
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from meshes import quad_sphere
from strangers import PROTOCOL, joined, served
from websockets.exceptions import InvalidStatus

from balloon_warp import Balloon, InputError, Scene, Simulator, show
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio.page.page import Page
from balloon_warp.studio.page.server import MOST_TOLD, Origins, free_port, guarded, is_ours, names_of
from balloon_warp.studio.page.session import Session


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Iterator[Page]:
    with served(tmp_path_factory.mktemp("recordings")) as page:
        yield page


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1.evil.example", "null", "http://127.0.0.1:1", "//", "http://["]
)
def test_another_site_may_not_talk_to_the_page(page: Page, origin: str):
    with pytest.raises(InvalidStatus) as refused, joined(page, Origin=origin):
        pass
    assert refused.value.response.status_code in (403, 500)


def test_the_page_may_talk_to_itself(page: Page):
    for name in ("127.0.0.1", "localhost"):
        authority = f"{name}:{page.server.get_port()}"
        assert talks(page, authority, f"http://{authority}").startswith("HTTP/1.1 101")


@pytest.mark.parametrize("path", ["/", "/socket"])
def test_a_name_that_points_here_is_not_this_machine(page: Page, path: str):
    """DNS rebinding is refused: evil.example lets its own name point to 127.0.0.1, so that Origin and Host agree."""
    authority = f"evil.example:{page.server.get_port()}"
    assert talks(page, authority, f"http://{authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/", f"Host: {authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/", "Host: localhost", f"Host: {authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/").startswith("HTTP/1.1 403")


def test_addresses_and_own_names_are_this_machine():
    names = names_of("balloons.example")
    for ours in ("127.0.0.1:8080", "[::1]:8080", "192.0.2.7", "localhost:1", "balloons.example", socket.gethostname()):
        assert is_ours(ours, names), ours
    for other in ("evil.example", "", ":8080", "127.0.0.1.evil.example", "[::1", "127.0.0.1@evil.example", "a b"):
        assert not is_ours(other, names), other


def ask(page: Page, path: str, *headers: str) -> str:
    """Return the answer to a raw socket."""
    with socket.create_connection(("127.0.0.1", page.server.get_port()), timeout=60) as raw:
        raw.sendall("\r\n".join([f"GET {path} HTTP/1.1", *headers, "", ""]).encode("latin-1"))
        parts = []
        with contextlib.suppress(TimeoutError, ConnectionResetError):
            while part := raw.recv(1 << 16):
                parts.append(part)
                if b" 101 " in part:
                    break
        return b"".join(parts).decode("latin-1")


def talks(page: Page, host: str, origin: str) -> str:
    """Return the answer where a web socket is to open."""
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==")
    version = ("Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {PROTOCOL}")
    return ask(page, "/", f"Host: {host}", f"Origin: {origin}", *upgrade, *version)


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/..\\..\\..\\..\\..\\..\\..\\etc\\passwd",
        "/%5c..%5c..%5c..%5cetc%5cpasswd",
        "/%252e%252e/%252e%252e/etc/passwd",
        "//etc/passwd",
        "/file:///etc/passwd",
        "/assets/../../../_viser.py",
        "/proc/self/environ",
        "/index.html%00.txt",
        "/assets",
        "/" + "a" * 5000,
        "/\xff",
    ],
)
def test_the_page_serves_no_file_but_its_own(page: Page, path: str):
    answer = ask(page, path, "Host: localhost")
    assert not answer.startswith("HTTP/1.1 200")
    assert "root:" not in answer
    assert "import" not in answer
    assert ask(page, "/index.html", "Host: localhost").startswith("HTTP/1.1 200")  # by the same way


def test_what_is_served_has_no_link_out_and_a_page_is_guarded_or_not_there(page: Page):
    root = page.server._websock_server._http_server_root
    assert root is not None
    assert not [path for path in Path(root).rglob("*") if path.is_symlink()]
    with pytest.raises(RuntimeError, match="not guarded"), guarded("127.0.0.1", lambda _: None, Origins([], print)):
        pass


@pytest.mark.parametrize(
    ("host", "heard_at"), [(None, "127.0.0.1"), ("localhost", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")]
)
def test_a_page_for_others_warns_and_no_stranger_fills_the_terminal(host: str | None, heard_at: str, tmp_path):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    port = free_port("127.0.0.1", 0)
    command = [sys.executable, "-m", "balloon_warp", "view", "ball.obj", "--device", "cpu", "--port", str(port)]
    command, pipe = [*command, *(["--host", host] if host else [])], subprocess.PIPE
    process = subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout
    try:
        printed = [process.stdout.readline()]
        assert printed[0].startswith("ball is at http://")
        printed += [process.stdout.readline()] if host == "0.0.0.0" else []
        listening = [each.laddr for each in psutil.Process(process.pid).net_connections() if each.status == "LISTEN"]
        assert [address.port for address in listening] == [port] * len(listening)
        assert {address.ip for address in listening} - {"::1"} == {heard_at}
        for opening in (b"\x16\x03\x01 garbage\r\n\r\n", b"GET /\xff HTTP/1.1\r\nHost: evil.example\r\n\r\n", b""):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as stranger:
                stranger.sendall(opening)
                stranger.shutdown(socket.SHUT_WR)
                with contextlib.suppress(ConnectionResetError):
                    while stranger.recv(1 << 16):
                        pass
    finally:
        process.send_signal(signal.SIGINT)
        rest, complaints = process.communicate(timeout=300)
    assert process.returncode == 0
    assert complaints.startswith("note: ball.obj inflates above a floor. ")
    told = complaints.splitlines()[1:]  # of the browser that may be behind a proxy, once, and of nothing else
    assert len(told) <= 1
    assert all("a page at https://evil.example is refused" in line for line in told)
    warning = (
        f"warning: anyone who reaches port {port} of this machine can watch and control the page, and save recordings "
        f"into {tmp_path.resolve()}; it has no encryption and no login\n"
    )
    assert printed[1:] == ([warning] if host == "0.0.0.0" else [])
    assert rest == "the page is closed\n"


PROXY, OTHER = "https://me-8471.app.example", "https://other.example"


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def proxied(told: list[str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2))])
    session = Session("ball", scene, "cpu", tmp_path_factory.mktemp("recordings"))
    page = Page(session, port=None, origins=[f"{PROXY}/"], on_refused=told.append)
    page.start()
    yield page
    page.stop()


def test_a_proxy_that_is_named_may_hand_the_page_on(proxied: Page):
    """A named proxy may forward the page, whether it replaces the host by this machine's or passes the original on."""
    here = f"localhost:{proxied.server.get_port()}"
    assert talks(proxied, here, PROXY).startswith("HTTP/1.1 101")
    assert talks(proxied, "me-8471.app.example", PROXY).startswith("HTTP/1.1 101")
    shown = ask(proxied, "/", f"Host: {here}", "Connection: close")
    assert f"vscode-webview: {PROXY}" in shown  # a notebook at the proxy may have it in a cell


def test_another_is_refused_and_the_terminal_and_the_page_say_how_it_would_not_be(proxied: Page, told: list[str]):
    here = f"localhost:{proxied.server.get_port()}"
    told.clear()
    for _ in range(2):
        assert talks(proxied, here, OTHER).startswith("HTTP/1.1 403")
    assert len(told) == 1
    assert f"--origin {OTHER}" in told[0]
    answer = ask(proxied, f"/may-i?from={OTHER.replace(':', '%3A').replace('/', '%2F')}", f"Host: {here}")
    assert answer.startswith("HTTP/1.1 403")
    assert answer.endswith(told[0])
    for origin in (PROXY, f"http://{here}"):
        assert ask(proxied, f"/may-i?from={origin}", f"Host: {here}").startswith("HTTP/1.1 200")
    assert talks(proxied, "other.example", OTHER).startswith("HTTP/1.1 403")
    assert talks(proxied, here, f"{PROXY}.evil.example").startswith("HTTP/1.1 403")


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
    with pytest.raises(InputError, match=r"^origin .*: expected http:// or https://, a host"):
        show(Simulator(Scene(balloon=[Balloon(mesh=quad_sphere(2))]), "cpu"), folder=tmp_path, origins=[origin])
