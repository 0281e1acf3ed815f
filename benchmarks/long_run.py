"""Does the memory grow? A million substeps, then twenty thousand frames streamed by `run` and by `batch`.

    python -m balloon_warp.benchmarks.long_run [--quick]

prints the memory of each at marks, and its slope after the warm-up; status 1 where it grows more than it may. Needs
Linux, whose `RssAnon` it reads: pages of files, which the system takes back when it likes, do not count.

Outputs are saved each so many bytes, so that memory rises and falls: compared are the highest marks of two
stretches of the run, each longer than that takes.
"""

import argparse
import multiprocessing
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from balloon_warp.batch.batch import run_batch
from balloon_warp.batch.recorder import MEASURES
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, String
from balloon_warp.simulator import Simulator
from balloon_warp.studio.animate import animate
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.usd import stage

MEBIBYTE = 2**20
WARM_UP = 0.4
"""the part of a run that may still grow; the rest is cut into two stretches"""
MARKS = 2_000
"""looks at the memory in a run; ten of them are printed"""
WORLDS = 4


@dataclass(frozen=True)
class Case:
    """A long run."""

    name: str
    frames: int
    substeps: int
    """in a frame"""
    cells: int
    """along a side of each of the balloon's six patches"""
    unit: int
    """the slope is said for so many frames"""
    may_grow: float
    """MiB in so many frames, beside a table's rows"""
    save_bytes: int | None = None
    """of outputs that are kept in memory before they are added to the file, where not as many as always"""

    @property
    def particles(self) -> int:
        return 6 * self.cells**2 + 2

    @property
    def units(self) -> str:
        substeps = self.unit * self.substeps
        return f"{substeps:,} substeps" if self.name == "substeps" else f"{self.unit:,} frames"


CASES = (
    Case("substeps", frames=10_000, substeps=100, cells=4, unit=1_000, may_grow=0.1),
    Case("run", frames=20_000, substeps=16, cells=13, unit=1_000, may_grow=1.0),
    Case("batch", frames=20_000, substeps=16, cells=13, unit=1_000, may_grow=1.0),
)
"""A frame of `run` and `batch` is 24 kB: kept, a thousand would take 23 MiB. The growth that remains, however large the
mesh, is the time and the place in the file of each of its samples, some 24 bytes in USD's lists, which double when
full. The allocator of the system settles in the first 8,000."""
QUICK = (
    replace(CASES[0], frames=3_000, substeps=10, unit=100, may_grow=0.1),
    replace(CASES[1], frames=600, unit=100, may_grow=0.8, save_bytes=MEBIBYTE),
    replace(CASES[2], frames=600, unit=100, may_grow=0.8, save_bytes=MEBIBYTE),
)


@dataclass(frozen=True)
class Growth:
    """Growth of a process's memory."""

    case: Case
    marks: list[tuple[int, float]]
    """frames done, and memory then [MiB]"""
    rows: float
    """size of the rows of a table, known before it begins [MiB in `Case.unit` frames]"""

    @property
    def slope(self) -> float:
        """Growth from one stretch's highest mark to the next's, without the rows [MiB in `Case.unit` frames]."""
        warm = WARM_UP * self.marks[-1][0]
        length = 0.5 * (self.marks[-1][0] - warm)
        first = max(memory for frame, memory in self.marks if warm < frame <= warm + length)
        second = max(memory for frame, memory in self.marks if warm + length < frame)
        return (second - first) / length * self.case.unit - self.rows

    @property
    def is_bounded(self) -> bool:
        return self.slope <= self.case.may_grow


def measure(case: Case) -> Growth:
    """Run a case in a process of its own, where no other has left memory that it could use."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return process.submit(_measure_here, case).result()


def _measure_here(case: Case) -> Growth:
    quiet_warp()
    marks: list[tuple[int, float]] = []

    def look(frame: int) -> None:
        if frame % max(1, case.frames // MARKS) == 0:
            marks.append((frame, anonymous_memory()))

    columns = len(MEASURES) + 1  # and health, four bytes each
    rows = 4.0 * columns * WORLDS * case.unit / MEBIBYTE if case.name == "batch" else 0.0
    with tempfile.TemporaryDirectory() as folder:
        DO[case.name](case, Path(folder), look)
    return Growth(case, marks, rows)


def _advance(case: Case, folder: Path, look: Callable[[int], None]) -> None:
    for frame in Simulator(_scene(case), "cpu").run():
        look(frame.number)


def _run(case: Case, folder: Path, look: Callable[[int], None]) -> None:
    if case.save_bytes:
        stage.SAVE_BYTES = case.save_bytes
    animate(_scene(case), folder / "long.usdc", device="cpu", on_frame=look)


def _batch(case: Case, folder: Path, look: Callable[[int], None]) -> None:
    if case.save_bytes:
        stage.SAVE_BYTES = case.save_bytes
    run_batch(_scene(case), folder, WORLDS, export=[0], device="cpu", on_frame=look)


DO = {"substeps": _advance, "run": _run, "batch": _batch}


def _scene(case: Case) -> Scene:
    """Return a scene of a balloon on a string, a sphere and the ground."""
    return Scene(
        frames=case.frames,
        substeps=case.substeps,
        normals="cached",
        balloon=[Balloon(mesh=quad_sphere(case.cells, 1.0), inflation=Inflation(k_normal=0.2))],
        sphere=[Sphere(position=(0.0, 3.0, 0.0))],
        string=[String(anchor=(0.0, -2.0, 0.0))],
        ground=Ground(height=-3.0),
    )


def anonymous_memory() -> float:
    """Return the process's own memory without pages of files [MiB]."""
    fields = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(fields["RssAnon"].split()[0]) / 1024


def main() -> None:
    """Print marks and slopes; status 1 where memory grows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a moment instead of minutes, with looser bounds")
    grew = False
    for case in QUICK if parser.parse_args().quick else CASES:
        growth = measure(case)
        print(f"{case.name}: {case.frames:,} frames of {case.substeps} substeps, {case.particles:,} particles")
        for frame, memory in growth.marks[:: len(growth.marks) // 10]:
            print(f"  {frame:9,} frames {memory:9.1f} MiB")
        rows = f", and {growth.rows:.3f} MiB of the table's rows" if growth.rows else ""
        print(f"  {growth.slope:+.3f} MiB in {case.units}{rows}; {case.may_grow:g} allowed", flush=True)
        grew |= not growth.is_bounded
    sys.exit(1 if grew else 0)


if __name__ == "__main__":
    main()
