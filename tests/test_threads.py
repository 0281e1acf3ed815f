"""Simulators and pages in threads of their own, side by side: the bytes are those of one after the other."""

import gc
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from warp._src.apic.capture import APICapture

from balloon_warp import InputError, Simulator, animate, render_stage, run_batch, simulate
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene, Sphere
from balloon_warp.studio.page.playground import Playground
from balloon_warp.studio.page.session import Session
from balloon_warp.system import warp_threads
from balloon_warp.system import warp_threads as devices
from balloon_warp.system.warp_threads import pick_device

FRAMES, THREADS = 6, 4
QUEUED = "launch", "launch_tiled", "copy", "clone", "empty", "zeros", "full", "capture_launch", "synchronize_event"
"""calls that Warp refuses, or records as well, while another thread records on the same GPU"""

TURNS = Obstacle(
    size=(4, 0.2, 4), position=(0, -0.1, 0), motion=[(0, (0, 0, 0), (0, 0, 0)), (1, (0, 1, 0), (0, 90, 0))]
)


def scene(number: int) -> Scene:
    """Return two scenes in turn, which record other graphs: one iterates until it has converged."""
    return Scene(
        balloon=[Balloon(mesh=quad_sphere(2 + number % 3), position=(0, 1, 0), inflation=Inflation(k_normal=0.2))],
        sphere=[Sphere(position=(0, 3, 0), radius=0.2)] if number % 2 else [],
        ground=Ground(),
        frames=FRAMES,
        substeps=20,
        solver="symplectic_euler" if number % 3 else "projective",
    )


def points_of(simulator: Simulator) -> bytes:
    return b"".join(np.concatenate(frame.points).tobytes() for frame in simulator.run())


def simulated(number: int, device: str) -> bytes:
    """Return the points of a run, made and stepped in the calling thread."""
    return points_of(Simulator(scene(number), device=device))


@pytest.mark.full
def test_simulators_in_threads_give_the_bytes_of_one_after_the_other(device: str):
    expected = [simulated(number, device) for number in range(8)]
    for _ in range(2):
        with ThreadPoolExecutor(THREADS) as threads:
            assert list(threads.map(simulated, range(8), [device] * 8)) == expected


@pytest.mark.full
def test_one_thread_at_a_time_runs_kernels_with_tiles(monkeypatch: pytest.MonkeyPatch):
    """No two threads launch kernels with tiles, or replay graphs of such, at once on a CPU: it has one place for tiles.

    They crashed in one of three runs of 8 simulators over 300 frames."""
    inside: list[str] = []
    beside: set[int] = set()

    def watched(name: str) -> Any:
        original = getattr(wp, name)

        def launched(*arguments: Any, **named: Any) -> Any:
            inside.append(name)
            time.sleep(1e-3)  # others come meanwhile
            beside.add(len(inside))
            try:
                return original(*arguments, **named)
            finally:
                inside.pop()

        return launched

    def advanced(number: int) -> bytes:
        simulator = Simulator(scene(4), "cpu", schedule="gather")
        for _ in range(FRAMES):  # the last of them are replayed
            simulator.advance()
        return simulator.state.points.numpy().tobytes()

    expected = advanced(0)
    for name in ("launch_tiled", "capture_launch"):
        monkeypatch.setattr(wp, name, watched(name))
    with ThreadPoolExecutor(THREADS) as threads:
        assert set(threads.map(advanced, range(THREADS))) == {expected}
    assert beside == {1}


@pytest.mark.full
def test_simulators_made_before_step_beside_each_other(device: str):
    """First steps record at about the same time, and give the same bytes."""
    expected = [simulated(number, device) for number in range(6)]
    simulators = [Simulator(scene(number), device=device) for number in range(6)]
    with ThreadPoolExecutor(THREADS) as threads:
        assert list(threads.map(points_of, simulators)) == expected


