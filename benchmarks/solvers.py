"""Cost and error of small explicit and large implicit steps, for soft and stiff springs.

Run it by python -m balloon_warp.benchmarks.solvers [DEVICE].
"""

import sys
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, String
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

RADIUS = 0.5
FRAMES = 20
"""after which the error is taken"""
REFINED = 4
"""how many substeps the reference takes for each that stability asks"""
STIFFNESS = (1.0, 100.0, 10_000.0)
"""factors on the spring constants"""
STEPS = ((1, 10), (1, 40), (1, 160), (2, 20), (4, 10), (4, 40), (16, 10), (64, 10))
"""substeps and iterations of the implicit solver"""
WORLDS = {"cpu": (1, 64), "cuda": (1, 4096)}


class Row(NamedTuple):
    """Line of the table."""

    stiffness: float
    worlds: int
    method: str
    """schedule or solver"""
    substeps: int
    iterations: int | str | None
    error: float
    """root mean square over the particles, over the balloon's radius"""
    seconds: float
    """of a frame"""


def hanging_balloon(stiffness: float, **fields: Any) -> Scene:
    """Return the scene of a balloon on a string that is inflated: 488 particles, 2,904 springs."""
    balloon = Balloon(
        mesh=quad_sphere(9, radius=RADIUS),
        mass=0.3,
        damping=0.3,
        stiffness=Stiffness(structural=10.0 * stiffness, shear=5.0 * stiffness, flexion=1.0 * stiffness),
        inflation=Inflation(k_normal=0.5),
    )
    string = String(anchor=(1.0, 1.0, 0.0), particle="highest", length=1.0)
    return Scene(balloon=[balloon], string=[string], normals="fresh", **fields)


def measure_solvers(device: wp.Device) -> Iterator[Row]:
    """Yield the rows, as soon as each is measured."""
    for stiffness in STIFFNESS:
        stable = build_model(hanging_balloon(stiffness), device).substeps
        _, expected, _ = _simulate(hanging_balloon(stiffness, substeps=REFINED * stable), device, 1)
        for worlds in WORLDS["cuda" if device.is_cuda else "cpu"]:
            scenes = [hanging_balloon(stiffness)]
            for substeps, iterations in STEPS:
                large = {"substeps": substeps, "solver_iterations": iterations}
                scenes.append(hanging_balloon(stiffness, solver="projective", **large))
            for scene in scenes:
                simulator, points, seconds = _simulate(scene, device, worlds)
                error = float(np.sqrt(((points - expected) ** 2).sum(axis=1).mean())) / RADIUS
                implicit = scene.solver == "projective"
                name, steps = simulator.schedule.name, simulator.model.substeps
                iterations = scene.solver_iterations if implicit else None
                yield Row(stiffness, worlds, name, steps, iterations, error, seconds)


def _simulate(scene: Scene, device: wp.Device, worlds: int) -> tuple[Simulator, NDArray[np.float64], float]:
    """Return the simulator, its first world's points after the frames, and the seconds that a frame took."""
    simulator = Simulator(scene, str(device), worlds)
    simulator.advance()
    wp.synchronize_device(device)
    began = time.perf_counter()
    for _ in range(FRAMES - 1):
        simulator.advance()
    wp.synchronize_device(device)
    seconds = (time.perf_counter() - began) / (FRAMES - 1)
    return simulator, simulator.state.points.numpy()[0].astype(np.float64), seconds


def main() -> None:
    """Print the table as Markdown."""
    quiet_warp()
    print("| stiffness | worlds | method | substeps | iterations | error | ms a frame |")
    print("|---|---|---|---|---|---|---|")
    for row in measure_solvers(pick_device(sys.argv[1] if len(sys.argv) > 1 else None)):
        print(
            f"| x {row.stiffness:,.0f} | {row.worlds:,} | `{row.method}` | {row.substeps:,} "
            f"| {row.iterations or '-'} | {row.error:.2%} | {1000.0 * row.seconds:.3g} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
