"""Test of the viewer with messages that make no sense: time must go on.

    python -m balloon_warp.benchmarks.viewer_nonsense --count 10000

needs the extra `view`. The messages are those of a window with values, fields or bytes of them changed; messages
that make sense after all are not sent.
"""

import argparse
import contextlib
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Scene, String
from balloon_warp.studio.page.page import Page
from balloon_warp.studio.page.server import MOST_NONSENSE, control_of, understood
from balloon_warp.studio.page.session import Session
from balloon_warp.system.warp_setup import quiet_warp

LOOK = 200
"""messages between two looks at whether time goes on"""
PATIENCE = 60.0
"""seconds in which a frame is simulated, however busy the machine is"""
ODD: list[Any] = [
    *(float("nan"), float("inf"), -1e300, 2**63, -1, 0, True, None, "", "nan", "../../etc/passwd", "x" * 5000),
    *([], {}, [[]], {"type": "ViewerCameraMessage"}, b"\xff", [float("nan")] * 3, ["0", "0", "0"], [0.0] * 5000),
]
"""values that take a value's place"""
WENT_ON, STOOD_STILL = "looks found time going on", "looks found time standing still"


def send_nonsense(count: int, seed: int = 0) -> Counter[str]:
    """Send messages that make no sense to a page that shows a balloon.

    Args:
        count: how many.
        seed: of the messages.

    Returns:
        how many looks found which, `WENT_ON` or `STOOD_STILL`.
    """
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(4, 0.5))], string=[String(anchor=(0.0, -1.0, 0.0))])
    outcomes, choices = Counter[str](), random.Random(seed)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        page = Page(Session("ball", scene, "cpu", Path(folder)), port=0)
        page.start()
        stack.callback(page.stop)
        good = _messages(page)
        for begin in range(0, count, LOOK):
            _send(page, [_nonsense(good, page, choices) for _ in range(begin, min(begin + LOOK, count))])
            outcomes[WENT_ON if _goes_on(page) else STOOD_STILL] += 1
    return outcomes


def _messages(page: Page) -> list[dict[str, Any]]:
    """Return a message of each kind that a window sends."""
    camera = {
        **{"type": "ViewerCameraMessage", "wxyz": [0.0, 0.0, 1.0, 0.0], "position": [0.0, 0.0, 3.0], "fov": 1.3},
        **{"near": 0.01, "far": 1000.0, "image_height": 600, "image_width": 900},
        **{"look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0]},
    }
    click = {
        **{"type": "ScenePointerMessage", "event_type": "click", "screen_pos": [[0.5, 0.5]], "modifier": None},
        **{"ray_origin": [0.0, 0.0, 3.0], "ray_direction": [0.0, 0.0, -1.0]},
    }
    drag = {
        **{"type": "SceneNodeDragMessage", "phase": "start", "name": "/balloons/0", "instance_index": None},
        **{"start_position": [0.0, 0.0, 0.5], "start_screen_pos": [0.5, 0.5], "button": "left", "modifier": None},
        **{"end_position": [0.2, 0.0, 0.5], "end_screen_pos": [0.6, 0.5], "owner": ""},
    }
    controls = page.controls
    moved = [
        {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": {"value": value}}
        for control, value in (
            (controls.main_controls.inflation, 0.5),
            (controls.wind, [1.0, 0.0, 0.0]),
            (controls.main_controls.run, True),
        )
    ]
    key = {"type": "CommandTriggerMessage", "uuid": next(iter(page.server.gui._command_handle_from_uuid))}
    return [camera, click, drag, *moved, key]


def _nonsense(good: list[dict[str, Any]], page: Page, choices: random.Random) -> bytes:
    """Return a message that makes no sense, derived from one that does."""
    while True:
        message = dict(choices.choice(good))
        for _ in range(choices.choice((1, 1, 2, 3))):
            CHANGES[choices.choice(list(CHANGES))](message, choices)
        raw = bytearray(msgspec.msgpack.encode(message))
        if choices.random() < 0.3:
            place = choices.randrange(len(raw))
            raw[place : place + choices.choice((0, 1, 2, 1000))] = choices.randbytes(choices.choice((0, 1, 1, 40)))
        if understood(bytes(raw), partial(control_of, page.server)) is None:
            return bytes(raw)


def _change(message: dict[str, Any], choices: random.Random) -> None:
    message[choices.choice(list(message))] = choices.choice(ODD)


def _change_deep(message: dict[str, Any], choices: random.Random) -> None:
    """Change a value of a list, or a field of a table."""
    deep = [name for name, value in message.items() if isinstance(value, list | dict) and value]
    if deep:
        name = choices.choice(deep)
        part = message[name] = type(message[name])(message[name])
        part[choices.choice(list(part) if isinstance(part, dict) else range(len(part)))] = choices.choice(ODD)


def _drop(message: dict[str, Any], choices: random.Random) -> None:
    message.pop(choices.choice(list(message)))
    message.setdefault("more", choices.choice(ODD))


CHANGES: dict[str, Callable[[dict[str, Any], random.Random], None]] = {
    "a value": _change,
    "a value of several": _change_deep,
    "a field": _drop,
}


def _send(page: Page, messages: list[bytes]) -> None:
    """Send messages from windows that are heard to the end: a connection is closed after so many."""
    for begin in range(0, len(messages), MOST_NONSENSE):
        with _joined(page) as window, contextlib.suppress(ConnectionClosed):
            for message in messages[begin : begin + MOST_NONSENSE]:
                window.send(message)


def _goes_on(page: Page) -> bool:
    """Return whether another window sees time go on, with all at finite places."""
    with _joined(page) as window:
        camera = _messages(page)[0]
        window.send(msgspec.msgpack.encode(camera))
        number = page.session.picture.frame.number
        end = time.monotonic() + PATIENCE
        while page.session.picture.frame.number < number + 3:
            if time.monotonic() > end:
                return False
            time.sleep(0.01)
    picture = page.session.picture
    return not picture.trouble and bool(np.isfinite(picture.frame.points[0]).all())


@contextlib.contextmanager
def _joined(page: Page):
    """Open a window without a browser, that reads its messages as a browser does."""
    address = f"ws://127.0.0.1:{page.server.get_port()}"
    protocol: Any = f"viser-v{viser.__version__}"
    with connect(address, subprotocols=[protocol], max_size=None, proxy=None, compression=None) as window:

        def read() -> None:
            with contextlib.suppress(ConnectionClosed):
                for _ in window:
                    pass

        reader = threading.Thread(target=read)
        reader.start()
        yield window
    reader.join()


def main() -> None:
    """Print how many messages were sent, and whether time went on; status 1 where it did not."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=10_000, help="messages")
    parser.add_argument("--seed", type=int, default=0, help="of the messages")
    arguments = parser.parse_args()
    quiet_warp()
    outcomes = send_nonsense(arguments.count, arguments.seed)
    print(f"{arguments.count:,} messages that make no sense; {dict(outcomes)}")
    sys.exit(1 if outcomes[STOOD_STILL] else 0)


if __name__ == "__main__":
    main()
