"""Threads: simulators and pages side by side, and work that begins ahead; limits of memory; progress of commands."""

import gc
import io
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
import warp as wp
from feature_sets import feature_set
from meshes import quad_sphere
from rich.console import Console
from trajectories import stepped
from typer.testing import CliRunner
from warp._src.apic.capture import APICapture

from balloon_warp import InputError, Simulator, animate, render_stage, run_batch, simulate
from balloon_warp.cli.app import app
from balloon_warp.cli.progress import LINE_SECONDS, SPINNER_SECONDS, Stages
from balloon_warp.kernels import OPTIONS
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model.state import Limit, lowest_limit
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere
from balloon_warp.studio.page.playground import Playground
from balloon_warp.studio.page.session import Session
from balloon_warp.system import warp_setup, warp_threads
from balloon_warp.system import warp_threads as devices
from balloon_warp.system.warp_threads import begin_loading, launch, pick_device

FRAMES, THREADS = 6, 4
QUEUED = "launch", "launch_tiled", "copy", "clone", "empty", "zeros", "full", "capture_launch", "synchronize_event"
"""calls that Warp refuses, or records as well, while another thread records on the same GPU"""


def scene(number: int) -> Scene:
    """Return two scenes in turn, which record other graphs: one iterates until it has converged."""
    return Scene(
        balloon=[Balloon(mesh=quad_sphere(2 + number % 3), position=(0, 1, 0), inflation=Inflation(k_normal=0.2))],
        sphere=[Sphere(position=(0, 3, 0), radius=0.6)] if number % 2 else [],
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
def test_batches_and_pictures_are_made_beside_simulators(device: str, tmp_path: Path):
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
            on_host = name == "numpy" and caller.endswith("frame.py")
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
    found = []
    for few in (2, FRAMES):
        monkeypatch.setattr("balloon_warp.schedules.frames.FEW", few)
        simulator = Simulator(feature_set("bodies"), device="cpu", schedule="gather")
        found.append([stepped(simulator, 1).state.points.numpy().copy() for _ in range(FRAMES)])
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


wp.set_module_options({**OPTIONS, "enable_backward": False})


@wp.kernel(module="unique")
def count(counts: wp.array[wp.int32]):
    counts[wp.tid()] = wp.tid()


@wp.kernel(module="unique")
def add_a_vector(counts: wp.array[wp.int32]):
    counts[wp.tid()] = counts[wp.tid()] + wp.vec3(1.0)  # which Warp refuses


def test_a_kernel_begun_ahead_is_launched():
    counts = wp.zeros(3, dtype=wp.int32, device="cpu")
    kernel: Any = count
    begin_loading(kernel, counts.device)
    warp_threads._begun[kernel.module].result(timeout=60.0)
    assert kernel.module.execs  # compiled, and loaded, without a launch
    launch(kernel, 3, [counts], device=counts.device)
    assert counts.numpy().tolist() == [0, 1, 2]


def test_a_kernel_that_does_not_compile_is_told_at_each_launch():
    counts = wp.zeros(3, dtype=wp.int32, device="cpu")
    begin_loading(add_a_vector, counts.device)
    for _ in range(2):
        with pytest.raises(Exception, match="Couldn't find function overload"):
            launch(add_a_vector, 3, [counts], device=counts.device)


COMPILE_THREE = """
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
import warp as wp
wp.config.optimization_level = 0
from balloon_warp.system.files import folder_of_process
from balloon_warp.system.warp_setup import quiet_warp
quiet_warp()
for number in (float(sys.argv[1]) + part for part in (0.0, 0.25, 0.5)):
    @wp.kernel(module="unique", enable_backward=False)
    def count(a: wp.array(dtype=float)):
        a[wp.tid()] = wp.static(number)
    a = wp.zeros(1, device="cpu")
    wp.launch(count, 1, [a], device="cpu")
assert a.numpy()[0] == number
print(*("found" if each.is_symlink() else "made" for each in folder_of_process().rglob("*.pch")))
"""


@pytest.mark.full
def test_a_process_finds_the_headers_that_another_has_compiled(tmp_path: Path):
    """The first process makes them, the second finds them; one that finds them spoilt makes them again, for others."""
    script = tmp_path / "compile.py"
    script.write_text(COMPILE_THREE)
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path / "cache")}

    def told(number: float) -> str:
        command = [sys.executable, str(script), str(number)]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.strip()

    assert told(2.0) == "made"
    assert told(3.0) == "found"
    (shared,) = (tmp_path / "cache").rglob("*.pch")
    whole = shared.stat().st_size
    shared.write_bytes(b"spoilt")
    assert told(4.0) == "made"
    assert shared.stat().st_size == whole
    assert told(5.0) == "found"
    assert [path.name for path in shared.parent.iterdir()] == [shared.name]


