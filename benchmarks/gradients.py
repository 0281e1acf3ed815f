"""Cost of gradients: a frame forward, and backwards with its recomputation, over the same frame forward.

python -m balloon_warp.benchmarks.gradients [DEVICE] [CELLS[xWORLDS]] [CASE ...]
python -m balloon_warp.benchmarks.gradients flight      beside differences in double precision
python -m balloon_warp.benchmarks.gradients horizon     how far they tell anything
python -m balloon_warp.benchmarks.gradients bounce      beside the slope of many worlds
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from time import perf_counter, process_time
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.benchmarks import gradient_bounce, gradient_flight, gradient_horizon
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.model import Model, build_model, copy_of, overwrite
from balloon_warp.scene import Inflation, Scene, Stiffness
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.schedules.backward_launched import BACKWARDS, backwards_of, forward_of
from balloon_warp.schedules.backward_one_launch import fits_in_block_backwards, fits_in_lanes_backwards
from balloon_warp.schedules.choose import fastest_schedule
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

Turn = tuple[Callable[[], Any], Callable[[], Any]]
"""Preparation, and the timed function"""
BACK = "back"
CELLS = 9
"""of a cube's edge, blown up to a ball of 488 particles"""
TURNS = 15
SPRINGS: dict[str, Any] = {"mass": 1.0, "stiffness": Stiffness(structural=50.0, shear=20.0, flexion=5.0)}
GAS = Inflation(kind="gas", start_pressure=500.0)
ON_GROUND = {"ground": {"height": -0.999, "friction": 0.3}, "gravity": 9.81}
HELD: list[dict[str, Any]] = [{"radius": 0.8, "mass": 0.5, "position": (0.0, 1.79, 0.0), "velocity": (0.0, -1.0, 0.0)}]
CASES: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "springs and pressure": ([{**SPRINGS, "inflation": Inflation(pressure=40.0)}], {}),
    "springs and gas": ([{**SPRINGS, "inflation": GAS}], {}),
    "rubber and gas": ([{"material": {"kind": "mooney_rivlin"}, "inflation": GAS}], {}),
    "gas on the ground": ([{**SPRINGS, "inflation": GAS}], ON_GROUND),
    "two that touch": (
        [{**SPRINGS, "inflation": GAS, "position": (side, 0.0, 0.0)} for side in (-0.99, 0.99)],
        {"touch": {"edges": False}},
    ),
    "two apart": (
        [{**SPRINGS, "inflation": GAS, "position": (side, 0.0, 0.0)} for side in (-1.5, 1.5)],
        {"touch": {"edges": False}},
    ),
    "beside a sphere": ([{**SPRINGS, "inflation": GAS}], {"sphere": HELD, "contact": "impulse"}),
}
"""Balloons of each case, and tables of its scene; contact acts in the first frame, the only one that is timed, but of
the two apart, which may touch"""

FITS: dict[str, Callable[[Model], bool]] = {
    "launched": lambda model: True,
    "block": fits_in_block_backwards,
    "lanes": fits_in_lanes_backwards,
}
"""Ways back, and whether a model can go them"""
TABLES = {"flight": gradient_flight.tables, "horizon": gradient_horizon.tables, "bounce": gradient_bounce.tables}


def main(arguments: Sequence[str]) -> int:
    """Print a line a case."""
    quiet_warp()
    if len(arguments) == 1 and arguments[0] in TABLES:
        for line in TABLES[arguments[0]]():
            print(line, flush=True)
        return 0
    device = pick_device(arguments[0] if arguments else None)
    cells, _, worlds = (arguments[1] if len(arguments) > 1 else str(CELLS)).partition("x")
    counts = (int(worlds),) if worlds else (1, 64) if device.is_cpu else (64, 4096)
    for name in arguments[2:] or CASES:
        for count in counts:
            for line in _lines(name, model_of(name, int(cells), count, device)):
                print(line, flush=True)
    return 0


def model_of(name: str, cells: int, worlds: int, device: wp.Device) -> Model:
    balloons, tables = CASES[name]
    mesh = quad_sphere(cells, 1.0)
    of = Scene(**{"gravity": 0.0, "substeps": 32, "balloon": [{"mesh": mesh, **each} for each in balloons], **tables})
    return build_model(of, str(device), worlds)


def _lines(name: str, model: Model) -> Iterator[str]:
    """Yield a line for each way backwards, in turns with the runs forward: that which `gradient` makes, and others."""
    ways = [how for how, fits in FITS.items() if fits(model)]
    forwards = {how: forward_of(model, BACKWARDS[how]) for how in ways}
    turns: dict[str, Turn] = {}
    for schedule in dict.fromkeys(["gather", *forwards.values(), fastest_schedule(model, model.world_count)]):
        simulator = Simulator.of_model(model, schedule)
        turns[schedule] = partial(overwrite, simulator.state, copy_of(simulator.state)), simulator.advance
    work = model.world_count * model.particle_count * model.substeps
    yield f"{name}, {model.world_count} x {model.particle_count}: " + ", ".join(
        f"{schedule} {work / seconds:.3g}" for schedule, seconds in _seconds(turns, model.device).items()
    )
    simulator = Simulator.of_model(model, "gather")
    for how, schedule in forwards.items():
        backward = backwards_of(model, how)(model, simulator.state, ())
        turn_back = telling(backward), partial(backward.turn_back, backward.checkpoint(simulator.state))
        taken = _seconds({**turns, BACK: turn_back}, model.device)
        whole = taken[schedule] + taken.pop(BACK)
        over = ", ".join(f"{whole / seconds:.2f} of {each}" for each, seconds in taken.items())
        yield f"    {how}: whole gradient {work / whole:.3g} particle-substeps/s, {over}"


def telling(backward: BackwardFrames) -> Callable[[], None]:
    """Return a function that sets the derivatives at a frame's end: not 0, of which nothing would be added up."""
    draw, device = np.random.default_rng(1), backward.model.device
    bars = [backward.arrays[name] for name in ("all_point_bar", "all_velocity_bar")]
    told = [wp.array(draw.normal(size=(*bar.shape, 3)), dtype=wp.vec3, device=device) for bar in bars]

    def tell() -> None:
        for bar, said in zip(bars, told, strict=True):
            wp.copy(bar, said)

    return tell


def _seconds(turns: Mapping[str, Turn], device: wp.Device) -> dict[str, float]:
    """Return the least time of each, of the processors on a CPU; in turns, since all else slows them alike."""
    clock = process_time if device.is_cpu else perf_counter
    times: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(TURNS + 1):
        for name, (prepare, turn) in turns.items():
            prepare()
            wp.synchronize_device(device)
            begin = clock()
            turn()
            wp.synchronize_device(device)
            times[name].append(clock() - begin)
    return {name: min(each[1:]) for name, each in times.items()}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
