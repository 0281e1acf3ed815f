"""Faults of a cluster, each reported in a sentence."""

import subprocess
import sys

import pytest
from clusters import address_of, batch, start_workers, write_ball
from small_batch import scene

from balloon_warp import Cluster, InputError, MissingExtraError, run_batch
from balloon_warp.sweep import cluster as cluster_module
from balloon_warp.sweep import dask_workers

distributed = pytest.importorskip("distributed")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--cluster", "localhost"], "--cluster localhost: expected an address such as tcp://192.168.0.1:8786"),
        (["--cluster", "tcp://127.0.0.1:1"], "--cluster tcp://127.0.0.1:1: no scheduler answered within 1 s"),
        (["--workers", "0"], "--workers 0: expected at least 1"),
        (["--gpus", "99"], "--gpus 99: this machine has "),
        (["--gpus", "1", "--workers", "2"], "--cluster, --gpus, --workers: expected only one of them"),
        (["--workers", "1", "--device", "cpu"], "--device cpu: needs --cluster"),
    ],
)
def test_a_mistake_gets_one_sentence_and_status_2(tmp_path, monkeypatch, capfd, arguments: list[str], sentence: str):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(dask_workers, "CONNECT_SECONDS", 1.0)
    write_ball(tmp_path)
    assert batch(monkeypatch, *arguments) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {sentence}")
    assert len(captured.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["ball.obj"]


def test_a_gpu_that_is_named_twice_is_refused(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1,0,1")
    with pytest.raises(InputError, match=r"^CUDA_VISIBLE_DEVICES=1,0,1: names a GPU twice$"):
        cluster_module.worker_environments(Cluster(gpus=2))


def test_a_script_without_a_guard_is_told(tmp_path):
    """A script without a main guard is reported: each worker imports it, and would start workers of its own."""
    script = tmp_path / "script.py"
    script.write_text(
        "import balloon_warp as bw\n"
        f"ball = bw.load_mesh({str(write_ball(tmp_path))!r})\n"
        "scene = bw.Scene(balloon=[{'mesh': ball}], frames=1)\n"
        "bw.run_batch(scene, 'out', 2, cluster=bw.Cluster(workers=1))\n"
    )
    ended = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].startswith("balloon_warp.errors.InputError: --workers 1: the workers do not")
    assert not (tmp_path / "out").exists()


def test_a_scheduler_without_workers_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_workers, "WORKER_SECONDS", 0.5)
    with (
        start_workers(0) as nobody,
        pytest.raises(InputError, match=r"^--cluster tcp://.*: the scheduler has no worker after 0\.5 s"),
    ):
        run_batch(scene(), tmp_path / "out", 2, cluster=Cluster(address=address_of(nobody)))
    assert list(tmp_path.iterdir()) == []


def test_the_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'balloon-warp\[cluster\]'"):
        run_batch(scene(), tmp_path, 2, cluster=Cluster("tcp://127.0.0.1:1"))
