"""Gradients beside Newton's under Warp's tape: time and memory of a whole one, without gas, in turns.

    python -m balloon_warp.benchmarks.newton_gradients [DEVICE] [WORLDS] [FRAMES]

Springs are the same on both sides, and both gradients agree. Of rubber each side has its own law on the same
triangles. Ours goes frame by frame, as `Rollout` does; Newton's is recorded once, and then played. Memory is that of
each in a process of its own, of the host and of the device.
"""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from balloon_warp.benchmarks.newton_tape import NewtonTape, by_distances
from balloon_warp.lab.gradients.gradient import Moving, Steps
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.model import build_model
from balloon_warp.scene import Inflation, Material, Scene, Stiffness
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

CELLS, SUBSTEPS, TURNS = 9, 32, 3
"""A ball of 488 particles; substeps a frame; turns of each side, of which the fastest counts"""
CASES: dict[str, dict[str, Any]] = {
    "springs": {"mass": 1.0, "stiffness": Stiffness(structural=50.0, shear=20.0, flexion=5.0)},
    "rubber": {"material": Material(kind="neo_hookean", shear_modulus=3.3e5, thickness=2e-4, wrinkling=False)},
}
OF = [f"balloon.velocity.{axis}" for axis in range(3)]
SIDES = ("ours", "newton")
HEADER = """\
| case | worlds x particles x substeps | seconds, ours and its | times as fast | MiB, ours and its | times as little |
|---|---|---|---|---|---|"""


class Case(NamedTuple):
    """Hold the case that both sides derive."""

    name: str
    worlds: int
    frames: int
    device: str

    @property
    def scene(self) -> Scene:
        """Return a ball that nothing inflates or slows down."""
        balloon = {"mesh": quad_sphere(CELLS, 1.0), "inflation": Inflation(pressure=0.0), "damping": 0.0}
        of = [{**balloon, **CASES[self.name]}]
        return Scene(gravity=0.0, substeps=SUBSTEPS, frames=self.frames, frames_per_second=60.0, balloon=of)

    @property
    def targets(self) -> np.ndarray:
        """Return where each particle shall end: the ball a little larger, and unevenly so."""
        points = quad_sphere(CELLS, 1.0).points
        return points * np.random.default_rng(1).uniform(1.0, 1.2, (len(points), 1))

    def ours(self) -> "Ours":
        """Return our side, turned once."""
        ours = Ours(self)
        ours.gradient()
        return ours

    def newton(self) -> NewtonTape:
        """Return Newton's side, played once."""
        tape = NewtonTape(build_model(self.scene, self.device, self.worlds), self.targets)
        tape.gradient()
        return tape


class Ours:
    """Gradient of how far particles end from places, by their velocities at the start."""

    def __init__(self, case: Case):
        self._steps, self._frames = Steps(case.scene, OF, case.worlds, case.device, "auto", ()), case.frames
        self._values = np.zeros((case.worlds, len(OF)))
        self._targets = wp.array(case.targets, dtype=wp.vec3, device=case.device)

    def gradient(self) -> np.ndarray:
        """Return the derivatives, shape (world_count, particle_count, 3)."""
        begun = [self._steps.start(self._values)]
        for frame in range(self._frames):
            begun.append(self._steps.advance(begun[-1], frame, self._values))
        end = begun.pop()
        bars = Moving(*map(wp.zeros_like, end))
        shape, device = end.points.shape, end.points.device
        wp.launch(by_distances, shape, [end.points, self._targets], outputs=[bars.points], device=device)
        for frame in reversed(range(self._frames)):
            bars, _ = self._steps.turn_back(begun.pop(), frame, self._values, bars)
        return bars.velocities.numpy()


def main(arguments: Sequence[str]) -> int:
    """Print a row a case; or, of a side and a case, the bytes that it takes."""
    quiet_warp()
    if arguments and arguments[0] in SIDES:
        side, name, *others = arguments
        print(_bytes_of(side, _case(name, others)))
        return 0
    print(HEADER)
    for name in CASES:
        print(row(_case(name, arguments)), flush=True)
    return 0


def _case(name: str, said: Sequence[str]) -> Case:
    worlds, frames = (int(said[at]) if len(said) > at else default for at, default in ((1, 8), (2, 60)))
    return Case(name, worlds, frames, str(pick_device(said[0] if said else None)))


def row(case: Case) -> str:
    """Measure both sides, and return their row of the table."""
    for side in SIDES:
        getattr(case._replace(frames=1), side)()  # compiles
    ours, its = case.ours(), case.newton()
    if case.name == "springs":
        found = ours.gradient()
        np.testing.assert_allclose(its.gradient(), found, rtol=1e-3, atol=1e-3 * np.abs(found).max())
    times = [[_seconds(side.gradient, case.device) for side in (ours, its)] for _ in range(TURNS)]
    seconds = np.min(times, axis=0)
    sizes = [_bytes_alone(side, case) for side in SIDES]
    cells = [case.name, f"{case.worlds} x {len(case.targets)} x {case.frames * SUBSTEPS}"]
    cells += [f"{seconds[0]:.3g} / {seconds[1]:.3g}", f"{seconds[1] / seconds[0]:.1f}"]
    cells += [f"{sizes[0] / 2**20:.0f} / {sizes[1] / 2**20:.0f}", f"{sizes[1] / sizes[0]:.0f}"]
    return f"| {' | '.join(cells)} |"


def _seconds(turn: Callable[[], Any], device: str) -> float:
    begin = perf_counter()
    turn()
    wp.synchronize_device(device)
    return perf_counter() - begin


def _bytes_alone(side: str, case: Case) -> int:
    """Return the memory that a side takes in a process of its own, where none is at hand from before [bytes]."""
    words = [sys.executable, "-m", "balloon_warp.benchmarks.newton_gradients", side]
    words += [case.name, case.device, str(case.worlds), str(case.frames)]
    return int(subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()[-1])


def _bytes_of(side: str, case: Case) -> int:
    getattr(case._replace(frames=1), side)()  # compiles
    return memory_of(getattr(case, side), pick_device(case.device))


def memory_of(call: Callable[[], Any], device: wp.Device) -> int:
    """Return by how much memory of the host and of the device rose in a call at most [bytes]."""
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")  # the most so far is forgotten
    before, on_device = _host_bytes("VmRSS"), 0 if device.is_cpu else wp.get_mempool_used_mem_current(device)
    kept = call()
    wp.synchronize_device(device)
    most = 0 if device.is_cpu else wp.get_mempool_used_mem_high(device)
    rose = _host_bytes("VmHWM") - before + most - on_device
    del kept
    return rose


def _host_bytes(field: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f"{field}:"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
