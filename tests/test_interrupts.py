"""Ctrl-C and SIGTERM, background jobs, child processes, and results that are lost with their worker."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import warp as wp
from commands import status_of
from meshes import quad_sphere

from balloon_warp import Cluster, WorkersLostError, animate, load_scene
from balloon_warp.farm import remote
from balloon_warp.farm.local_workers import begin_children, start_child
from balloon_warp.farm.workers import worker_environments
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio import render
from balloon_warp.system.streams import Interrupts
from balloon_warp.usd.stage import WAITING, Background


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
        monkeypatch.setattr("balloon_warp.cli.machine._list_scenes", lambda: os.kill(os.getpid(), signal.SIGINT))
        assert status_of("scenes") == 0
        assert capsys.readouterr().err == ""
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.full
def test_a_picture_that_is_stopped_leaves_the_stage_and_says_so(tmp_path, monkeypatch):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    scene = load_scene(tmp_path / "ball.obj", {"frames": 1})

    monkeypatch.setattr(render, "render_stage", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt, match=r"/ball\.usda is written, .*/ball\.png is not$"):
        animate(scene, tmp_path / "ball.usda", picture=tmp_path / "ball.png", device="cpu", schedule="scatter")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "ball.usda"]


def test_jobs_run_in_order_and_their_errors_are_raised_where_the_batch_runs():
    done, gate = [], threading.Event()

    def job(number: int) -> None:
        gate.wait(10.0)
        done.append((number, threading.current_thread() is threading.main_thread()))

    with Background() as background:
        for number in range(WAITING + 1):
            background.submit(job, number)
        threading.Timer(0.2, gate.set).start()
        background.submit(job, WAITING + 1)
        assert gate.is_set()  # it had to wait for a place
    assert done == [(number, False) for number in range(WAITING + 2)]


def test_a_failed_job_takes_what_is_behind_it_along():
    """Jobs queued behind a failed one do not run, so that no checkpoint follows frames that could not be written."""
    done: list[int] = []
    gate = threading.Event()

    def fail() -> None:
        gate.wait()
        raise OSError("disk full")

    def run() -> None:
        with Background() as background:
            background.submit(fail)
            background.submit(done.append, 1)
            gate.set()

    with pytest.raises(OSError, match="disk full"):
        run()
    assert done == []


def test_each_gpu_has_a_worker_that_sees_it_alone(monkeypatch):
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 3)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5,6,7")
    environments = worker_environments(Cluster(gpus=2))
    assert [each["CUDA_VISIBLE_DEVICES"] for each in environments] == ["5", "6"]
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    assert worker_environments(Cluster(gpus=1)) == [{"CUDA_VISIBLE_DEVICES": "0"}]
    process, connection = start_child(tell_surroundings, environments[1])
    assert connection.recv() == ("6", signal.SIG_IGN)  # a terminal sends Ctrl-C to workers, too
    process.join()


def tell_surroundings(connection: Connection) -> None:
    connection.send((os.environ["CUDA_VISIBLE_DEVICES"], signal.getsignal(signal.SIGINT)))


def test_a_fork_server_leaves_ctrl_c_to_its_parent():
    """A fork server does not hear a terminal's Ctrl-C while it loads: it would print a traceback."""
    begin_children()
    status = Path(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read_text()  # pyright: ignore
    blocked = int(re.search(r"^SigBlk:\s*(\w+)", status, re.M)[1], 16)  # pyright: ignore[reportOptionalSubscript]
    assert blocked & 1 << signal.SIGINT - 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


class FarAway:
    """Pending result of a worker, and the client that waits for it."""

    def __init__(self, workers: int, seconds: float):
        self.workers, self.seconds = workers, seconds
        self.timeouts: list[float] = []

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(map(str, range(self.workers)), 1)

    def result(self, timeout: float) -> str:
        self.timeouts.append(timeout)
        if timeout < self.seconds:
            raise TimeoutError
        return "share"


def test_a_result_that_went_with_its_worker_is_not_waited_for_for_ever():
    lost: Any = FarAway(workers=0, seconds=np.inf)
    with pytest.raises(WorkersLostError, match=r"^all workers ended, and none came for 60 s"):
        remote._result(lost, lost)
    slow: Any = FarAway(workers=1, seconds=200.0)
    assert remote._result(slow, slow) == "share"
    assert slow.timeouts == [60.0, 120.0, 240.0]