@pytest.fixture
def of_two(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """Yield the stand-in driver of a machine with two GPUs."""
    two = SimpleNamespace(begun=[])

    def get(device: Any, number: int) -> int:
        device._obj.value = number
        return 0 if number < 2 else 101

    two.cuInit, two.cuDeviceGet = lambda _: 0, get
    two.cuDevicePrimaryCtxRetain = lambda _, device: two.begun.append(device.value)
    monkeypatch.setattr(warp_setup.ctypes, "CDLL", lambda _: two)
    warp_setup._begin.cache_clear()
    yield two
    warp_setup._begin.cache_clear()


def begin_driver(device: str | None) -> None:
    """Start the driver and wait until it has begun."""
    warp_setup.begin_driver(device)
    for thread in threading.enumerate():
        if thread.name == "driver":
            thread.join()


WANTED = {None: [0], "cuda": [0], "cuda:0": [0], "cuda:1": [1], "cpu": [], "cuda:2": [], "cuda:x": [], "gpu": []}


@pytest.mark.parametrize(("device", "numbers"), WANTED.items())
def test_the_gpu_that_is_wanted_and_there_begins_once(of_two: SimpleNamespace, device: str | None, numbers: list[int]):
    for name in (device, *(f"cuda:{number}" for number in numbers)):
        begin_driver(name)
    assert of_two.begun == numbers


def test_a_machine_without_a_driver_is_left_alone(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(warp_setup, "LIBRARY", "libnothing.so")
    warp_setup._begin.cache_clear()
    begin_driver(None)
    warp_setup._begin.cache_clear()


GIB = 2**30
OF_VERSION_2 = "memory.max", "memory.current", "inactive_file"
OF_VERSION_1 = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
"""Limit, usage, and what of it is inactive"""


def write(root: Path, path: str, text: str) -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


@pytest.mark.parametrize(
    ("groups", "group", "names"),
    [
        ("0::/job/task", "job/task", OF_VERSION_2),
        ("0::/job/task", "job", OF_VERSION_2),
        # A container sees its own group as the root: the path in the process is the host's, and does not exist.
        ("0::/system.slice/it.scope", "", OF_VERSION_2),
        ("9:cpu,cpuacct:/a\n7:memory:/a\n1:name=systemd:/a\n0::/a", "memory/a", OF_VERSION_1),
    ],
)
def test_a_cgroup_leaves_its_limit_less_what_is_in_use(
    tmp_path: Path, groups: str, group: str, names: tuple[str, str, str]
):
    """Memory of a group of either version, or of one around it; inactive files do not count."""
    folder, (most, used, inactive) = f"sys/fs/cgroup/{group}", names
    write(tmp_path, "proc/self/cgroup", f"{groups}\n")
    write(tmp_path, "sys/fs/cgroup/job/task/memory.max", "max\n")
    write(tmp_path, f"{folder}/{most}", f"{4 * GIB}\n")
    write(tmp_path, f"{folder}/{used}", f"{3 * GIB}\n")
    write(tmp_path, f"{folder}/memory.stat", f"anon {GIB}\n{inactive} {GIB}\nactive_file {GIB}\n")
    assert lowest_limit(tmp_path, {}) == Limit(f"the cgroup's {most}", 2 * GIB)


def test_a_job_of_slurm(tmp_path: Path):
    write(tmp_path, "proc/self/status", f"Name:\tpython3\nVmRSS:\t  {2**19} kB\nThreads:\t1\n")
    node, cpu = {"SLURM_MEM_PER_NODE": "4096"}, {"SLURM_MEM_PER_CPU": "1024", "SLURM_CPUS_ON_NODE": "3"}
    assert lowest_limit(tmp_path, node) == Limit("SLURM_MEM_PER_NODE", 7 * GIB // 2)
    assert lowest_limit(tmp_path, cpu) == Limit("SLURM_MEM_PER_CPU", 5 * GIB // 2)
    assert lowest_limit(tmp_path, node | cpu) == Limit("SLURM_MEM_PER_CPU", 5 * GIB // 2)


def test_what_makes_no_sense_or_asks_for_all_of_a_node_is_no_limit(tmp_path: Path):
    write(tmp_path, "proc/self/cgroup", "0::/a\n")
    write(tmp_path, "sys/fs/cgroup/a/memory.max", "much\n")
    assert lowest_limit(tmp_path, {"SLURM_MEM_PER_NODE": "many", "SLURM_MEM_PER_CPU": "1024"}) is None
    assert lowest_limit(tmp_path, {"SLURM_MEM_PER_NODE": "0"}) is None  # `--mem=0`


@pytest.mark.skipif(sys.platform == "win32", reason="has no ulimit")
@pytest.mark.parametrize(("option", "name"), [("-v", "RLIMIT_AS"), ("-d", "RLIMIT_DATA")])
@pytest.mark.parametrize("command", ["inspect squirrel_inflate", "run squirrel_inflate"])
def test_a_ulimit_without_room_for_the_libraries_is_refused(
    command: str, option: str, name: str, monkeypatch: pytest.MonkeyPatch
):
    """USD ended in a segmentation fault, or waited for ever for a thread that did not start."""
    import resource

    asked, before = getattr(resource, name), resource.getrlimit
    monkeypatch.setattr(resource, "getrlimit", lambda each: (300000 * 1024, -1) if each == asked else before(each))
    said = CliRunner().invoke(app, command.split())
    assert str(said.exception).startswith(f"ulimit {option}: 300000 is less than the libraries take on this machine")
    assert isinstance(said.exception, InputError)
    monkeypatch.setattr(resource, "getrlimit", lambda each: (2**36, 2**36))
    assert CliRunner().invoke(app, ["scenes"]).exit_code == 0


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="has no ulimit")
def test_ulimit_is_said_and_refuses_what_does_not_fit():
    program = """
import resource
import balloon_warp as bw
bw.Simulator("latex_inflate", "cpu")
resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, resource.getrlimit(resource.RLIMIT_AS)[1]))
try:
    bw.Simulator("latex_inflate", "cpu", world_count=1_000_000)
except bw.InputError as refusal:
    print(refusal)
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert "GiB to spare within ulimit -v, enough for" in result.stdout, result.stderr


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


def test_a_terminal_shows_the_stage_that_it_is_at_but_nothing_of_what_is_short(timers: list[Later]):
    shown = io.StringIO()
    short, stages = (Stages("[cow].obj", Console(file=shown, force_terminal=True, width=80)) for _ in range(2))
    short("reading")
    short.end()
    timers[0].come()
    stages("reading")
    stages("checking")
    assert shown.getvalue() == ""
    assert [timer.seconds for timer in timers[1:]] == [SPINNER_SECONDS]  # from the beginning on
    timers[1].come()
    stages("writing")
    stages.end()
    stages("resting")
    assert "[cow].obj: writing" in shown.getvalue()
    assert "reading" not in shown.getvalue()
    assert "resting" not in shown.getvalue()


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