@pytest.mark.full
def test_batches_and_pictures_are_made_beside_simulators(device: str, tmp_path: Path):
    """A batch records its measures, and a picture launches its rays."""
    stage = tmp_path / "still.usdc"
    animate(scene(1), stage, device=device)
    run_batch(scene(1), tmp_path / "before", 3, {"gravity": [1.0, 5.0, 9.0]}, device=device)
    render_stage(stage, tmp_path / "before.png", size=(64, 36), device=device)
    expected = simulated(2, device)
    with ThreadPoolExecutor(THREADS) as threads:
        batch = threads.submit(run_batch, scene(1), tmp_path / "after", 3, {"gravity": [1.0, 5.0, 9.0]}, device=device)
        steps = [threads.submit(simulated, 2, device) for _ in range(6)]
        picture = threads.submit(render_stage, stage, tmp_path / "after.png", size=(64, 36), device=device)
        assert [each.result() for each in steps] == [expected] * 6
        batch.result()
        picture.result()
    assert (tmp_path / "after" / "table.npz").read_bytes() == (tmp_path / "before" / "table.npz").read_bytes()
    assert (tmp_path / "after.png").read_bytes() == (tmp_path / "before.png").read_bytes()


@pytest.mark.full
def test_whatever_is_queued_takes_its_turn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """A CPU stands in for a GPU, where one thread's launch would be recorded by another."""
    untaken = []

    def watch(owner: Any, name: str) -> None:
        queued = getattr(owner, name)

        def watched(*arguments: Any, **named: Any) -> Any:
            caller = sys._getframe(1).f_code.co_filename
            on_host = name == "numpy" and caller.endswith("frame_reader.py")
            if "unlocked" in repr(warp_threads.PROCESS_LOCK) and not on_host:
                untaken.append(f"{name} in {caller}")
            return queued(*arguments, **named)

        monkeypatch.setattr(owner, name, watched)

    monkeypatch.setattr(warp_threads, "nullcontext", lambda: warp_threads.PROCESS_LOCK)
    for name in QUEUED:
        watch(wp, name)
    for name in ("numpy", "assign", "fill_", "zero_"):
        watch(wp.array, name)
    for number in range(3):
        simulated(number, "cpu")
    simulate(scene(1), device="cpu")
    animate(scene(1), tmp_path / "still.usdc", device="cpu")
    render_stage(tmp_path / "still.usdc", tmp_path / "still.png", size=(64, 36), device="cpu")
    run_batch(scene(1), tmp_path / "batch", 3, {"gravity": [1.0, 5.0, 9.0]}, device="cpu")
    assert not untaken


class Forgotten:
    """Pinned memory, if a GPU is there, in a cycle that only the garbage collector finds."""

    def __init__(self, device: str):
        self.array = wp.zeros(1000, device="cpu", pinned=wp.get_device(device).is_cuda)
        self.itself = self


def test_garbage_is_not_freed_while_a_frame_is_recorded(device: str):
    """Garbage collection is paused while a frame is recorded: freeing pinned memory ends a GPU's recording."""
    found: list[str] = []

    def watch(phase: str, info: dict[str, int]) -> None:
        if "unlocked" not in repr(warp_threads.PROCESS_LOCK) and wp.get_device(device).is_capturing:
            found.append(phase)

    expected, thresholds = simulated(1, device), gc.get_threshold()
    gc.callbacks.append(watch)
    gc.set_threshold(1)
    try:
        for _ in range(10):
            Forgotten(device)
            with warp_threads.recording(wp.get_device(device)):
                assert len([[] for _ in range(100)]) == 100  # which would set off the search
        assert simulated(1, device) == expected
    finally:
        gc.set_threshold(*thresholds)
        gc.callbacks.remove(watch)
    assert not found


