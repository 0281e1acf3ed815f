"""Child processes, and what they see of the machine."""

import os
import re
import signal
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path

import warp as wp

from balloon_warp import Cluster
from balloon_warp.sweep.child import begin_children, start_child
from balloon_warp.sweep.cluster import worker_environments


def test_each_gpu_has_a_worker_that_sees_it_alone(monkeypatch):
    """Each process sees one GPU of those that are visible to this one."""
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
