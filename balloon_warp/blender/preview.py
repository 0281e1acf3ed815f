"""Process of a preview: `python -m balloon_warp.blender.preview FOLDER` plays a request in real time, until its end.

Lines of its input are JSON, new values by their paths in the scene: {"balloon.0.inflation.pressure": 30.0}. Its caches
have one frame, the latest. Lines of its output are a `frame`, and at last an `error`.
"""

import argparse
import json
import queue
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from balloon_warp.blender.addon.request import LIVE
from balloon_warp.blender.bake import tell
from balloon_warp.errors import BlowUpError, InputError


def preview(folder: Path, device: str | None, told: "queue.Queue[dict[str, Any] | None]") -> None:
    """Simulate the request of a folder in real time, with the values that are sent, until these are None.

    Raises:
        InputError: the request cannot be simulated, a value cannot be, or a cache not be written.
        BlowUpError: it blew up.
    """
    from balloon_warp.blender.request import (
        LatestFrame,  # these load Warp, which takes a second
        Leading,
        read_request,
    )
    from balloon_warp.simulator import Simulator

    request = read_request(folder)
    try:
        simulator = Simulator(request.scene, device)
        leading = Leading(simulator, request.led)
        output, due = LatestFrame(request, folder, LIVE), time.monotonic()
        frame = simulator.read_frame()
        while True:
            output.write(frame)
            tell(frame=frame.number)
            while not told.empty():
                if (changes := told.get()) is None:
                    return
                simulator.set(changes)
            due = max(due + 1.0 / request.scene.frames_per_second, time.monotonic())
            leading.lead(frame)
            frame = simulator.step()
            time.sleep(max(0.0, due - time.monotonic()))
    except (InputError, BlowUpError) as failure:
        raise type(failure)(request.named(str(failure))) from None


def listen(told: "queue.Queue[dict[str, Any] | None]") -> None:
    """Take the lines of the input, and None at its end, as when Blender is gone."""
    with open(0, "rb", buffering=0, closefd=False) as lines:  # sys.stdin would be locked when the process ends
        for line in lines:
            told.put(json.loads(line))
    told.put(None)


def main(arguments: Sequence[str] | None = None) -> int:
    """Play, and return the exit status: 0; 1 after a blow-up, 2 after a mistake."""
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.blender.preview", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cpu", help="Warp device; the CPU if not given")
    asked = parser.parse_args(arguments)
    told: queue.Queue[dict[str, Any] | None] = queue.Queue()
    threading.Thread(target=listen, args=[told], daemon=True).start()
    try:
        preview(asked.folder, asked.device, told)
    except (InputError, BlowUpError) as failure:
        tell(error=str(failure))
        return 2 if isinstance(failure, InputError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
