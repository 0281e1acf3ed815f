"""Cost and accuracy of the bound on film's strain: the letter I of real foil, beside film of its own modulus.

    python -m balloon_warp.benchmarks.foil [--letter I] [--pressure 50] [--frames 40]

prints the table of docs/FOIL.md. Each row has a process of its own, since it measures memory; times are CPU seconds, as
other processes make a clock's longer.
"""

import argparse
import resource
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import median
from time import process_time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.foil.make import foil_mesh
from balloon_warp.model.strain_bound import mean_strain
from balloon_warp.scene import Balloon, Inflation, Material, Scene, Touch
from balloon_warp.simulator import Simulator
from balloon_warp.warp_logging import quiet_warp

HEIGHT, RAMP = 0.35, 0.4
"""Height of the letter [m], and time in which its pressure rises [s]"""
BOUNDS = (None, 0.001, 0.003, 0.01)
"""Bounds on the strain; None for the modulus of the material"""
PER_MIB = 2**20 if sys.platform == "darwin" else 2**10
"""Units in which a system tells the memory of a process, in a MiB"""


class Filled(NamedTuple):
    """A letter at the end of its frames."""

    substeps: int
    seconds: list[float]
    """CPU seconds of each frame"""
    memory: float
    """Most memory of the process [MiB]"""
    points: NDArray[np.float64]
    volume: float
    """Volume [m^3]"""
    strain: float
    """Mean strain [1]"""


def filled(letter: str, pressure: float, frames: int, bound: float | None, itself: bool) -> Filled:
    """Return a letter that fills without weight."""
    quiet_warp()
    told = {"exact": True} if bound is None else {"strain_bound": bound}
    balloon = Balloon(
        mesh=foil_mesh(letter, height=HEIGHT),
        damping=0.1,
        material=Material(preset="foil", **told),
        inflation=Inflation(pressure=[(0.0, 0.0), (RAMP, pressure)]),
    )
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, touch=Touch(itself=itself), frames=frames), "cpu")
    seconds, began = [], process_time()
    for _ in range(frames):
        simulator.step()
        seconds.append(process_time() - began)
        began = process_time()
    last = simulator.read_frame()
    points = last.points[0].astype(np.float64)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PER_MIB
    strain = mean_strain(simulator.model.shapes[0], points)
    return Filled(simulator.model.substeps, seconds, memory, points, float(last.volumes[0]), strain)


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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--letter", default="I")
    parser.add_argument("--pressure", type=float, default=50.0)
    parser.add_argument("--frames", type=int, default=40)
    given = parser.parse_args()
    print("| letter | bound | substeps | first frame [CPU s] | median | worst after | MiB | strain | volume | shape |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for itself in (False, True):
        exact = None
        for bound in BOUNDS:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
                asked = given.letter, given.pressure, given.frames, bound, itself
                done = process.submit(filled, *asked).result()
            exact = exact or done
            print(row(f"{given.letter}, {'touches itself' if itself else 'alone'}", bound, done, exact), flush=True)


if __name__ == "__main__":
    main()
