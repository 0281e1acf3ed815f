"""Ctrl-C and SIGTERM: when they take effect, and what a command says."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import status_of
from meshes import quad_sphere

from balloon_warp import animate, load_scene
from balloon_warp.interrupts import Interrupts
from balloon_warp.mesh.obj import write_obj
from balloon_warp.outputs import render


def press(interrupts: Interrupts) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    assert interrupts.pending


def done_of(work: list[Callable[[Interrupts], None]], message: str) -> int:
    """Return the number of work items done with Ctrl-C deferred, until it is raised with a message."""
    done = 0

    def run() -> None:
        nonlocal done
        with Interrupts() as interrupts:
            for step in work:
                step(interrupts)
                done += 1

    with pytest.raises(KeyboardInterrupt, match=f"^{message}$"):
        run()
    return done


def test_ctrl_c_waits_until_it_is_delivered_but_for_the_second():
    assert done_of([press, lambda _: None, lambda interrupts: interrupts.deliver("so far")], "so far") == 2
    assert done_of([press, lambda _: None], "") == 2
    assert done_of([press, press, lambda _: None], "") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_handlers_are_those_of_before(number: signal.Signals):
    before = signal.signal(number, handler := lambda *_: None)
    try:
        with Interrupts():
            assert signal.getsignal(number) is not handler
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_command_that_is_stopped_says_so(tmp_path, monkeypatch, capsys, number: signal.Signals, status: int):

    def interrupted(_: Path, copy: Path) -> None:
        copy.touch()
        os.kill(os.getpid(), number)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("shutil.copyfile", interrupted)
    before = signal.getsignal(number)
    assert status_of("scenes", "net_forces", "-o", "mine.toml") == status
    assert capsys.readouterr() == ("", "error: scenes was interrupted\n")
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) == before


def test_ctrl_c_while_the_program_loads_is_a_word_too(tmp_path):
    """Ctrl-C during the program's import gives the message, too; a module that is imported first sends it, as a real
    one would have to meet a few tenths of a second."""
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])}
    command = [sys.executable, "-m", "balloon_warp", "scenes"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted before the start\n")


def test_what_is_ignored_stays_ignored(monkeypatch, capsys):
    """An ignored signal stays ignored, as Ctrl-C is by a process that a shell started in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        monkeypatch.setattr("balloon_warp.cli.scenes._list_scenes", lambda: os.kill(os.getpid(), signal.SIGINT))
        assert status_of("scenes") == 0
        assert capsys.readouterr().err == ""
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_picture_that_is_stopped_leaves_the_stage_and_says_so(tmp_path, monkeypatch):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    scene = load_scene(tmp_path / "ball.obj", {"frames": 1})

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(render, "render_stage", interrupted)
    with pytest.raises(KeyboardInterrupt, match=r"/ball\.usda is written, .*/ball\.png is not$"):
        animate(scene, tmp_path / "ball.usda", picture=tmp_path / "ball.png", device="cpu", schedule="scatter")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "ball.usda"]
