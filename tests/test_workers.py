"""Background jobs, child processes, and results that are lost with their worker."""

import os
import re
import signal
import threading
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from balloon_warp import Cluster
from balloon_warp.errors import WorkersLostError
from balloon_warp.outputs.background import WAITING, Background
from balloon_warp.sweep import dask_workers
from balloon_warp.sweep.child import begin_children, start_child
from balloon_warp.sweep.cluster import worker_environments


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
    with pytest.raises(OSError, match="disk full"), Background() as background:
        background.submit(_fail)


def _fail() -> None:
    raise OSError("disk full")


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
        dask_workers._result(lost, lost)
    slow: Any = FarAway(workers=1, seconds=200.0)
    assert dask_workers._result(slow, slow) == "share"
    assert slow.timeouts == [60.0, 120.0, 240.0]
