"""Progress of commands without frames."""

import io
import threading
from collections.abc import Callable
from typing import Any, ClassVar

import pytest
from meshes import quad_sphere
from rich.console import Console
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.cli.progress import LINE_SECONDS, SPINNER_SECONDS, Stages
from balloon_warp.mesh.obj import write_obj


class Later:
    """Timer that fires when a test says so."""

    all: ClassVar[list["Later"]] = []

    def __init__(self, seconds: float, call: Callable[..., None], words: list[str]):
        self.seconds, self.call, self.words, self.cancelled = seconds, call, words, False
        Later.all.append(self)

    def start(self) -> None: ...

    def cancel(self) -> None:
        self.cancelled = True

    def come(self) -> None:
        self.call(*self.words)


@pytest.fixture
def timers(monkeypatch) -> list[Later]:
    monkeypatch.setattr(Later, "all", [])
    monkeypatch.setattr(threading, "Timer", Later)
    return Later.all


def test_a_log_gets_a_line_of_each_stage_that_lasts(timers: list[Later]):
    log = io.StringIO()
    stages = Stages("[cow].obj", Console(file=log))
    stages("reading")
    stages("checking")
    timers[-1].come()
    stages("writing")
    stages.end()
    assert [timer.seconds for timer in timers] == [LINE_SECONDS] * 3
    assert all(timer.cancelled for timer in timers)
    timers[0].come()  # which was on its way
    timers[2].come()
    assert log.getvalue() == "[cow].obj: checking\n"


class Screen:
    """Terminal with one spinner."""

    is_terminal = True

    def __init__(self):
        self.shown: list[str] = []
        self._beside, self._turns = "", False

    def status(self, beside: str) -> "Screen":
        self.update(beside)
        return self

    def update(self, beside: str) -> None:
        self._beside = beside
        if self._turns:
            self.shown.append(beside)

    def start(self) -> None:
        self._turns = True
        self.update(self._beside)

    def stop(self) -> None:
        self._turns = False


def test_a_terminal_shows_the_stage_that_it_is_at(timers: list[Later]):
    screen: Any = Screen()
    stages = Stages("[cow].obj", screen)
    stages("reading")
    stages("checking")
    assert screen.shown == []
    assert [timer.seconds for timer in timers] == [SPINNER_SECONDS]  # from the beginning on
    timers[0].come()
    stages("writing")
    stages.end()
    stages("resting")
    assert screen.shown == [r"\[cow].obj: checking", r"\[cow].obj: writing"]


def test_what_is_short_shows_nothing(timers: list[Later]):
    for terminal in (True, False):
        shown = io.StringIO()
        stages = Stages("cow", Console(file=shown, force_terminal=terminal))
        stages("reading")
        stages.end()
        for timer in timers:
            timer.come()
        assert shown.getvalue() == ""


@pytest.mark.full
@pytest.mark.parametrize("words", [["remesh", "ball.obj", "-o", "out.obj"], ["inspect", "ball.obj"]])
def test_remesh_and_inspect_say_what_they_do(tmp_path, monkeypatch, timers: list[Later], words: list[str]):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "ball.obj", quad_sphere(4))
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert done.stderr == ""
    stages = [timer.words[0] for timer in timers]
    assert stages[0] == "reading the mesh"
    assert len(stages) == len(set(stages)) >= 5
