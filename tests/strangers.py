"""Page that compiles nothing ahead, and connections to it without a browser."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp.kernels.laws import Law
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, String

viser = pytest.importorskip("viser")

import msgspec  # noqa: E402
from websockets.exceptions import ConnectionClosed  # noqa: E402
from websockets.sync.client import connect  # noqa: E402
from websockets.sync.connection import Connection  # noqa: E402

from balloon_warp.studio.page.page import Onlooker, Page  # noqa: E402
from balloon_warp.studio.page.playground import KernelPrecompiler  # noqa: E402
from balloon_warp.studio.page.server import free_port  # noqa: E402
from balloon_warp.studio.page.session import Session  # noqa: E402

LIMIT = 120.0
"""seconds after which an awaited event has not come: never waited for where all is well"""
PROTOCOL = f"viser-v{viser.__version__}"

CAMERA: dict[str, Any] = {"type": "ViewerCameraMessage", "wxyz": [0.0, 0.0, 1.0, 0.0], "position": [0.0, 0.0, 3.0]}
CAMERA |= {"fov": 1.3, "near": 0.01, "far": 1000.0, "image_height": 600, "image_width": 900}
CAMERA |= {"look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0]}
CLICK: dict[str, Any] = {"type": "ScenePointerMessage", "event_type": "click", "modifier": None}
CLICK |= {"ray_origin": [0.0, 0.0, 3.0], "ray_direction": [0.0, 0.0, -1.0], "screen_pos": [[0.5, 0.5]]}
DRAG: dict[str, Any] = {"type": "SceneNodeDragMessage", "phase": "start", "name": "/balloons/0", "instance_index": None}
DRAG |= {"start_position": [0.0, 0.0, 0.5], "start_screen_pos": [0.5, 0.5], "button": "left", "modifier": None}
DRAG |= {"end_position": [0.2, 0.0, 0.5], "end_screen_pos": [0.6, 0.5], "owner": ""}


def ball() -> Scene:
    balloon = Balloon(mesh=quad_sphere(3, 0.5), helium=9.81, inflation=Inflation(k_normal=0.3))
    return Scene(balloon=[balloon], string=[String(anchor=(0, -1, 0))], ground=Ground(height=-1.0))


class AskedAhead(KernelPrecompiler):
    """Stand-in that records the scenes to compile and compiles none: on a machine of two cores compilation would take
    time that the page itself lacks."""

    def __init__(self) -> None:
        super().__init__()
        self.scenes: list[Scene] = []

    def begin(
        self, scene: Scene, device: str, laws: Sequence[Law] = (), on_done: Callable[[], None] = lambda: None
    ) -> None:
        self.scenes.append(scene)


def page_of(scene: Scene, folder: Path) -> Page:
    """Return a page of a scene, which has yet to start; its recordings go into the folder."""
    page = Page(Session("ball", scene, "cpu", folder), port=free_port("127.0.0.1", 0))
    page.ahead = AskedAhead()
    return page


def wait_until(happened: Callable[[], object], what: str, seconds: float = LIMIT) -> None:
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline, f"{what}: not within {seconds:g} s"
        time.sleep(0.01)


@contextlib.contextmanager
def joined(page: Page | Onlooker, arrived: list[bytes] | None = None, **headers: str) -> Iterator[Connection]:
    """Connect without a browser and read all messages, as a browser does, into a list if there is one."""
    address, how = f"ws://127.0.0.1:{page.server.get_port()}", {"max_size": None, "proxy": None, "compression": None}
    with connect(address, subprotocols=[PROTOCOL], additional_headers=headers, **how) as window:

        def read() -> None:
            with contextlib.suppress(ConnectionClosed):
                for message in window:
                    if arrived is not None:
                        arrived.append(message)

        reader = threading.Thread(target=read)
        reader.start()
        yield window
    reader.join()


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
    """Wait until all earlier messages of a connection are handled, which is in their order."""
    mass = page.controls.mass
    value = 3.0 if mass.value != 3.0 else 4.0
    say(window, update(mass, value=value))
    wait_until(lambda: mass.value == value or window.close_code, "what is said last")
    assert window.close_code is None, (window.close_code, window.close_reason)


@contextlib.contextmanager
def served(folder: Path) -> Iterator[Page]:
    """Yield a page of a ball on a string; its recordings go into the folder."""
    page = page_of(ball(), folder)
    page.start()
    yield page
    page.stop()
