"""`balloon-warp doctor` and `--version`: the report of an installation, which finds a broken one."""

import json
import sys
from dataclasses import replace
from importlib import metadata

import pytest

from balloon_warp import doctor
from balloon_warp.cli import main


def typed(monkeypatch: pytest.MonkeyPatch, words: str) -> int:
    """Return the exit status of a command line."""
    monkeypatch.setattr(sys, "argv", ["balloon-warp", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def report() -> doctor.Report:
    return doctor.examine("cpu")


def test_the_balloon_falls_by_the_formula_and_grows(report: doctor.Report):
    """The fall agrees with the formula within float32's sum over substeps: the command's bound is ten times that."""
    assert report.self_test.passed
    assert report.self_test.fallen == pytest.approx(report.self_test.expected, rel=1e-5)
    assert report.self_test.expected == pytest.approx(9.81 / 2, rel=0.05)
    assert report.self_test.grown > 1.5


@pytest.mark.parametrize("wrong", [{"fallen": 4.0}, {"fallen": float("nan")}, {"grown": 1.0}, {"grown": float("nan")}])
def test_a_balloon_that_does_otherwise_fails(report: doctor.Report, wrong: dict[str, float]):
    assert not replace(report.self_test, **wrong).passed


def test_extras_are_missing_where_a_package_of_theirs_is(monkeypatch: pytest.MonkeyPatch):
    wanted = [
        "warp-lang>=1.19",
        "no-such-package>=2; extra == 'view'",
        'numpy>=1.26; extra == "view"',
        "numpy; extra == 'foil'",
    ]
    monkeypatch.setattr(metadata, "requires", lambda name: wanted)
    assert doctor.missing_extras() == {"foil": [], "view": ["no-such-package"]}


def test_every_extra_of_the_package_is_looked_at(report: doctor.Report):
    assert {"bench", "cluster", "docs", "foil", "test", "video", "view"} <= report.missing.keys()
    assert report.missing["test"] == []


def test_it_says_what_there_is(
    report: doctor.Report, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    found = replace(report, missing={"video": ["imageio-ffmpeg"], "view": []})
    monkeypatch.setattr(doctor, "examine", lambda device: found)
    assert typed(monkeypatch, "doctor") == 0
    said = capsys.readouterr().out
    assert f"warp-lang {metadata.version('warp-lang')}" in said
    assert "device         cpu (CPU)" in said
    assert "extra video    missing imageio-ffmpeg: pip install 'balloon-warp[video]'\n" in said
    assert "extra view     installed\n" in said
    assert "self-test      passed in " in said


def test_a_failed_test_ends_with_status_1(
    report: doctor.Report, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    broken = replace(report, self_test=replace(report.self_test, fallen=4.0))
    monkeypatch.setattr(doctor, "examine", lambda device: broken)
    assert typed(monkeypatch, "doctor") == 1
    assert "self-test      FAILED in " in capsys.readouterr().out
    assert typed(monkeypatch, "doctor --json") == 1
    assert json.loads(capsys.readouterr().out)["passed"] is False


def test_an_unknown_device_gets_a_sentence(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    assert typed(monkeypatch, "doctor --device cuda:77") == 2
    assert "error: --device cuda:77: no such device; this machine has " in capsys.readouterr().err


def test_the_version_is_the_package_s(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    assert typed(monkeypatch, "--version") == 0
    assert capsys.readouterr().out.strip() == metadata.version("balloon-warp")
