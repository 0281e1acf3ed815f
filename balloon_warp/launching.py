"""Launches of kernels, which threads of their own compile for a CPU.

Warp reads its own headers once for each thread that compiles, which takes as long as a kernel of ours. So the first
thread begins with that while meshes are read, and others join it only where many kernels wait.
"""

import os
from collections.abc import Sequence
from concurrent.futures import Future, wait
from threading import Lock
from typing import Any

import warp as wp

from balloon_warp.forks import Threads, hold_in_forks
from balloon_warp.warp_lock import PROCESS_LOCK, running_tiles

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
