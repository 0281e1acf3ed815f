"""Batch on many workers: the files are those of one process, and faults get a sentence."""

import contextlib
import functools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import distributed
import numpy as np
import psutil
import pytest
import small_batch
from batches import address_of, batch, start_workers, write_ball
from meshes import quad_sphere
from pxr import Sdf

from balloon_warp import Cluster, InputError, MissingExtraError, Scene, TrajectoryFiles, WorkersLostError, run_batch
from balloon_warp.batch.task import BatchOutput
from balloon_warp.farm import cluster as dask_workers
from balloon_warp.farm import workers
from balloon_warp.farm import workers as local_workers
from balloon_warp.model import state
from balloon_warp.scene import Balloon
from balloon_warp.system.warp_setup import quiet_warp

WORLDS = 24
scene = functools.partial(small_batch.scene, frames=4)


@pytest.fixture(autouse=True)
def fine_grain(monkeypatch) -> None:
    """Split small batches, too, and allow a busy machine more time."""
    monkeypatch.setitem(dask_workers.GRAIN, "cpu", dask_workers.Grain(1, 1))
    monkeypatch.setattr(dask_workers, "SHARES", 8)
    monkeypatch.setattr(dask_workers, "CONNECT_SECONDS", 120.0)
    monkeypatch.setattr(dask_workers, "WORKER_SECONDS", 120.0)


@pytest.fixture(autouse=True, scope="module")
def modules_that_load_late() -> None:
    """Load now the modules of other tests that load when they are looked at, as Newton's: dask looks at all of them in
    a thread of its own, and Python 3.11 before 3.11.8 cannot parse in two threads at once."""
    for module in list(sys.modules.values()):
        getattr(module, "__file__", None)


