"""Work that begins ahead, in threads: compilation of kernels, whose errors reach the launching thread, and the start of
a GPU's driver, only where a GPU is wanted; and precompiled headers that processes share."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.system import warp_setup, warp_threads
from balloon_warp.system.warp_threads import begin_loading, launch

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
