"""The page among strangers: who may talk to it, and what becomes of nonsense."""

import contextlib
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, String

viser = pytest.importorskip("viser")

import msgspec  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402
from websockets.sync.connection import Connection  # noqa: E402

from balloon_warp.viewer import guard  # noqa: E402
from balloon_warp.viewer.guard import MOST_NONSENSE, guarded, is_ours, names_of  # noqa: E402
from balloon_warp.viewer.page import Page, _free_port  # noqa: E402
from balloon_warp.viewer.session import Session  # noqa: E402

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [0.0, 0.0, 1.0, 0.0],
    "position": [0.0, 0.0, 3.0],
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 900,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}
CLICK = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": [0.0, 0.0, 3.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [[0.5, 0.5]],
    "modifier": None,
}
DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "start",
    "name": "/balloons/0",
    "instance_index": None,
    "start_position": [0.0, 0.0, 0.5],
    "start_screen_pos": [0.5, 0.5],
    "end_position": [0.2, 0.0, 0.5],
    "end_screen_pos": [0.6, 0.5],
    "button": "left",
    "modifier": None,
    "owner": "",
}
NAN, INF = float("nan"), float("inf")
REFUSED = (InvalidHandshake, ConnectionClosed, OSError, EOFError)
"""what a client may see of a connection that is not let in"""


def ball() -> Scene:
    balloon = Balloon(mesh=quad_sphere(3, 0.5), helium=9.81, inflation=Inflation(k_normal=0.3))
    return Scene(balloon=[balloon], string=[String(anchor=(0, -1, 0))], ground=Ground(height=-1.0))


