"""`balloon-warp bench` as a user types it; its measurements are made up."""

import json
import sys
from collections.abc import Iterator

import pytest

from balloon_warp.benchmarks import auto, run
from balloon_warp.benchmarks.result import Result
from balloon_warp.cli import main
from balloon_warp.device import pick_device
from balloon_warp.model import build_model
from balloon_warp.scene import load_scene
from balloon_warp.schedules.choose import fastest_schedule

RESULTS = [Result("1 balloon", "cpu", "gather", 1, 488, 2.0e8), Result("[s]", "cpu", "lanes", 8, 26, 3.0, "peer", 2.0)]


@pytest.fixture(autouse=True)
def measured(monkeypatch) -> None:
    def results(device: object, quick: bool) -> Iterator[Result]:
        yield from RESULTS

    monkeypatch.setattr(run, "run_cases", results)


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "bench", "--device", "cpu", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code


def test_json_is_all_that_is_printed(monkeypatch, capsys):
    bench(monkeypatch, "--json")
    said = capsys.readouterr()
    assert json.loads(said.out) == [result.as_json() for result in RESULTS]
    assert said.err.splitlines() == ["1 balloon (gather): 2e+08", "[s] (lanes): 3"]


def test_a_table_is_printed_and_the_json_written(tmp_path, monkeypatch, capsys):
    bench(monkeypatch, "-o", str(tmp_path / "results.json"))
    cases = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert [case for case in cases if not case.startswith("-")] == ["case", "1 balloon", "[s]"]
    assert json.loads((tmp_path / "results.json").read_text()) == [result.as_json() for result in RESULTS]


def test_bundled_scenes_are_measured_in_each_schedule_beside_auto(monkeypatch, capsys):
    monkeypatch.setattr(auto, "measured_scenes", lambda: ["two_balloons"])
    monkeypatch.setattr(auto, "WORLDS", (1, 2))
    monkeypatch.setattr(auto, "FRAME_SECONDS", 0.0)  # one at a time
    measured = list(auto.scene_results(pick_device("cpu"), auto.WORLDS))
    assert [(each.schedule, each.worlds) for each in measured] == [(name, n) for n in (1, 2) for name in auto.ON_CPU]
    for each in measured:
        model = build_model(load_scene("two_balloons"), "cpu", each.worlds)
        assert (each.case, each.particles, each.rate > 0.0) == ("two_balloons", 820, True)
        taken = fastest_schedule(model, each.worlds)
        assert each.peer == f"auto: {taken}"
        assert each.peer_rate is not None
        assert each.ratio == pytest.approx(each.rate / each.peer_rate)
        assert each.schedule != taken or each.ratio == 1.0
    monkeypatch.setattr(auto, "scene_results", lambda device: measured)
    bench(monkeypatch, "--scenes", "--json")
    assert json.loads(capsys.readouterr().out) == [result.as_json() for result in measured]


def test_two_sets_of_cases_at_once_are_refused(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "bench", "--scenes", "--quick"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert capsys.readouterr().err == "error: --quick, --scenes, and --gpus or --workers: expected only one of them\n"


def test_variants_of_scenes_can_be_built():
    for source, overrides in auto.VARIANTS.values():
        assert load_scene(source, overrides) != load_scene(source)
