"""Rates of scenes in which balloons touch by default and are apart, over those with `touch = false`.

`python -m balloon_warp.benchmarks.touch_default` prints them, in turns on the CPU.
"""

import time

from balloon_warp import Simulator, load_scene

SCENES = ("two_balloons", "helium_rise", "latex_inflate", "two_latex_balloons")
ROUNDS = 3
"""Number of runs each; the first, in which kernels load, is not counted"""


def frames_per_second(name: str, touches: bool) -> float:
    """Return the rate at which a scene plays from its second frame on, of the processor's time."""
    simulator = Simulator(load_scene(name, {} if touches else {"touch": False}), "cpu")
    simulator.step()
    begin, frames = time.process_time(), simulator.model.scene.frames - 1
    for _ in range(frames):
        simulator.step()
    simulator.read_frame()
    return frames / (time.process_time() - begin)


def main() -> None:
    """Print a line a scene."""
    for name in SCENES:
        rates = [[frames_per_second(name, touches) for touches in (False, True)] for _ in range(ROUNDS)]
        apart, touching = (max(column) for column in zip(*rates[1:], strict=True))
        print(f"{name}: {apart:.0f} frames/s with touch = false, {touching:.0f} without, {touching / apart:.2f}")


if __name__ == "__main__":
    main()