@pytest.fixture
def vary(tmp_path) -> dict:
    """Return two meshes in turn, which makes two groups, and a mass of its own for each world."""
    paths = small_batch.write_meshes(tmp_path)
    return {"balloon.0.mesh": paths * (WORLDS // 2), "balloon.mass": np.linspace(0.1, 0.2, WORLDS)}


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Yield the address of a running scheduler with one worker."""
    with start_workers(1) as workers:
        yield address_of(workers)


def assert_same_files(folder: Path, expected: Path) -> None:
    """Check that files agree to the last bit: the table byte by byte, the stage sample by sample."""
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in expected.iterdir())
    for name in ("table.csv", "table.npz", "worlds.csv", "worlds.npz"):
        assert (folder / name).read_bytes() == (expected / name).read_bytes()
    stages = [Sdf.Layer.FindOrOpen(str(place / "worlds.usdc")) for place in (folder, expected)]
    assert stages[0].ExportToString() == stages[1].ExportToString()


def test_two_workers_give_what_one_process_gives(vary: dict, tmp_path):
    """Two workers write the files of one process, bit-identical, without the mesh files: shares carry their data."""
    export = [1, 7, 22]
    files = [TrajectoryFiles(tmp_path / name, 2, "npz") for name in ("data_alone", "data_both")]
    how = {"export": export, "name": "small"}
    alone = run_batch(scene(), tmp_path / "alone", WORLDS, vary, **how, device="cpu", trajectories=files[0])
    gone = functools.partial(remove, list(map(str, set(vary["balloon.0.mesh"]))))
    seen = []
    local = Cluster(workers=2, prepare=gone)
    how |= {"cluster": local, "on_frame": seen.append, "trajectories": files[1]}
    together = run_batch(scene(), tmp_path / "both", WORLDS, vary, **how)
    assert not any(path.exists() for path in vary["balloon.0.mesh"])
    assert_same_files(tmp_path / "both", tmp_path / "alone")
    both = [{path.name: path.read_bytes() for path in Path(each.folder).rglob("*.npz")} for each in files]
    assert both == both[::-1]
    assert (together.workers, together.device, together.schedule) == (2, "cpu", alone.schedule)
    same = ("worlds", "exported_worlds", "unhealthy_worlds", "particles", "springs", "frames", "substeps")
    assert all(getattr(together, name) == getattr(alone, name) for name in same)
    assert seen == sorted(seen)
    assert seen[-1] == 4


def test_the_workers_end_before_the_table_is_written(tmp_path, monkeypatch):
    """Processes are gone when rows are written: they would keep the memory of GPUs."""

    def finish_without_children(output: BatchOutput, frames: int) -> dict[str, str]:
        until = time.monotonic() + 60.0
        while workers_here():
            assert time.monotonic() < until
            time.sleep(0.01)
        return finish(output, frames)

    finish = BatchOutput.finish
    monkeypatch.setattr(BatchOutput, "finish", finish_without_children)
    run_batch(scene(), tmp_path / "out", 2, cluster=Cluster(workers=1))
    assert len((tmp_path / "out" / "table.csv").read_text().splitlines()) == 1 + 5 * 2


def workers_here() -> list[psutil.Process]:
    """Return the processes that this one has had its fork server start as workers."""
    found = []
    for server in psutil.Process().children():
        with contextlib.suppress(psutil.NoSuchProcess):  # it has ended meanwhile
            found += server.children() if "forkserver" in " ".join(server.cmdline()) else []
    return [each for each in found if each.status() != psutil.STATUS_ZOMBIE]


def remove(paths: list[str]) -> None:
    for path in paths:
        Path(path).unlink(missing_ok=True)


def test_the_share_of_a_killed_worker_is_done_again(tmp_path):
    run_batch(scene(), tmp_path / "alone", 4, export=[0, 3], device="cpu")
    (tmp_path / "starts").mkdir()
    killed = []

    def kill(frame: int) -> None:
        if not killed:
            killed.append(int(os.readlink(tmp_path / "victim")))
            os.kill(killed[0], signal.SIGKILL)

    local = Cluster(workers=2, prepare=functools.partial(note_starts, str(tmp_path)))
    run_batch(scene(), tmp_path / "both", 4, export=[0, 3], cluster=local, on_frame=kill)
    assert_same_files(tmp_path / "both", tmp_path / "alone")
    assert not psutil.pid_exists(killed[0])
    starts = [path.stat().st_size for path in (tmp_path / "starts").iterdir()]
    assert sum(starts) == 4 + 1  # four shares, one of them twice


def note_starts(folder: str) -> None:
    """Let a worker write a byte for each share that it starts; the first of all waits in it."""
    lay_out = dask_workers.lay_out

    def note_and_lay_out(*given: Any) -> Any:
        with open(f"{folder}/starts/{os.getpid()}", "ab") as file:
            file.write(b".")
        with contextlib.suppress(FileExistsError):
            os.symlink(str(os.getpid()), f"{folder}/victim")  # at once, by one of them alone
            time.sleep(600)
        return lay_out(*given)

    dask_workers.lay_out = note_and_lay_out


def test_a_share_that_ends_processes_here_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(local_workers, "MOST_LOSSES", 1)
    with pytest.raises(WorkersLostError, match=r"^a share of the batch crashed 2 workers in a row"):
        run_batch(scene(), tmp_path / "out", 1, cluster=Cluster(workers=1, prepare=end_in_share))
    assert list((tmp_path / "out").iterdir()) == []
    assert not workers_here()


def end_in_share() -> None:
    dask_workers.lay_out = lambda *_: os._exit(1)


def is_at_work() -> bool:
    try:
        distributed.get_worker().get_current_task()
    except ValueError:
        return False
    return True


def end_worker() -> None:
    if is_at_work():
        os._exit(1)


LOST = {
    # also where Dask did not restart a worker that died as it joined
    "by a share": (end_worker, None, r"^(a share of the batch crashed 4 workers in a row|all workers ended)"),
    "all": (None, lambda workers: workers.scale(0), r"^all workers ended, and none came for 1 s; "),
    "the scheduler": (None, lambda workers: workers.close(), r"^the scheduler is gone"),
}
"""the preparation of a worker, the event for all of them at each frame, and the sentence"""


@pytest.mark.parametrize("which", LOST)
def test_workers_that_are_gone_are_not_waited_for_for_ever(which: str, tmp_path, monkeypatch):
    prepare, happens, sentence = LOST[which]
    monkeypatch.setattr(dask_workers, "ALONE_SECONDS", 1.0 if which == "all" else dask_workers.ALONE_SECONDS)
    with start_workers(1) as workers:
        cluster = Cluster(address=address_of(workers), prepare=prepare)
        count, happen = 8 if happens else 1, lambda frame: happens and happens(workers)
        with pytest.raises(WorkersLostError, match=sentence):
            run_batch(scene(), tmp_path, count, cluster=cluster, device="cpu", on_frame=happen)
    assert [path.name for path in tmp_path.iterdir()] in ([], ["partial"] if happens else [])  # a share may be done


def test_workers_of_this_machine_listen_nowhere(tmp_path):
    seen: list[Any] = []

    def look(frame: int) -> None:
        if not seen:
            seen.extend(each.net_connections() for each in workers_here())

    run_batch(scene(), tmp_path / "out", 4, cluster=Cluster(workers=2), on_frame=look)
    assert seen == [[], []]


def test_the_command_spreads_over_a_scheduler(address: str, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write_ball(tmp_path)
    arguments = ["--worlds", "6", "--vary", "gravity=1:9", "--export", "2", "--set", "frames=3", "--device", "cpu"]
    assert batch(*arguments, "-o", "alone") == 0
    assert batch(*arguments, "-o", "both", "--cluster", address) == 0
    captured = capfd.readouterr()
    said = [line.partition(". ")[0] for line in captured.err.splitlines()]
    assert said == 2 * ["note: ball.obj inflates above a floor"]
    assert " on 1 x cpu, schedule " in captured.out.splitlines()[7]
    assert_same_files(tmp_path / "both", tmp_path / "alone")


def test_a_device_that_is_not_there_or_named_twice_is_told(address: str, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"^device cuda:99: no such device"):
        run_batch(scene(), tmp_path / "out", 2, cluster=Cluster(address=address), device="cuda:99")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1,0,1")
    with pytest.raises(InputError, match=r"^CUDA_VISIBLE_DEVICES=1,0,1: names a GPU twice$"):
        workers.worker_environments(Cluster(gpus=2))


def test_the_first_gpu_is_this_process_s(tmp_path, monkeypatch):
    """A thread simulates beside a process, to the same bytes; here both on the CPU."""
    run_batch(scene(), tmp_path / "alone", 8, export=[0, 3], device="cpu")
    monkeypatch.setattr(local_workers, "worker_environments", lambda cluster: [{}] * cluster.gpus)
    monkeypatch.setattr(Cluster, "device", lambda *_: "cpu")
    here = set()

    def note_thread(*given: Any) -> Any:
        here.add(threading.current_thread().name)
        return lay_out(*given)

    lay_out = dask_workers.lay_out
    monkeypatch.setattr(dask_workers, "lay_out", note_thread)
    run_batch(scene(), tmp_path / "both", 8, export=[0, 3], cluster=Cluster(gpus=2))
    assert_same_files(tmp_path / "both", tmp_path / "alone")
    assert here == {"first GPU"}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--cluster", "localhost"], "--cluster localhost: expected an address such as tcp://192.168.0.1:8786"),
        (["--cluster", "tcp://127.0.0.1:1"], "--cluster tcp://127.0.0.1:1: no scheduler answered within 1 s"),
        (["--workers", "0"], "--workers 0: expected at least 1"),
        (["--gpus", "99"], "--gpus 99: this machine has "),
        (["--gpus", "1", "--workers", "2"], "--cluster, --gpus, --workers: expected only one of them"),
        (["--workers", "1", "--device", "cpu"], "--device cpu: needs a cluster"),
    ],
)
def test_a_mistake_gets_one_sentence_and_status_2(tmp_path, monkeypatch, capfd, arguments: list[str], sentence: str):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(dask_workers, "CONNECT_SECONDS", 1.0)
    write_ball(tmp_path)
    assert batch(*arguments) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {sentence}")
    assert len(captured.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["ball.obj"]


def test_a_script_without_a_guard_is_told(tmp_path):
    """A script without a main guard is reported: each worker imports it, and would start workers of its own."""
    scene = f"bw.Scene(balloon=[{{'mesh': bw.load_mesh({str(write_ball(tmp_path))!r})}}], frames=1)"
    batch = f"import balloon_warp as bw\nbw.run_batch({scene}, 'out', 2, cluster=bw.Cluster(workers=1))\n"
    (script := tmp_path / "script.py").write_text(batch)
    ended = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].startswith("balloon_warp.errors.InputError: workers 1: the workers do not")
    assert not (tmp_path / "out").exists()


def test_no_workers_and_no_extra_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_workers, "WORKER_SECONDS", 0.5)
    with (
        start_workers(0) as nobody,
        pytest.raises(InputError, match=r"^cluster tcp://.*: the scheduler has no worker after 0\.5 s"),
    ):
        run_batch(scene(), tmp_path / "out", 2, cluster=Cluster(address=address_of(nobody)))
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'balloon-warp\[cluster\]'"):
        run_batch(scene(), tmp_path, 2, cluster=Cluster("tcp://127.0.0.1:1"))


ROOM_WORLDS = 16


def fill_first(folder: str, most: int) -> None:
    """Let the memory of a worker be full, if it is one of the first to ask."""
    quiet_warp()
    claims = [Path(folder) / str(number) for number in range(most)]
    if any(claim.exists() and claim.read_text() == str(os.getpid()) for claim in claims):
        return
    for claim in claims:
        with contextlib.suppress(FileExistsError), claim.open("x") as file:
            file.write(str(os.getpid()))
            state.free_memory = lambda device: 1024
            return


def simulate(folder: Path, cluster: Cluster | None, notes: list[str]) -> bytes:
    """Simulate a small batch, and return its table."""
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3))], frames=3)
    vary = {"balloon.mass": np.linspace(0.1, 0.2, ROOM_WORLDS)}
    where = {"device": None if cluster else "cpu", "cluster": cluster}
    run_batch(scene, folder, ROOM_WORLDS, vary, **where, on_note=notes.append)
    return (folder / "table.csv").read_bytes()


def full(folder: Path, most: int) -> Cluster:
    """Return two workers, so many of which are full."""
    return Cluster(workers=2, prepare=functools.partial(fill_first, str(folder), most))


def test_others_do_what_does_not_fit(tmp_path):
    notes: list[str] = []
    table = simulate(tmp_path / "two", full(tmp_path, 1), notes)
    (note,) = notes
    assert "2 worlds do not fit: they need" in note
    assert note.endswith("; the other workers do its share")
    assert table == simulate(tmp_path / "one", None, [])


def test_where_all_are_full_the_batch_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"worlds do not fit: they need"):
        simulate(tmp_path / "out", full(tmp_path, 2), [])
    assert not (tmp_path / "out" / "table.csv").exists()