def test_a_recording_describes_a_launch_once_and_replays_the_numbers_of_each(monkeypatch: pytest.MonkeyPatch):
    """A CPU describes a kernel by its arrays, of which a substep swaps two, and takes its time in the frame from each
    substep: the bytes are those of a run that records nothing."""
    described: list[str] = []
    describe = APICapture.build_launch_info

    def counted(recorder: APICapture, kernel: wp.Kernel, *given: Any, **named: Any) -> Any:
        described.append(kernel.key)
        return describe(recorder, kernel, *given, **named)

    monkeypatch.setattr(APICapture, "build_launch_info", counted)
    moving = scene(1).model_copy(update={"obstacle": [TURNS]})
    found = []
    for few in (2, FRAMES):
        monkeypatch.setattr("balloon_warp.schedules.frames.FEW", few)
        simulator = Simulator(moving, device="cpu", schedule="gather")
        found.append([np.concatenate(frame.points) for frame in simulator.run()])
    np.testing.assert_array_equal(*found)
    assert 0 < len(described) <= 3 * len(set(described))


def test_what_somebody_else_records_is_left_alone(device: str):
    """A graph of the user's own, recorded while a simulator steps in another thread, has the user's launches alone."""
    simulator = Simulator(scene(1), device=device)
    if wp.get_device(device).is_cuda:
        pytest.skip("there, all threads share a stream: the user's own recording has to take its turn")
    own = wp.zeros(8, dtype=float, device=device)
    with ThreadPoolExecutor(1) as thread:
        stepped = thread.submit(lambda: [simulator.step() for _ in range(FRAMES)])
        with wp.ScopedCapture(device) as capture:
            own.fill_(2.0)
        stepped.result()
    own.zero_()
    wp.capture_launch(capture.graph)
    assert own.numpy().tolist() == [2.0] * 8


def test_a_gpu_in_a_fork_is_refused(monkeypatch: pytest.MonkeyPatch):
    """CUDA does not work in a fork of a process that has started it: a sentence says so before CUDA's error does."""
    assert pick_device("cpu").is_cpu
    monkeypatch.setattr(devices, "quiet_warp", lambda: os.getpid() + 1)
    monkeypatch.setattr(wp, "get_device", lambda name: SimpleNamespace(is_cuda=name != "cpu"))
    assert not pick_device("cpu").is_cuda
    with pytest.raises(InputError, match=r'forked .* multiprocessing.get_context\("spawn"\), or choose device="cpu"'):
        pick_device("cuda:0")


STILL = Scene(balloon=[Balloon(mesh=quad_sphere(2))], frames=8)


def wait_for(frame: int, *sessions: Session) -> None:
    """Wait until all sessions have reached a frame, a minute at most."""
    until = time.perf_counter() + 60.0
    while min(session.playground.frame for session in sessions) < frame and time.perf_counter() < until:
        time.sleep(0.01)


def test_sessions_and_a_simulator_step_beside_each_other(tmp_path: Path):
    alone = [frame.points[0].tobytes() for frame in Simulator(STILL, "cpu").run()]
    sessions = [Session(name, STILL, "cpu", tmp_path) for name in ("one", "other")]
    for session in sessions:
        session.watched = True
        session.start()
    assert [frame.points[0].tobytes() for frame in Simulator(STILL, "cpu").run()] == alone
    wait_for(5, *sessions)
    for session in sessions:
        session.stop()
    assert all(session.playground.frame >= 5 and not session.trouble for session in sessions)


def test_a_simulation_that_fails_says_so_and_can_begin_anew(monkeypatch, capfd, tmp_path: Path):
    step = Playground.step

    def failing_step(playground: Playground, *_given: Any) -> None:
        raise RuntimeError("no such device any more")

    monkeypatch.setattr(Playground, "step", failing_step)
    session = Session("one", STILL, "cpu", tmp_path)
    session.watched = True
    session.start()
    until = time.perf_counter() + 60.0
    while not session.picture.trouble and time.perf_counter() < until:
        time.sleep(0.01)
    assert session.picture.trouble == "The simulation failed; the terminal has the error. Reset restarts it."
    assert not session.picture.running
    monkeypatch.setattr(Playground, "step", step)
    session.reset()
    wait_for(3, session)
    session.stop()
    assert session.playground.frame >= 3
    assert not session.trouble
    assert capfd.readouterr().err.count("RuntimeError: no such device any more") == 1
