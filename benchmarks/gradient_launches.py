"""Time of each kernel in a frame that is computed again and run backwards by launches, on a GPU.

python -m balloon_warp.benchmarks.gradient_launches [DEVICE] [CELLS] [CASE]
"""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import warp as wp

from balloon_warp.benchmarks.gradients import CELLS, model_of, telling
from balloon_warp.schedules.backward_launched import LaunchedBackward
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

CASE, WORLDS = "two that touch", 4096


def main(arguments: Sequence[str]) -> int:
    """Print a line a kernel, the longest first."""
    quiet_warp()
    device = pick_device(arguments[0] if arguments else "cuda:0")
    cells = int(arguments[1]) if len(arguments) > 1 else CELLS
    name = arguments[2] if len(arguments) > 2 else CASE
    model = model_of(name, cells, WORLDS, device)
    simulator = Simulator.of_model(model, "gather")
    backward = LaunchedBackward(model, simulator.state, ())
    checkpoint, tell = backward.checkpoint(simulator.state), telling(backward)
    backward.turn_back(checkpoint)  # compiles
    for array_name, array in checkpoint.items():
        getattr(backward.state, array_name).assign(array)
    tell()
    wp.timing_begin(cuda_filter=wp.TIMING_ALL, synchronize=True)
    backward.frame()
    found = wp.timing_end()
    for line in _table(found):
        print(line)
    return 0


def _table(found: Sequence[wp.TimingResult]) -> Iterator[str]:
    milliseconds, counts = defaultdict[str, float](float), Counter[str]()
    for each in found:
        milliseconds[each.name] += each.elapsed
        counts[each.name] += 1
    yield f"{sum(milliseconds.values()):8.2f} ms"
    for name, total in sorted(milliseconds.items(), key=lambda each: -each[1]):
        yield f"{total:8.2f} ms  {counts[name]:4} x {1e3 * total / counts[name]:6.1f} us  {name}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
