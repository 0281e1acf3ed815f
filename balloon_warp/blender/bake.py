"""Process of a bake: `python -m balloon_warp.blender.bake FOLDER` simulates a request and writes its caches.

Each line of its output is JSON: a `warning`, a `frame` of how many, with the seconds `left`; and at last `done`,
`stopped` or an `error`, a sentence.

With `--preview` it plays the request in real time until its input ends, and caches have one frame, the latest. Lines of
its input are JSON, new values by their paths in the scene: {"balloon.0.inflation.pressure": 30.0}.
"""

import _thread
import argparse
import json
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import BlowUpError, InputError

if TYPE_CHECKING:
    from balloon_warp.blender.request import Request
    from balloon_warp.frame import Frame
    from balloon_warp.simulator import Simulator

PARTIAL = "partial"
"""Folder of checkpoints, beside the caches"""
CHECKPOINT_SECONDS = 2.0
"""Interval between checkpoints [s]: the most that a kill costs"""


def tell(**what: Any) -> None:
    """Print a line for the add-on."""
    print(json.dumps(what), flush=True)


class Progress:
    """Tells frames, and the seconds left at the mean rate so far."""

    def __init__(self, frames: int):
        self._frames = frames
        self._begin: tuple[int, float] | None = None

    def tell(self, number: int) -> None:
        """Tell that a frame was simulated."""
        now = time.monotonic()
        self._begin = self._begin or (number, now)
        done = number - self._begin[0]
        left = (now - self._begin[1]) / done * (self._frames - number) if done else None
        tell(frame=number, of=self._frames, left=left)


def bake(folder: Path, device: str | None, resume: bool) -> None:
    """Simulate the request of a folder, and write its caches there.

    Raises:
        InputError: the request cannot be simulated, or a cache not be written.
        BlowUpError: it blew up; the frames until then stay.
        KeyboardInterrupt: it was stopped, after a checkpoint.
    """
    from balloon_warp.blender.request import PointCaches, read_request  # these load Warp, which takes a second
    from balloon_warp.run.checkpoints import CheckpointOptions, Checkpoints, describe_run, record_frames
    from balloon_warp.simulator import Simulator
    from balloon_warp.system.process import Interrupts

    request = read_request(folder)
    try:
        simulator = Simulator(request.scene, device)
        for warning in simulator.model.warnings:
            tell(warning=request.named(warning))
        output, progress = PointCaches(request, folder), Progress(request.scene.frames)
        job = describe_run(simulator)
        options = CheckpointOptions(CHECKPOINT_SECONDS, resume)
        checkpoints = Checkpoints(folder / PARTIAL, "bake", job, request.scene, options)
        with Interrupts() as interrupts:
            missing = max((part.frames.stop for part in checkpoints.take_up(output)), default=0)
            checkpoints.restore(missing, [simulator.restore])
            frames = ((frame.number, frame) for frame in led_frames(simulator, request))
            states = [lambda: simulator.save().items()]
            record_frames(frames, output, checkpoints, states, interrupts, progress.tell)
        output.close()
        checkpoints.remove()
    except (InputError, BlowUpError) as failure:
        raise type(failure)(request.named(str(failure))) from None


def led_frames(simulator: "Simulator", request: "Request") -> Iterator["Frame"]:
    """Yield the frames that are missing, in which some points go where the request leads them."""
    from balloon_warp.blender.request import Leading

    leading = Leading(simulator, request.led)
    for frame in simulator.run():
        leading.lead(frame)
        yield frame


def preview(folder: Path, device: str, told: queue.Queue[dict[str, Any] | None]) -> None:
    """Simulate the request of a folder in real time, with the values that are sent, until these are None.

    Raises:
        InputError: the request cannot be simulated, a value cannot be, or a cache not be written.
        BlowUpError: it blew up.
    """
    from balloon_warp.blender.request import LatestFrame, Leading, read_request
    from balloon_warp.simulator import Simulator

    request = read_request(folder)
    try:
        simulator = Simulator(request.scene, device)
        leading = Leading(simulator, request.led)
        output, due = LatestFrame(request, folder), time.monotonic()
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


def listen() -> queue.Queue[dict[str, Any] | None]:
    """Return the lines of the standard input as they come, and None at its end, as when Blender is gone."""
    told: queue.Queue[dict[str, Any] | None] = queue.Queue()

    def read() -> None:
        with open(0, "rb", buffering=0, closefd=False) as lines:  # sys.stdin would be locked when the process ends
            for line in lines:
                told.put(json.loads(line))
        told.put(None)

    threading.Thread(target=read, daemon=True).start()
    return told


def stop_with_input() -> None:
    """Interrupt the bake once the standard input ends, as when Blender cancels it or is gone."""

    def wait() -> None:
        while os.read(0, 1024):  # sys.stdin would be locked when the process ends
            pass
        _thread.interrupt_main()

    threading.Thread(target=wait, daemon=True).start()


def main(arguments: Sequence[str] | None = None) -> int:
    """Bake or play, and return the exit status: 0; 1 after a blow-up, 2 after a mistake, 130 when stopped."""
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.blender.bake", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", help="Warp device; if not given, the GPU, or else the CPU; a preview's the CPU")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")
    parser.add_argument("--attached", action="store_true", help="stop once the standard input ends")
    parser.add_argument("--preview", action="store_true", help="play in real time, and keep no frames")
    asked = parser.parse_args(arguments)
    if asked.preview and (asked.resume or asked.attached):
        parser.error("--preview: expected neither --resume nor --attached with it")
    for number in (signal.SIGINT, signal.SIGTERM):  # who starts Blender may ignore them
        signal.signal(number, signal.default_int_handler)
    if asked.attached:
        stop_with_input()
    try:
        if asked.preview:
            preview(asked.folder, asked.device or "cpu", listen())
            return 0
        bake(asked.folder, asked.device, asked.resume)
    except (InputError, BlowUpError) as failure:
        tell(error=str(failure))
        return 2 if isinstance(failure, InputError) else 1
    except KeyboardInterrupt:
        tell(stopped=True)
        return 130
    tell(done=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
