"""What gradients cost: a frame backwards, with its recomputation, over a frame forward.

python -m balloon_warp.benchmarks.gradients [DEVICE]
"""

import sys
from collections.abc import Callable, Sequence
from statistics import median
from time import perf_counter
from typing import Any

import warp as wp

from balloon_warp.benchmarks.quad_sphere import quad_sphere
from balloon_warp.device import pick_device
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.simulator import Simulator
from balloon_warp.warp_logging import quiet_warp

CELLS = 9
"""of a cube's edge, blown up to a ball of 488 particles"""
TURNS = 7
CASES = {
    "springs and pressure": {"pressure": 40.0},
    "springs and gas": {"kind": "gas", "start_pressure": 500.0},
}


def main(arguments: Sequence[str]) -> int:
    """Print a line a case."""
    quiet_warp()
    device = pick_device(arguments[0] if arguments else None)
    for name, inflation in CASES.items():
        for worlds in (1, 64) if device.is_cpu else (64, 4096):
            print(_line(name, inflation, worlds, device), flush=True)
    return 0


def _line(name: str, inflation: dict[str, Any], worlds: int, device: wp.Device) -> str:
    balloon = Balloon(
        mesh=quad_sphere(CELLS, 1.0), mass=1.0, stiffness=Stiffness(structural=50.0, shear=20.0, flexion=5.0),
        inflation=Inflation(**inflation),
    )  # fmt: skip
    model = build_model(Scene(balloon=[balloon], gravity=0.0, substeps=32), str(device), worlds)
    rates = {}
    for schedule in ("gather", "auto"):
        simulator = Simulator.of_model(model, schedule)
        rates[simulator.schedule.name] = _seconds(simulator.advance, device)
    simulator = Simulator.of_model(model, "gather")
    backward = BackwardFrames(model, simulator.state, ())
    checkpoint = backward.checkpoint(simulator.state)
    back = _seconds(lambda: backward.turn_back(checkpoint), device)
    work = worlds * model.particle_count * model.substeps
    gradient = rates["gather"] + back
    over = ", ".join(f"{gradient / seconds:.1f} of {each}" for each, seconds in rates.items())
    return f"{name}, {worlds} x {model.particle_count}: {work / gradient:.3g} particle-substeps/s; over forward {over}"


def _seconds(turn: Callable[[], Any], device: wp.Device) -> float:
    times = []
    for _ in range(TURNS + 1):
        begin = perf_counter()
        turn()
        wp.synchronize_device(device)
        times.append(perf_counter() - begin)
    return median(times[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
