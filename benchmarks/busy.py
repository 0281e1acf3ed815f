"""Seconds of frames in which balloons touch, replayed: `crowd`, eight balloons, or bundled scenes.

    python -m balloon_warp.benchmarks.busy crowd knot press
    python -m balloon_warp.benchmarks.busy airbag knot --device cuda:0 --worlds 1024 --before 60

CPU seconds on a CPU, since other processes make a clock's longer; to compare two versions, let them take turns.
"""

import argparse
from time import perf_counter, process_time

import warp as wp

from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene.load import load_scene
from balloon_warp.schedules.choose import make_schedule
from balloon_warp.schedules.frames import RecordedFrame
from balloon_warp.system.warp_setup import quiet_warp

BEFORE, FRAMES, TURNS = 6, 12, 3
"""frames that are left out, that are timed together, and how often: recordings on the way are in the first two"""


def seconds_of(name: str, device: wp.Device, worlds: int, before: int) -> tuple[list[float], float]:
    """Return the seconds of each so many frames, and the rate of the fastest [particle-substeps/s]."""
    scene = CrowdCase("", "newton").scene() if name == "crowd" else load_scene(name)
    model = build_model(scene, device, worlds)
    schedule, state, frame, seconds = make_schedule(model), initial_state(model), RecordedFrame(model), []
    clock = process_time if device.is_cpu else perf_counter
    for _ in range(before):
        frame.advance(schedule, state)
    for _ in range(TURNS):
        wp.synchronize_device(device)
        began = clock()
        for _ in range(FRAMES):
            frame.advance(schedule, state)
        wp.synchronize_device(device)
        seconds.append(clock() - began)
    return seconds, FRAMES * worlds * model.particle_count * model.substeps / min(seconds)


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["crowd"])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--worlds", type=int, default=1)
    parser.add_argument("--before", type=int, default=BEFORE, help="frames that are left out")
    options = parser.parse_args()
    quiet_warp()
    for name in options.scenes:
        seconds, rate = seconds_of(name, wp.get_device(options.device), options.worlds, options.before)
        print(f"| {name} | {' | '.join(f'{each:.3f}' for each in seconds)} | {rate:.2e} |", flush=True)


if __name__ == "__main__":
    main()
