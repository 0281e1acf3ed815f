"""CPU seconds of frames in which balloons touch, replayed on a CPU: `crowd`, eight balloons, or bundled scenes.

    python -m balloon_warp.benchmarks.busy crowd knot press

CPU seconds, since other processes make a clock's longer; to compare two versions, let them take turns.
"""

import sys
from time import process_time

import warp as wp

from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene.load import load_scene
from balloon_warp.schedules.choose import make_schedule
from balloon_warp.schedules.recorded_frame import RecordedFrame
from balloon_warp.warp_logging import quiet_warp

BEFORE, FRAMES, TURNS = 6, 12, 3
"""frames that are left out, that are timed together, and how often: recordings on the way are in the first two"""


def seconds_of(name: str) -> list[float]:
    """Return the CPU seconds of each so many frames."""
    scene = CrowdCase("", "newton").scene() if name == "crowd" else load_scene(name)
    model = build_model(scene, wp.get_device("cpu"))
    schedule, state, frame, seconds = make_schedule(model), initial_state(model), RecordedFrame(model), []
    for _ in range(BEFORE):
        frame.advance(schedule, state)
    for _ in range(TURNS):
        began = process_time()
        for _ in range(FRAMES):
            frame.advance(schedule, state)
        seconds.append(process_time() - began)
    return seconds


def main() -> None:
    """Print a row for each scene."""
    quiet_warp()
    for name in sys.argv[1:] or ["crowd"]:
        print(f"| {name} | {' | '.join(f'{each:.3f}' for each in seconds_of(name))} |", flush=True)


if __name__ == "__main__":
    main()
