"""The tests that may find a mutant, and their verdicts: each mutant in a copy of the tree, under pytest."""

import difflib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from balloon_warp.benchmarks.mutants import Mutant
from balloon_warp.benchmarks.traced_tests import Traced
from balloon_warp.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
WAITING = 8.0
"""Times the processor's time that a mutant may take on the wall: the rest is for tests that wait for ever"""
ENOUGH = 2.0
"""Times the seconds of a mutant for which tests are chosen: some are quicker than they were"""
ARBITER = "tests/test_reference.py"
"""File of tests that compare whole steps with the reference: they find most of what is wrong in a kernel"""
LEFT_OUT = (".git", ".venv", "__pycache__", ".*_cache", "build", "dist", "*.egg-info")
"""Files and folders that no test needs"""


@dataclass(frozen=True)
class Verdict:
    """Result of the tests of a mutant."""

    key: str
    place: str
    operator: str
    old: str
    new: str
    found: bool
    by: str
    """Test that failed, or how the mutant survived"""
    seconds: float
    """On the wall"""
    difference: str


def copied(root: Path, folder: Path) -> Path:
    """Return a copy of a tree in a folder."""
    return Path(shutil.copytree(root, folder, ignore=shutil.ignore_patterns(*LEFT_OUT), symlinks=True))


def pytest_in(tree: Path, plugin: str, arguments: Sequence[str], wait: float | None = None) -> tuple[int | None, str]:
    """Run pytest with a plugin of ours in a copy of a tree.

    Returns:
        its status, None if it was still running after `wait` seconds, and its output.
    """
    paths = [str(tree), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "CUDA_VISIBLE_DEVICES": ""}
    # compiled modules are told apart by the second and the size: a mutant may have those of the source
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    plugins = ("no:cacheprovider", "xdist", f"balloon_warp.benchmarks.{plugin}")
    command = [sys.executable, "-m", "pytest", "--rootdir", str(tree), *(f"-p{each}" for each in plugins)]
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            [*command, *arguments], cwd=tree, env=environment, stdout=output, stderr=subprocess.STDOUT,
            start_new_session=True,
        )  # fmt: skip
        try:
            status = process.wait(wait)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        output.seek(0)
        return status, output.read()


def trace(root: Path, processes: int, options: Sequence[str] = ()) -> list[Traced]:
    """Run all tests of a tree once, and return those that pass.

    Raises:
        InputError: none does.
    """
    with tempfile.TemporaryDirectory() as name:
        tree, folder = copied(root, Path(name) / "tree"), Path(name) / "traced"
        folder.mkdir()
        places = ["--traced-into", str(folder), "--traced-root", str(tree)]
        _, printed = pytest_in(tree, "traced_tests", ["-n", str(processes), *places, *options])
        traced = [Traced(**json.loads(line)) for file in sorted(folder.iterdir()) for line in file.open()]
    if not traced:
        raise InputError(f"no test in {root} passes\n{printed}")
    print("\n".join([*(line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))),
                     f"{len(traced):,} tests pass"]), flush=True)  # fmt: skip
    return traced


def executing(mutant: Mutant, traced: Sequence[Traced]) -> list[Traced]:
    """Return the tests that execute the function around a mutant's place."""
    return _within(mutant, traced, mutant.spans[0]) if mutant.spans else []


def _within(mutant: Mutant, traced: Sequence[Traced], span: tuple[int, int]) -> list[Traced]:
    first, last = span
    return [test for test in traced if any(first <= line <= last for line in test.functions.get(mutant.path, ()))]


def candidates(mutant: Mutant, traced: Sequence[Traced], root: Path) -> list[Traced]:
    """Return the tests that may find a mutant, the quickest that execute little else first, each kind once at first.

    They execute the function around its place, or else one around that, or anything of the file, or of one that
    imports it. Of kinds that have had as many turns, that of the arbiter is first; all of its cases are where no kernel
    is compiled anew for them, since tables of one set or schedule alone are made in every test.
    """
    found = []
    for span in [*mutant.spans, (0, sys.maxsize)]:
        found = found or _within(mutant, traced, span)
    if not found:
        name = mutant.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        importers = {path for path in {path for test in traced for path in test.functions}
                     if name in (root / path).read_text()}  # fmt: skip
        found = [test for test in traced if not importers.isdisjoint(test.functions)]
    found.sort(key=lambda test: (0.1 + test.seconds) * sum(map(len, test.functions.values())))
    times: Counter[str] = Counter()
    turns = {}
    for test in found:
        kind = test.test.partition("[")[0]
        is_quick = test.test.startswith(ARBITER) and not mutant.path.startswith("kernels/")
        turns[test.test] = 0 if is_quick else times[kind]
        times[kind] += 1
    return sorted(found, key=lambda test: (turns[test.test], not test.test.startswith(ARBITER)))


