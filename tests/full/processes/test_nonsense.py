"""Invalid messages to the page, and their outcomes."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from strangers import CAMERA, CLICK, DRAG, goes_on, heard, joined, say, served, update, wait_until

viser = pytest.importorskip("viser")

import msgspec  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidHandshake  # noqa: E402
from websockets.sync.client import connect  # noqa: E402
from websockets.sync.connection import Connection  # noqa: E402

from balloon_warp.studio.page import server  # noqa: E402
from balloon_warp.studio.page.page import Page  # noqa: E402
from balloon_warp.studio.page.server import MOST_NONSENSE  # noqa: E402

NAN, INF = float("nan"), float("inf")

REFUSED = (InvalidHandshake, ConnectionClosed, OSError, EOFError)
"""exceptions that a client may see of a connection that is not let in"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with served(tmp_path_factory.mktemp("recordings")) as page:
        yield page


@pytest.fixture
def watcher(page: Page) -> Iterator[Connection]:
    """Yield a window that watches the scene, reset to its start."""
    with joined(page) as window:
        say(window, CAMERA)
        wait_until(lambda: page.session.watched, "it looks on")
        revision = page.session.picture.revision
        page.session.reset()
        wait_until(lambda: page.session.picture.revision > revision, "reset")
        wait_until(lambda: page.controls._bound[1] > revision, "the panel follows")
        yield window


def hears_the_slider(page: Page, window: Connection) -> None:
    say(window, update(page.controls.main_controls.inflation, value=0.5))
    wait_until(lambda: page.session.picture.inflation == 0.5, "the slider")


def test_what_a_window_says_is_heard(page: Page, watcher: Connection):
    """The messages that the tests below corrupt are valid and take effect."""
    controls, session = page.controls, page.session

    def hears(message: object, happened: Callable[[], object], what: str) -> None:
        say(watcher, message)
        wait_until(happened, what)

    hears_the_slider(page, watcher)
    wind = (1.0, 0.0, 0.0)
    hears(update(controls.wind, value=wind), lambda: session.picture.scene.atmosphere.wind == wind, "the wind")
    hears(
        update(controls._ways["normals"], value="fresh"), lambda: session.picture.scene.normals == "fresh", "a choice"
    )
    hears(update(controls.stable, value=False), lambda: not session.playground.keep_stable, "the box")
    session.ask(lambda playground: setattr(playground, "keep_stable", True))
    controls.stable.value = True
    hears(update(controls.main_controls.run, value=True), lambda: not session.picture.running, "the button")
    keys = page.server.gui._command_handle_from_uuid.items()
    [pause] = [uuid for uuid, key in keys if key._impl.props.hotkey == "space"]
    hears({"type": "CommandTriggerMessage", "uuid": pause}, lambda: session.picture.running, "the key")
    hears(CLICK, lambda: len(session.picture.scene.sphere) == 1, "the click")
    hears(DRAG, lambda: session.picture.hands, "the hand")
    hears(DRAG | {"phase": "end"}, lambda: not session.picture.hands, "the hand lets go")


def test_an_older_picture_does_not_pull_a_slider_back(page: Page, watcher: Connection):
    older = page.session.picture
    hears_the_slider(page, watcher)
    page.controls.follow(older)
    assert page.controls.main_controls.inflation.value == 0.5


def test_a_slider_is_heard_at_once(page: Page, watcher: Connection):
    free = threading.Event()
    for _ in range(page.server._thread_executor._max_workers):
        page.server._thread_executor.submit(free.wait)
    try:
        hears_the_slider(page, watcher)
    finally:
        free.set()


def nonsense(page: Page) -> dict[str, bytes]:
    """Return messages that no window sends, and that must be ignored."""
    controls = page.controls
    upload = {"transfer_uuid": "x", "filename": "x", "mime_type": "x", "part_count": 0, "size_bytes": 0}
    inflation = controls.main_controls.inflation
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
        "a speed that is none": update(controls.main_controls.speed, value="nan"),
        "a scene that is none": update(controls.main_controls.scenes, value="../../etc/passwd"),
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
    hears_the_slider(page, watcher)  # in another window


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
    with joined(page) as window:
        say(window, CAMERA)
        for value in np.linspace(0.3, 0.6, 3000):
            say(window, update(page.controls.main_controls.inflation, value=float(value)))
        for _ in range(300):
            say(window, CLICK)
        goes_on(page)
        wait_until(lambda: page.session.picture.inflation == 0.6, "the last")
        goes_on(page)
    wait_until(lambda: len(page.session.picture.scene.sphere) == 8, "spheres")


def test_half_open_connections_do_not_stop_the_page(page: Page, watcher: Connection):
    with contextlib.ExitStack() as stack:
        for opening in (b"", b"GET / HTTP/1.1\r\nHost: local", b"\x16\x03\x01\x02\x00garbage\r\n\r\n") * 10:
            slow = stack.enter_context(socket.create_connection(("127.0.0.1", page.server.get_port())))
            slow.sendall(opening)
        goes_on(page)
        with joined(page) as window:
            say(window, CAMERA)
            heard(page, window)


def test_there_are_no_more_connections_than_may_be(page: Page, watcher: Connection, monkeypatch):
    monkeypatch.setattr(server, "MOST_CONNECTIONS", 5)
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
