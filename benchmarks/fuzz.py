"""Tries what should do no harm: every mesh of the table, then mutations of meshes and scenes for as long as one likes.

    python -m balloon_warp.benchmarks.fuzz --minutes 10

A reader may take a file or refuse it with an `InputError`. Anything else is a failure: another exception, a warning of
NumPy, a result that makes no sense, ten seconds for a file, more memory than is allowed.
"""

import argparse
import contextlib
import itertools
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings

from balloon_warp.benchmarks.bad_meshes import CUBE, MESH_CASES, MeshCase
from balloon_warp.benchmarks.changed_files import MESH_PIECES, SCENE_PIECES, mesh_seeds, mutated, scene_seeds
from balloon_warp.errors import InputError
from balloon_warp.mesh.load import load_mesh
from balloon_warp.model import ModelPlan, plan_model
from balloon_warp.scene import load_scene
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.inspect import inspect_mesh

LONGEST = 10.0
"""seconds of the processor that a file may take"""
PATIENCE = 30.0
"""times as long may pass in all: others may have the processor, but nothing may wait for ever"""
MOST_MEMORY = 4 << 30
"""bytes that reading may add to the address space"""
ROUND = 200
"""files between looks at the clock"""

Count = Counter[str]
"""files by their outcomes: "accepted" or "refused" """


def try_case(case: MeshCase, folder: Path) -> str | None:
    """Return a sentence on how a mesh of the table is mishandled; None if it is not."""
    path = folder / "case.obj"
    path.write_bytes(case.content())
    try:
        with _limited_time():
            sentences = [*_plan(path, case.overrides).shapes[0].mesh.warnings]
        outcome = "warned" if sentences else "accepted"
    except InputError as mistake:
        outcome, sentences = "refused", [str(mistake)]
    except (TimeoutError, MemoryError) as failure:
        return f"{case.name}: {type(failure).__name__} {failure}"
    if outcome != case.outcome:
        return f"{case.name}: expected to be {case.outcome}, was {outcome} ({'; '.join(sentences)})"
    if case.says and not any(case.says in sentence for sentence in sentences):
        return f"{case.name}: expected {case.says!r}, got {'; '.join(sentences)}"
    return None


def fuzz_meshes(folder: Path, examples: int, number: int, count: Count) -> None:
    """Read mutated OBJ files, report on them, and make balloons of them.

    Args:
        folder: where they are written, one over the other.
        examples: how many.
        number: of the round; each has other files, and the same every time.
        count: their outcomes are added to it.
    """
    path = folder / "mesh.obj"

    def read() -> None:
        report = inspect_mesh(load_mesh(path))
        assert np.isfinite(report.area)
        assert report.vertices >= 1
        assert all(sentence.endswith(".") for sentence in report.warnings)
        _check_plan(_plan(path))

    _fuzz(path, read, mesh_seeds(), MESH_PIECES, examples, number, count)


def fuzz_scenes(folder: Path, examples: int, number: int, count: Count) -> None:
    """Read mutated scene files, and plan their models; arguments as in `fuzz_meshes`."""
    (folder / "cube.obj").write_bytes(CUBE)
    path = folder / "scene.toml"
    _fuzz(path, lambda: _check_plan(_plan(path)), scene_seeds(), SCENE_PIECES, examples, number, count)


def _fuzz(
    path: Path,
    read: Callable[[], None],
    seeds: list[bytes],
    pieces: list[bytes],
    examples: int,
    number: int,
    count: Count,
) -> None:
    @settings(
        max_examples=examples,
        database=None,
        deadline=None,
        suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example),
        phases=(Phase.generate, Phase.shrink),
    )
    @seed(number)
    @given(mutated(seeds, pieces))
    def meet(content: bytes) -> None:
        path.write_bytes(content)
        try:
            with _limited_time(), warnings.catch_warnings():
                warnings.simplefilter("error")
                read()
            count["accepted"] += 1
        except InputError as mistake:
            _check_sentence(str(mistake))
            count["refused"] += 1

    meet()


def _plan(path: Path, overrides: tuple[tuple[str, object], ...] = ()) -> ModelPlan:
    return plan_model(load_scene(path, overrides))


def _check_plan(plan: ModelPlan) -> None:
    assert plan.substeps >= 1
    for shape in plan.shapes:
        assert np.isfinite(shape.mesh.points[shape.mesh.face_vertex_indices]).all()
        assert np.isfinite(shape.springs.rest_lengths).all()
        assert np.isfinite(shape.mass_share).all()


def _check_sentence(sentence: str) -> None:
    assert ": " in sentence, f"a refusal that names no file or field: {sentence}"
    assert "\n" not in sentence, f"a refusal of more than a line: {sentence}"
    assert len(sentence) < 1000, f"a refusal without end: {sentence}"


@contextlib.contextmanager
def _limited_time() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"a file took more than {LONGEST:g} s")

    timers = ((signal.ITIMER_PROF, signal.SIGPROF, LONGEST), (signal.ITIMER_REAL, signal.SIGALRM, PATIENCE * LONGEST))
    before = [signal.signal(number, stop) for _, number, _ in timers]
    for timer, _, seconds in timers:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (timer, number, _), handler in zip(timers, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


@contextlib.contextmanager
def _limited_memory() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_MEMORY, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def try_table(folder: Path) -> tuple[Count, list[str]]:
    """Every mesh of the table: counts by outcome, and complaints."""
    with _limited_memory():
        wrong = [complaint for case in MESH_CASES if (complaint := try_case(case, folder))]
    return Counter(case.outcome for case in MESH_CASES), wrong


def fuzz_for(seconds: float, what: str, folder: Path) -> tuple[Count, str | None]:
    """Mutations of "meshes" or "scenes" until the time is over or one fails.

    Returns:
        their outcomes, and the failure; the shortest file that shows it is then copied to here.
    """
    count, end = Counter(), time.monotonic() + seconds
    try:
        with _limited_memory():
            for number in itertools.takewhile(lambda _: time.monotonic() < end, itertools.count()):
                FUZZERS[what](folder, ROUND, number, count)
    except Exception as failure:
        # Hypothesis reads the shortest file that fails last.
        found = max(folder.iterdir(), key=lambda file: file.stat().st_mtime_ns)
        kept = Path("fuzz_found").with_suffix(found.suffix)
        shutil.copy(found, kept)
        return count, f"{type(failure).__name__}: {failure}; see {kept}"
    return count, None


FUZZERS: dict[str, Callable[[Path, int, int, Count], None]] = {"meshes": fuzz_meshes, "scenes": fuzz_scenes}


def main() -> None:
    """Print how many of each were tried; a failure ends it with the shortest file that shows it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="for the mutations, half of them for scenes")
    minutes = parser.parse_args().minutes
    quiet_warp()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        outcomes, wrong = try_table(folder)
        print(f"table: {outcomes.total()} meshes, {shown(outcomes)}; {len(wrong)} otherwise than expected", flush=True)
        for complaint in wrong:
            print(f"  {complaint}")
        for what in FUZZERS:
            count, failure = fuzz_for(30.0 * minutes, what, folder)
            if failure:
                print(f"mutated {what}: {failure}")
                sys.exit(1)
            print(f"mutated {what}: {count.total():,} tried, {shown(count)}; no failure", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"most memory: {peak:,.0f} MiB")
    sys.exit(1 if wrong else 0)


def shown(count: Count) -> str:
    """Return counts of outcomes in words, such as `3 accepted, 5 refused`."""
    return ", ".join(f"{number:,} {outcome}" for outcome, number in sorted(count.items()))


if __name__ == "__main__":
    main()
