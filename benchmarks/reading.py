"""Cost of handing out every frame of one world."""

import time
from collections.abc import Callable
from itertools import islice
from statistics import median

import warp as wp

from balloon_warp.benchmarks.cases import ReadingCase
from balloon_warp.benchmarks.result import Result
from balloon_warp.simulator import Simulator

FRAMES = 60
REPEATS = 5


def measure_reading(case: ReadingCase, device: wp.Device) -> Result:
    """Frames of the first world, read while the next is simulated, in turns with frames that nobody reads."""
    simulator = Simulator(case.scene(), str(device), case.worlds)
    rates = [(_rate(simulator, _read), _rate(simulator, _advance)) for _ in range(1 + REPEATS)]
    rate, alone = (median(of_one[1:]) for of_one in zip(*rates, strict=True))
    return Result(
        case=case.name,
        device=str(device),
        schedule=simulator.schedule.name,
        worlds=case.worlds,
        particles=simulator.model.particle_count,
        rate=rate,
        peer="not read",
        peer_rate=alone,
        ratio=rate / alone,
    )


def _read(simulator: Simulator) -> None:
    for _ in islice(simulator.run(ahead=True), FRAMES):
        pass


def _advance(simulator: Simulator) -> None:
    for _ in range(FRAMES):
        simulator.advance()


def _rate(simulator: Simulator, go_on: Callable[[Simulator], None]) -> float:
    """Particle-substeps a second."""
    model, first = simulator.model, simulator.frame_number
    wp.synchronize_device(model.device)
    began = time.perf_counter()
    go_on(simulator)
    wp.synchronize_device(model.device)
    frames = simulator.frame_number - first
    return frames * model.world_count * model.particle_count * model.substeps / (time.perf_counter() - began)
