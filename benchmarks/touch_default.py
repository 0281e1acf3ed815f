"""Rates of scenes in which balloons touch by default and are apart, over those with `touch = false`.

`python -m balloon_warp.benchmarks.touch_default [DEVICE [WORLDS]]` prints them, in turns; of one world on the CPU where
nothing is said.
"""

import sys
import time

import warp as wp

from balloon_warp import Simulator, load_scene

SCENES = ("two_balloons", "helium_rise", "latex_inflate", "two_latex_balloons")
ROUNDS = 3
"""Number of runs each; the first, in which kernels load, is not counted"""


def frames_per_second(name: str, touches: bool, device: str, worlds: int) -> float:
    """Return the rate at which a scene plays from its second frame on, of a CPU by the processor's time."""
    simulator = Simulator(load_scene(name, {} if touches else {"touch": False}), device, worlds)
    clock = time.process_time if device == "cpu" else time.perf_counter
    simulator.step()
    begin, frames = clock(), simulator.model.scene.frames - 1
    for _ in range(frames):
        simulator.step_unread()
    simulator.read_frame()
    wp.synchronize_device(device)
    return frames / (clock() - begin)


def main() -> None:
    """Print a line a scene."""
    device = sys.argv[1] if len(sys.argv) > 1 else "cpu"
    worlds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for name in SCENES:
        rates = [[frames_per_second(name, touches, device, worlds) for touches in (False, True)] for _ in range(ROUNDS)]
        apart, touching = (max(column) for column in zip(*rates[1:], strict=True))
        print(f"{name}: {apart:.0f} frames/s with touch = false, {touching:.0f} without, {touching / apart:.2f}")


if __name__ == "__main__":
    main()
