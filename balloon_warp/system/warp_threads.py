"""Warp in use: the choice of a device, threads beside each other, and launches that compile ahead.

While Warp records a graph for a CPU, its native half takes down the calls of the recording thread, but its Python half
keeps the graph that is recorded for the process, and so takes down, or refuses, calls of all other threads meanwhile.
`record_by_thread` makes that one's own affair, too. So simulators on a CPU step in parallel.

Tiles are the exception: Warp compiles one place for them into each module for a CPU, which threads would take from each
other. So one thread at a time runs kernels with tiles, in launches or in replays of graphs that hold some.

A GPU's work is queued in streams that all threads share: there, `lock_of` lets one thread queue or record at a time.

Warp reads its own headers once for each thread that compiles, which takes as long as a kernel of ours. So the first
thread begins with that while meshes are read, and others join it only where many kernels wait.
"""

import ctypes
import gc
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import wraps
from threading import Lock, RLock, local
from typing import Any, ParamSpec, TypeVar
from weakref import WeakSet

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.system.process import Threads, hold_in_forks
from balloon_warp.system.warp_setup import quiet_warp

P = ParamSpec("P")
T = TypeVar("T")
PROCESS_LOCK = RLock()
"""Lock held by the thread that makes a simulator or records a graph"""
_TILES = RLock()
for _lock in (_TILES, PROCESS_LOCK):  # who records takes the one of tiles second
    hold_in_forks(_lock.acquire, _lock.release)
_tiles_of_thread = local()
_with_tiles: WeakSet[Any] = WeakSet()
"""Graphs of a CPU that launch kernels with tiles"""
OF_RECORDING = ("_apic_capture", "_apic_graph")
"""Attributes of Warp's runtime that hold the graph being recorded, or None"""
OF_LAUNCH = ("value_data", "param_array", "adj_param_array", "relocs")
"""Ends of the attributes of Warp's recorder that hold the buffers of the last launch's description"""
NUMBERS = (ctypes.c_float, ctypes.c_int32)
"""Types of arguments that differ from substep to substep, and point to nothing"""


def lock_of(device: wp.Device) -> AbstractContextManager[Any]:
    """Return the lock that a thread holds while it queues or records work on a device; none on a CPU."""
    return PROCESS_LOCK if device.is_cuda else nullcontext()


def locked(method: Callable[P, T]) -> Callable[P, T]:
    """Hold the lock of the model's device while a method of an object with a model runs."""

    @wraps(method)
    def holding(*arguments: P.args, **named: P.kwargs) -> T:
        owner: Any = arguments[0]
        with lock_of(owner.model.device):
            return method(*arguments, **named)

    return holding


@contextmanager
def running_tiles(device: wp.Device) -> Iterator[None]:
    """Launch a kernel with tiles: on a CPU while no other thread does."""
    if not device.is_cpu:
        yield
        return
    _tiles_of_thread.launched = True
    with _TILES:
        yield


def replay(graph: Any, stream: wp.Stream | None = None) -> None:
    """Launch a recorded graph, as `wp.capture_launch` does; on a CPU one with tiles while no other thread runs any."""
    with _TILES if graph in _with_tiles else nullcontext():
        wp.capture_launch(graph, stream=stream)


@contextmanager
def recording(device: wp.Device, stream: wp.Stream | None = None) -> Iterator[wp.ScopedCapture]:
    """Record the work queued on a device, or in one of its streams, as a graph; no other thread records meanwhile.

    Nothing is garbage collected, either: pinned memory that a simulator leaves behind would end a GPU's recording when
    it is freed.
    """
    captured: Any = {"stream": stream} if stream else {"device": device}
    with PROCESS_LOCK, wp.ScopedDevice(device):
        was_enabled = gc.isenabled()
        gc.disable()
        _tiles_of_thread.launched = False
        try:
            with wp.ScopedCapture(**captured) as capture, _remembering():
                yield capture
        finally:
            if was_enabled:
                gc.enable()
        if _tiles_of_thread.launched:
            _with_tiles.add(capture.graph)