def judge(mutant: Mutant, tree: Path, tests: Sequence[Traced], seconds: float, options: Sequence[str]) -> Verdict:
    """Run tests on a mutant, in a tree that is as it was before and after that.

    A mutant counts as found if the test that fails with it passes without it.
    """
    chosen, expected = [], 0.0
    for test in tests:
        if expected < ENOUGH * seconds:
            chosen.append(test.test)
            expected += test.seconds
    begin, found, by, last = time.monotonic(), False, "no tests", ""
    with _mutated(tree / mutant.path, mutant) as difference:
        if chosen:
            found, by, last = _run(tree, chosen, seconds, options)
    if found and _run(tree, [last], seconds, options)[0]:
        found, by = False, f"{last} fails without it, too"
    return Verdict(mutant.key, f"{mutant.path}:{mutant.line}", mutant.operator, mutant.old, mutant.new, found, by,
                   round(time.monotonic() - begin, 1), difference)  # fmt: skip


@contextmanager
def _mutated(path: Path, mutant: Mutant) -> Iterator[str]:
    """Change a file for a while, and return how."""
    before = path.read_bytes()
    after = mutant.source(before)
    old, new = before.decode().splitlines(), after.decode().splitlines()
    try:
        _replace(path, after)
        yield "\n".join(difflib.unified_diff(old, new, mutant.path, mutant.path, lineterm="", n=1))
    finally:
        _replace(path, before)


def _replace(path: Path, text: bytes) -> None:
    """Write a file, and delete its compiled form, which Python would take if size and second were the same."""
    path.write_bytes(text)
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def _run(tree: Path, chosen: Sequence[str], seconds: float, options: Sequence[str]) -> tuple[bool, str, str]:
    """Return whether any of some tests fails in a tree, which or how many do not, and the last that began."""
    with tempfile.TemporaryDirectory() as name:
        listed, report = Path(name) / "chosen", Path(name) / "report"
        listed.write_text("\n".join(chosen))
        report.touch()
        files = dict.fromkeys(test.partition("::")[0] for test in chosen)
        asked = ["-x", "-n", "0", "--tb=no", "--chosen", str(listed), "--chosen-seconds", str(seconds),
                 "--chosen-report", str(report)]  # fmt: skip
        status, _ = pytest_in(tree, "chosen_tests", [*asked, *options, *files], WAITING * seconds)
        lines = report.read_text().splitlines()
    begun = [line.removeprefix("begins ") for line in lines if line.startswith("begins ")]
    fails = [line.removeprefix("fails ") for line in lines if line.startswith("fails ")]
    last = begun[-1] if begun else chosen[0]
    if fails:
        return True, fails[0], last
    if status in (0, 5):  # 5: the tests have other parameters now
        return False, f"{len(begun)} of {len(chosen)} tests pass", last
    if status is None or status == -signal.SIGXCPU:
        return True, f"hangs in {last}", last
    return True, f"crashes in {last}" if begun else "cannot be imported", last


def judge_all(
    root: Path,
    mutants: Sequence[Mutant],
    traced: Sequence[Traced],
    processes: int,
    seconds: float,
    options: Sequence[str] = (),
) -> Iterator[Verdict]:
    """Judge mutants side by side, each process in a copy of the tree."""
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(processes) as pool:
        trees: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for number in range(min(processes, len(mutants))):
            trees.put(copied(root, Path(name) / str(number)))

        def take_turn(mutant: Mutant) -> Verdict:
            tree = trees.get()
            try:
                tests = candidates(mutant, traced, tree)
                verdict = judge(mutant, tree, tests, seconds, options)
                executed = verdict.found or executing(mutant, traced) or not mutant.spans
                return verdict if executed else replace(verdict, by=f"{verdict.by}; none executes its function")
            finally:
                trees.put(tree)

        for done in as_completed([pool.submit(take_turn, mutant) for mutant in mutants]):
            yield done.result()
