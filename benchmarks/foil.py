"""Cost and accuracy of the bound on film's strain: a letter of real foil, beside film of its own modulus.

    python -m balloon_warp.benchmarks.foil [--letter I] [--pressure 50] [--frames 40] [--device cuda:0]

prints the table of docs/FOIL.md. Each row has a process of its own, since it measures memory. Times of a CPU are CPU
seconds, as other processes make a clock's longer; a GPU's are of a clock, and its memory is the device's.

    python -m balloon_warp.benchmarks.foil --many --device cuda:0

prints the rates of many worlds at a time, 60 frames after the start: a thousand letters that touch themselves, and
1,024 of the bundled airbag.
"""

import argparse
import resource
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import median
from time import perf_counter, process_time
from typing import Any, NamedTuple, TypeVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.model.stability import mean_strain
from balloon_warp.scene import Balloon, Inflation, Material, Scene, Touch, load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.foil import foil_mesh

HEIGHT, RAMP = 0.35, 0.4
"""Height of the letter [m], and time in which its pressure rises [s]"""
BOUND = 0.003
BOUNDS = (None, 0.001, BOUND, 0.01)
"""Bounds on the strain; None for the modulus of the material"""
BEFORE, TIMED = 60, 12
"""Frames of many worlds that are left out, and that are timed"""
PER_MIB = 2**20 if sys.platform == "darwin" else 2**10
"""Units in which a system tells the memory of a process, in a MiB"""


Result = TypeVar("Result")


class Filled(NamedTuple):
    """A letter at the end of its frames."""

    substeps: int
    seconds: list[float]
    """Seconds of each frame, of a CPU or a GPU"""
    memory: float
    """Most memory of the process, or of a GPU [MiB]"""
    points: NDArray[np.float64]
    volume: float
    """Volume [m^3]"""
    strain: float
    """Mean strain [1]"""


def letter_scene(letter: str, pressure: float, frames: int, bound: float | None, itself: bool) -> Scene:
    """Return a letter that fills without weight."""
    told = {"exact": True} if bound is None else {"strain_bound": bound}
    balloon = Balloon(
        mesh=foil_mesh(letter, height=HEIGHT),
        damping=0.1,
        material=Material(preset="foil", **told),
        inflation=Inflation(pressure=[(0.0, 0.0), (RAMP, pressure)]),
    )
    return Scene(balloon=[balloon], gravity=0.0, touch=Touch(itself=itself), frames=frames)


def now(device: str) -> float:
    """Return the time once a device has done all launches [s]."""
    wp.synchronize_device(device)
    return process_time() if wp.get_device(device).is_cpu else perf_counter()


def memory_of(device: str) -> float:
    """Return the most memory of a GPU, or of this process [MiB]."""
    if wp.get_device(device).is_cpu:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MIB
    return wp.get_mempool_used_mem_high(device) / 2**20


def filled(scene: Scene, device: str) -> Filled:
    """Return the letter of a scene at its end."""
    quiet_warp()
    simulator = Simulator(scene, device)
    seconds, began = [], now(device)
    for _ in range(scene.frames):
        simulator.step()
        seconds.append(now(device) - began)
        began = now(device)
    last = simulator.read_frame()
    points = last.points[0].astype(np.float64)
    strain = mean_strain(simulator.model.shapes[0], points)
    return Filled(simulator.model.substeps, seconds, memory_of(device), points, float(last.volumes[0]), strain)


def rates(scene: Scene, device: str, worlds: int) -> str:
    """Return the cells of many worlds' rates: substeps, frames a second, and particle-substeps a second."""
    quiet_warp()
    simulator = Simulator(scene, device, worlds)
    simulator.advance(BEFORE)
    began = now(device)
    simulator.advance(TIMED)
    frames = TIMED / (now(device) - began)
    model = simulator.model
    work = worlds * model.particle_count * model.substeps
    return f"{worlds:,} | {model.substeps:,} | {frames:.3g} | {frames * work:.3g} | {memory_of(device):.0f}"


def distance(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the root mean square distance of points, turned onto each other, over their size (Kabsch)."""
    found, expected = found - found.mean(axis=0), expected - expected.mean(axis=0)
    left, _, right = np.linalg.svd(found.T @ expected)
    turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return float(np.sqrt(np.square(found @ turn - expected).sum(axis=1).mean()) / np.ptp(expected, axis=0).max())


def row(name: str, bound: float | None, done: Filled, exact: Filled) -> str:
    """Return a row of the table."""
    first, *others = done.seconds
    cells = (
        name, "exact" if bound is None else f"{100.0 * bound:g}%", f"{done.substeps:,}", f"{first:.2f}",
        f"{median(others):.3f}", f"{max(others):.3f}", f"{done.memory:.0f}", f"{100.0 * done.strain:.2g}%",
        f"{100.0 * (done.volume / exact.volume - 1.0):+.2f}%", f"{100.0 * distance(done.points, exact.points):.2f}%",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def apart(function: Callable[..., Result], *told: Any) -> Result:
    """Return a function's result from a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(function, *told).result()


def main() -> None:
    """Print the table of one letter, or of many worlds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--letter", default="I")
    parser.add_argument("--pressure", type=float, default=50.0)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--many", action="store_true", help="rates of many worlds")
    parser.add_argument("--worlds", type=int, nargs=2, default=(1000, 1024), help="numbers of letters and airbags")
    given = parser.parse_args()
    if given.many:
        print("| scene | worlds | substeps | frames/s | particle-substeps/s | MiB |\n|---|---|---|---|---|---|")
        letter = letter_scene(given.letter, given.pressure, BEFORE + TIMED, BOUND, itself=True)
        for name, scene, worlds in (
            (f"{given.letter}, touches itself", letter, given.worlds[0]),
            ("airbag", load_scene("airbag"), given.worlds[1]),
        ):
            print(f"| {name} | {apart(rates, scene, given.device, worlds)} |", flush=True)
        return
    print("| letter | bound | substeps | first frame [s] | median | worst after | MiB | strain | volume | shape |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for itself in (False, True):
        exact = None
        for bound in BOUNDS:
            scene = letter_scene(given.letter, given.pressure, given.frames, bound, itself)
            done = apart(filled, scene, given.device)
            exact = exact or done
            print(row(f"{given.letter}, {'touches itself' if itself else 'alone'}", bound, done, exact), flush=True)


if __name__ == "__main__":
    main()