@contextmanager
def _remembering() -> Iterator[None]:
    """Let a recording on a CPU look for the pointers in a struct, and describe a launch, once, not in every substep.

    Warp looks through hundreds of arrays, which takes longer than the rest of a launch. Where bytes are the same, so
    are pointers and their targets, as nothing is freed in a recording.
    """
    from warp._src.context import runtime

    recorder: Any = getattr(runtime, OF_RECORDING[0], None)
    names = ("_walk_value_pointers", "build_launch_info")
    if not all(hasattr(recorder, name) for name in names):
        yield
        return
    query, describe = (getattr(recorder, name) for name in names)
    found: dict[tuple[Any, ...], list[Any]] = {}
    described: dict[tuple[Any, ...], tuple[Any, ...]] = {}

    def look_once(kind: Any, value: Any, packed: Any, offset: int, out: list[Any]) -> None:
        if value is None or not hasattr(kind, "vars"):  # no struct
            query(kind, value, packed, offset, out)
            return
        key = kind, offset, bytes(packed)
        if key not in found:
            before = len(out)
            query(kind, value, packed, offset, out)
            found[key] = out[before:]
        else:
            out += found[key]

    def describe_once(
        kernel: Any, module: Any, hooks: Any, params: list[Any], given: Any, adjoint: bool, adj_args: Any = None
    ) -> Any:
        numbers = {} if adjoint else {at: each for at, each in enumerate(params[1:]) if isinstance(each, NUMBERS)}
        key = kernel, module, adjoint, *(bytes(each) for at, each in enumerate(params[1:]) if at not in numbers)
        if key not in described:
            info = describe(kernel, module, hooks, params, given, adjoint, adj_args)
            kept = [getattr(recorder, f"_last_{name}", None) for name in OF_LAUNCH]  # which it has pointers into
            if None in kept[:2]:
                return info
            described[key] = info, kept
        info, (values, records, *_) = described[key]
        for at, each in numbers.items():
            place = ctypes.byref(values, records[at].value_offset)
            ctypes.memmove(place, ctypes.byref(each), records[at].value_size)
        return info

    recorder._walk_value_pointers, recorder.build_launch_info = look_once, describe_once
    try:
        yield
    finally:
        for name in names:
            delattr(recorder, name)


class _OfThread:
    """A thread-local attribute; None until it is set."""

    def __init__(self) -> None:
        self._own = local()

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        return getattr(self._own, "value", None)

    def __set__(self, instance: object, value: Any) -> None:
        self._own.value = value


def record_by_thread() -> None:
    """Make each thread record for itself, once Warp has started.

    A Warp without such attributes is left alone.
    """
    from warp._src.context import runtime

    for name in OF_RECORDING:
        if name in vars(runtime) and name not in vars(type(runtime)):
            setattr(type(runtime), name, _OfThread())


MOST_THREADS = 4
_FIRST = Threads(1, "compiler")
_OTHERS = Threads(max(1, min(os.cpu_count() or 1, MOST_THREADS) - 1), "compiler beside")
_begun: dict[Any, Future[Any]] = {}
"""Compilations in progress, by module"""
_of_first: list[Future[Any]] = []
"""Compilations that the first thread has to do"""
_beginning = Lock()


def begin_loading(kernel: Any, device: wp.Device) -> None:
    """Compile a kernel, and all others of its module, or load them, while whoever calls goes on.

    It should be one that is launched for sure: a process does not end before it is compiled. A GPU's are left to the
    first launch.
    """
    if not device.is_cpu or kernel.module in _begun:
        return
    with _beginning:
        if kernel.module not in _begun:
            _of_first[:] = [begun for begun in _of_first if not begun.done()]
            is_first = len(_of_first) < 2
            begun = (_FIRST if is_first else _OTHERS).submit(wp.load_module, kernel.module, device=device)
            _begun[kernel.module] = begun
            if is_first:
                _of_first.append(begun)


def launch(
    kernel: Any,
    dim: int | Sequence[int],
    inputs: Sequence[Any],
    outputs: Sequence[Any] = (),
    *,
    device: wp.Device,
    block_dim: int | None = None,
) -> None:
    """Launch a kernel, as `wp.launch` does."""
    _load(kernel, device)
    wp.launch(kernel, dim, inputs, outputs, device=device, block_dim=block_dim)


def launch_tiled(
    kernel: Any,
    dim: int | Sequence[int],
    inputs: Sequence[Any],
    outputs: Sequence[Any] = (),
    *,
    device: wp.Device,
    block_dim: int,
) -> None:
    """Launch a tiled kernel, as `wp.launch_tiled` does."""
    _load(kernel, device)
    with running_tiles(device):
        wp.launch_tiled(kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, block_dim=block_dim)


def _load(kernel: Any, device: wp.Device) -> None:
    begin_loading(kernel, device)
    begun = _begun.get(kernel.module)
    if begun:
        begun.result()


def _finish_loading() -> None:
    """Wait until no kernel is being compiled, and let no other thread begin: a forked child could not end it."""
    PROCESS_LOCK.acquire()  # first, as whoever makes a simulator does
    _beginning.acquire()
    wait(_begun.values())


def _go_on() -> None:
    _beginning.release()
    PROCESS_LOCK.release()


hold_in_forks(_finish_loading, _go_on)


def pick_device(name: str | wp.Device | None) -> wp.Device:
    """Return the device of that name, such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU. Starts Warp.

    Raises:
        InputError: there is no such device, or it is a GPU and this process a fork.
    """
    with PROCESS_LOCK:
        started_by = quiet_warp()
        record_by_thread()
    try:
        device = wp.get_device(name) if name else wp.get_preferred_device()
    except (ValueError, TypeError, AttributeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"device {name}: no such device; this machine has {known}") from None
    if device.is_cuda and started_by != os.getpid():
        raise InputError(
            f"{device}: this process was forked from one that uses the GPU, and CUDA works in no fork; "
            'start it with multiprocessing.get_context("spawn"), or choose device="cpu"'
        )
    return device
