"""`balloon-warp bench` as a user types it; what it measures is made up."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from balloon_warp.benchmarks import run
from balloon_warp.benchmarks.result import Result
from balloon_warp.cli import main

RESULTS = [Result("1 balloon", "cpu", "gather", 1, 488, 2.0e8), Result("[s]", "cpu", "lanes", 8, 26, 3.0, "peer", 2.0)]


@pytest.fixture(autouse=True)
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def results(device: object, quick: bool) -> Iterator[Result]:
        yield from RESULTS

    monkeypatch.setattr(run, "run_cases", results)


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "bench", "--device", "cpu", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code


def test_json_is_all_that_is_printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    bench(monkeypatch, "--json")
    said = capsys.readouterr()
    assert json.loads(said.out) == [result.as_json() for result in RESULTS]
    assert said.err.splitlines() == ["1 balloon (gather): 2e+08", "[s] (lanes): 3"]


def test_a_table_is_printed_and_the_json_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    bench(monkeypatch, "-o", str(tmp_path / "results.json"))
    cases = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert [case for case in cases if not case.startswith("-")] == ["case", "1 balloon", "[s]"]
    assert json.loads((tmp_path / "results.json").read_text()) == [result.as_json() for result in RESULTS]