def wait_until(happened: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + 120.0
    while not happened():
        assert time.monotonic() < deadline, f"{what}: not within two minutes"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    session = Session("ball", ball(), "cpu", tmp_path_factory.mktemp("recordings"))
    page = Page(session, port=_free_port("127.0.0.1", 0))
    page.start()
    yield page
    page.stop()


@contextlib.contextmanager
def joined(page: Page, **headers: str) -> Iterator[Connection]:
    """A window, but without a browser, that reads what it is sent, as a browser does."""
    address = f"ws://127.0.0.1:{page.server.get_port()}"
    with connect(
        address, subprotocols=[PROTOCOL], max_size=None, additional_headers=headers, proxy=None, compression=None
    ) as window:

        def read() -> None:
            with contextlib.suppress(ConnectionClosed):
                for _ in window:
                    pass

        reader = threading.Thread(target=read)
        reader.start()
        yield window
    reader.join()


@pytest.fixture
def watcher(page: Page) -> Iterator[Connection]:
    """A window that looks on, with the scene at its start."""
    with joined(page) as window:
        say(window, CAMERA)
        wait_until(lambda: page.session.watched, "it looks on")
        revision = page.session.picture.revision
        page.session.reset()
        wait_until(lambda: page.session.picture.revision > revision, "reset")
        wait_until(lambda: page.controls._bound[1] > revision, "the panel follows")
        yield window


def say(window: Connection, message: object) -> None:
    window.send(msgspec.msgpack.encode(message))


def update(control: Any, **updates: object) -> dict[str, object]:
    return {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": updates}


def goes_on(page: Page) -> None:
    number = page.session.picture.frame.number
    wait_until(lambda: page.session.picture.frame.number > number + 2, "time goes on")
    assert np.isfinite(page.session.picture.frame.points[0]).all()
    assert not page.session.picture.trouble


def heard(page: Page, window: Connection) -> None:
    """All that was said before was handled: a connection's messages are handled in their order."""
    mass = page.controls.mass
    value = 3.0 if mass.value != 3.0 else 4.0
    say(window, update(mass, value=value))
    wait_until(lambda: mass.value == value or window.close_code, "what is said last")
    assert window.close_code is None, (window.close_code, window.close_reason)


def test_what_a_window_says_is_heard(page: Page, watcher: Connection):
    """The very messages that the tests below spoil."""
    say(watcher, update(page.controls.inflation, value=0.5))
    wait_until(lambda: page.session.picture.inflation == 0.5, "the slider")
    say(watcher, update(page.controls.wind, value=[1.0, 0, 0.0]))
    wait_until(lambda: page.session.picture.scene.atmosphere.wind == (1.0, 0.0, 0.0), "the wind")
    say(watcher, update(page.controls._ways["normals"], value="fresh"))
    wait_until(lambda: page.session.picture.scene.normals == "fresh", "the choice")
    say(watcher, update(page.controls.stable, value=False))
    wait_until(lambda: not page.session.playground.keep_stable, "the box")
    page.session.ask(lambda playground: setattr(playground, "keep_stable", True))
    page.controls.stable.value = True
    say(watcher, update(page.controls.run, value=True))
    wait_until(lambda: not page.session.picture.running, "the button")
    [pause] = [
        uuid for uuid, key in page.server.gui._command_handle_from_uuid.items() if key._impl.props.hotkey == "space"
    ]
    say(watcher, {"type": "CommandTriggerMessage", "uuid": pause})
    wait_until(lambda: page.session.picture.running, "the key")
    say(watcher, CLICK)
    wait_until(lambda: len(page.session.picture.scene.sphere) == 1, "the click")
    say(watcher, DRAG)
    wait_until(lambda: page.session.picture.hands, "the hand")
    say(watcher, DRAG | {"phase": "end"})
    wait_until(lambda: not page.session.picture.hands, "the hand lets go")


def test_an_older_picture_does_not_pull_a_slider_back(page: Page, watcher: Connection):
    """Where the machine is busy, what is shown lags behind the hand."""
    older = page.session.picture
    say(watcher, update(page.controls.inflation, value=0.5))
    wait_until(lambda: page.session.picture.inflation == 0.5, "the slider")
    page.controls.follow(older)
    assert page.controls.inflation.value == 0.5


def test_a_slider_is_heard_at_once(page: Page, watcher: Connection):
    """Not when one of viser's threads finds time: until then the panel might have another value."""
    free = threading.Event()
    for _ in range(page.server._thread_executor._max_workers):
        page.server._thread_executor.submit(free.wait)
    say(watcher, update(page.controls.inflation, value=0.5))
    try:
        wait_until(lambda: page.session.picture.inflation == 0.5, "the slider")
    finally:
        free.set()


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
    """DNS rebinding: the site evil.example lets its own name point to 127.0.0.1, so that Origin and Host agree."""
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
    """What a raw socket is answered."""
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
    """What is answered where a web socket is to open."""
    return ask(
        page,
        "/",
        f"Host: {host}",
        f"Origin: {origin}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Protocol: {PROTOCOL}",
    )


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2f..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "/..\\..\\..\\..\\..\\..\\..\\etc\\passwd",
        "/%5c..%5c..%5c..%5cetc%5cpasswd",
        "/%252e%252e/%252e%252e/etc/passwd",
        "//etc/passwd",
        "/%2fetc%2fpasswd",
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


def test_no_link_leads_out_of_what_is_served(page: Page):
    root = page.server._websock_server._http_server_root
    assert root is not None
    assert not [path for path in Path(root).rglob("*") if path.is_symlink()]


def nonsense(page: Page) -> dict[str, bytes]:
    """What no window says, and must not be heard."""
    controls = page.controls
    upload = {"transfer_uuid": "x", "filename": "x", "mime_type": "x", "part_count": 0, "size_bytes": 0}
    inflation = controls.inflation
    messages: dict[str, object] = {
        "no message": 7,
        "no type": {"uuid": "x"},
        "unknown type": {"type": "NoSuchMessage"},
        "a type that is a list": {"type": [1]},
        "a message to windows": {"type": "RunJavascriptMessage", "source": "alert(1)"},
        "unknown control": {"type": "GuiUpdateMessage", "uuid": "no such control", "updates": {"value": 1.0}},
        "words to a slider": update(inflation, value="as wide as can be"),
        "NaN": update(inflation, value=NAN),
        "infinity": update(inflation, value=INF),
        "NaN in words": update(inflation, value="nan"),
        "too large": update(inflation, value=1e300),
        "too large a whole number": update(inflation, value=2**63),
        "true to a slider": update(inflation, value=True),
        "a list to a slider": update(inflation, value=[1.0]),
        "nothing": update(inflation, value=None),
        "no value": update(inflation),
        "a NaN radius": update(controls.radius, value=NAN),
        "a NaN speed": update(controls.throw_speed, value=-INF),
        "a NaN wind": update(controls.wind, value=[0.0, NAN, 0.0]),
        "a wind of two": update(controls.wind, value=[0.0, 1.0]),
        "a wind of words": update(controls.wind, value=["1", "2", "3"]),
        "a choice that is none": update(controls._ways["solver"], value="no such solver"),
        "a speed that is none": update(controls.speed, value="nan"),
        "a scene that is none": update(controls.scenes, value="../../etc/passwd"),
        "a number to a box": update(controls.stable, value=0.0),
        "a callback": update(inflation, update_cb=["x"]),
        "a control that is gone": update(inflation, removed=True),
        "a value and more": update(inflation, value=1.0, is_button=True),
        "another field": update(inflation, value=1.0) | {"excluded_self_client": 0},
        "a form": {"type": "GuiFormDirtyMessage", "uuid": "x" * 1000},
        "an upload": {"type": "FileTransferStartUpload", "source_component_uuid": inflation._impl.uuid, **upload},
        "a camera of words": CAMERA | {"position": ["a", "b", "c"]},
        "a camera nowhere": CAMERA | {"look_at": [NAN, NAN, NAN]},
        "a click from nowhere": CLICK | {"ray_origin": [NAN, 0.0, 0.0]},
        "a click without a ray": CLICK | {"ray_origin": None, "ray_direction": None},
        "a click with a ray to infinity": CLICK | {"ray_direction": [0.0, 0.0, -INF]},
        "a click nowhere": CLICK | {"screen_pos": []},
        "a drag from nowhere": DRAG | {"start_position": [NAN, NAN, NAN]},
        "a drag to infinity": DRAG | {"end_position": [INF, 0.0, 0.0]},
        "a drag in words": DRAG | {"end_position": "here"},
        "a drag of all": DRAG | {"phase": "all"},
    }
    twice = {"type": "GuiUpdateMessage", "uuid": inflation._impl.uuid, "updates": {"value": 1.0}}
    head, *rest = (msgspec.msgpack.encode(text) for text in ("type", "FileTransferStartUpload"))
    return {name: msgspec.msgpack.encode(message) for name, message in messages.items()} | {
        "no bytes": b"",
        "garbage": b"\xc1\xff\x00garbage",
        "half a message": msgspec.msgpack.encode(CAMERA)[:-9],
        "a deep one": b"\x91" * 30_000,
        "a long list that is not there": b"\xdd\xff\xff\xff\xff",
        "two types": bytes([0x84]) + msgspec.msgpack.encode(twice)[1:] + head + rest[0],
    }


def test_nonsense_is_not_heard(page: Page, watcher: Connection, capfd: pytest.CaptureFixture[str]):
    """Nothing changes, time goes on, the terminal stays empty, and who says it is still heard when it makes sense."""
    controls = page.server.gui._gui_input_handle_from_uuid.values()
    for name, content in nonsense(page).items():
        values, live = [control.value for control in controls], page.session.playground.live
        mass = page.controls.mass.value
        with joined(page) as window:
            say(window, CAMERA)
            window.send(content)
            window.send(content.decode("latin-1"))  # as words, too
            heard(page, window)
            page.controls.mass.value = mass
            assert [control.value for control in controls] == values, name
            assert page.session.playground.live == live, name
    goes_on(page)
    said = capfd.readouterr()
    assert said.out + said.err == ""
    say(watcher, update(page.controls.inflation, value=0.5))
    wait_until(lambda: page.session.picture.inflation == 0.5, "another window is heard")


def test_who_goes_on_with_nonsense_is_shown_the_door(page: Page, watcher: Connection):
    with joined(page) as window:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(20 * MOST_NONSENSE):
                window.send(b"nonsense")
        wait_until(lambda: window.close_code is not None, "it is closed")
    goes_on(page)


def test_a_huge_message_ends_its_own_connection(page: Page, watcher: Connection):
    with joined(page) as window:
        with contextlib.suppress(ConnectionClosed):
            window.send(b"\0" * (1 << 22))
        wait_until(lambda: window.close_code == 1009, "it is closed")
    goes_on(page)


def test_thousands_of_messages_do_not_stop_the_simulation(page: Page, watcher: Connection):
    """That make sense, each of them: the last slider counts, and of spheres there are as many as there may be."""
    with joined(page) as window:
        say(window, CAMERA)
        for value in np.linspace(0.3, 0.6, 3000):
            say(window, update(page.controls.inflation, value=float(value)))
        for _ in range(300):
            say(window, CLICK)
        goes_on(page)
        wait_until(lambda: page.session.picture.inflation == 0.6, "the last")
        goes_on(page)
    wait_until(lambda: len(page.session.picture.scene.sphere) == 8, "spheres")


def test_half_open_connections_do_not_stop_the_page(page: Page, watcher: Connection):
    """Handshakes that never end, and what is no handshake: a window joins beside them."""
    with contextlib.ExitStack() as stack:
        for opening in (b"", b"GET / HTTP/1.1\r\nHost: local", b"\x16\x03\x01\x02\x00garbage\r\n\r\n") * 10:
            slow = stack.enter_context(socket.create_connection(("127.0.0.1", page.server.get_port())))
            slow.sendall(opening)
        goes_on(page)
        with joined(page) as window:
            say(window, CAMERA)
            heard(page, window)


def test_there_are_no_more_connections_than_may_be(page: Page, watcher: Connection, monkeypatch):
    monkeypatch.setattr(guard, "MOST_CONNECTIONS", 5)
    with contextlib.ExitStack() as stack:
        for _ in range(4):  # beside the one that looks on
            stack.enter_context(joined(page))
        with pytest.raises(REFUSED), joined(page):
            pass
        goes_on(page)

    def room() -> bool:
        with contextlib.suppress(*REFUSED), joined(page):
            return True
        return False

    wait_until(room, "once they are gone there is room")


def test_a_window_of_another_version_is_told_so(page: Page, capfd: pytest.CaptureFixture[str]):
    address = f"ws://127.0.0.1:{page.server.get_port()}"
    with connect(address, subprotocols=["viser-v0.0.1"], proxy=None) as window:
        with pytest.raises(ConnectionClosed):
            window.recv(timeout=60)
        assert window.close_code == 1002
    assert capfd.readouterr().out == ""


def test_a_page_is_guarded_or_not_there():
    with pytest.raises(RuntimeError, match="not guarded"), guarded("127.0.0.1", lambda _: None):
        pass


@pytest.mark.parametrize(
    ("host", "heard_at"), [(None, "127.0.0.1"), ("localhost", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")]
)
def test_a_page_for_others_warns_and_no_stranger_fills_the_terminal(host: str | None, heard_at: str, tmp_path: Path):
    """It listens on this machine alone unless asked, and says in one sentence what it means that it does not."""
    psutil = pytest.importorskip("psutil")
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    port = _free_port("127.0.0.1", 0)
    command = [sys.executable, "-m", "balloon_warp", "view", "ball.obj", "--device", "cpu", "--port", str(port)]
    process = subprocess.Popen(
        [*command, *(["--host", host] if host else [])],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
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
    assert complaints == ""
    warning = (
        f"warning: whoever reaches port {port} of this machine can see it, play with it and save recordings into "
        f"{tmp_path.resolve()}; nothing is encrypted, nobody is asked a name\n"
    )
    assert printed[1:] == ([warning] if host == "0.0.0.0" else [])
    assert rest == ""
