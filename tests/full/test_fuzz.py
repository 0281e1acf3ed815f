"""Short run of the fuzzer: it finds nothing, and it would."""

import itertools
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from balloon_warp.benchmarks import fuzz
from balloon_warp.benchmarks.bad_meshes import MESH_CASES, MeshCase
from balloon_warp.errors import InputError


@pytest.mark.parametrize("read", [fuzz.fuzz_meshes, fuzz.fuzz_scenes])
def test_mutated_files_are_taken_or_refused(read, tmp_path: Path) -> None:
    count: fuzz.Count = Counter()
    read(tmp_path, 100, 0, count)
    assert count.total() >= 100
    assert min(count["accepted"], count["refused"]) >= 10


@pytest.mark.parametrize(
    ("fault", "found"),
    [(ZeroDivisionError("planted"), "planted"), (InputError("no\nsentence: "), "a refusal of more than a line")],
)
def test_a_fault_is_found(fault: Exception, found: str, tmp_path, monkeypatch) -> None:
    def fail(path: Path) -> None:
        raise fault

    monkeypatch.setattr(fuzz, "load_mesh", fail)
    with pytest.raises(type(fault) if isinstance(fault, ZeroDivisionError) else AssertionError, match=found):
        fuzz.fuzz_meshes(tmp_path, 5, 0, Counter())


@pytest.mark.parametrize(("hang", "patience"), [(lambda: None, 1e9), (lambda: time.sleep(0.01), 1.0)])
def test_a_hang_is_found(hang: Callable[[], None], patience: float, tmp_path, monkeypatch) -> None:

    def read(path: Path) -> None:
        while True:
            hang()

    monkeypatch.setattr(fuzz, "LONGEST", 0.02)
    monkeypatch.setattr(fuzz, "PATIENCE", patience)
    monkeypatch.setattr(fuzz, "load_mesh", read)
    with pytest.raises(TimeoutError, match=r"a file took more than 0\.02 s"):
        fuzz.fuzz_meshes(tmp_path, 1, 0, Counter())


def test_the_table_is_held_to(tmp_path: Path) -> None:
    plain = next(case for case in MESH_CASES if case.name == "plain")
    assert fuzz.try_case(plain, tmp_path) is None
    wrong = MeshCase("plain", plain.content, "refused", "is wrong")
    assert fuzz.try_case(wrong, tmp_path) == "plain: expected to be refused, was accepted ()"


@pytest.mark.parametrize(
    ("take", "complaint"),
    [
        (lambda: [time.sleep(0.01) for _ in itertools.count()], "plain: TimeoutError a file took more than"),
        (lambda: bytearray(2 * fuzz.MOST_MEMORY), "plain: MemoryError"),
    ],
)
def test_the_table_has_bounded_time_and_memory(
    take: Callable[[], object], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "MESH_CASES", [case for case in MESH_CASES if case.name == "plain"])
    monkeypatch.setattr(fuzz, "LONGEST", 0.02)
    monkeypatch.setattr(fuzz, "PATIENCE", 1.0)
    monkeypatch.setattr(fuzz, "_plan", lambda *_: take())
    _, [wrong] = fuzz.try_table(tmp_path)
    assert wrong.startswith(complaint)
