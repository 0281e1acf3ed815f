"""Warp as it starts: its messages kept off a terminal, its headers compiled once, and a GPU's driver ahead of need.

Warp's own headers, compiled once for all processes of a machine.

Warp compiles them in each thread that compiles a kernel, and throws them away with the process: two to three seconds of
a first frame on a CPU. Here a thread begins with files compiled by others, which are kept beside the kernels.
"""

import ctypes
import hashlib
import os
import re
import shutil
import tempfile
import threading
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from threading import Thread
from typing import Any

from balloon_warp.system.files import clear_left_over, folder_of_process, temporary_in
from balloon_warp.system.process import open_closed_streams, without_garbage_collection

_linked: set[Path] = set()
"""Links of threads to shared files. Warp deletes one that does not fit, and makes a file in its place"""
_shared: set[Path] = set()
"""Files of threads that are shared"""


def share_headers(runtime: Any, kernels: Path, native: Path) -> None:
    """Have Warp's runtime share precompiled headers.

    Args:
        runtime: Warp's own.
        kernels: folder of its kernel cache.
        native: folder of its headers.
    """
    runtime._get_or_create_pch_dir = _folder_of_thread
    if runtime.llvm is not None:
        shared = kernels / f"wp_headers_{_fingerprint(runtime, native)}"  # Warp clears its cache of such names
        runtime.get_clang_pch_dir = partial(_folder_of_clang, shared)


def _folder_of_thread() -> str:
    """Return a thread's folder of precompiled headers. Warp would make one whose megabytes a kill leaves for good."""
    folder = folder_of_process() / f"headers_{threading.get_ident()}"
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder)


def _folder_of_clang(shared: Path) -> str:
    """Return the thread's folder, with links to later files of others, after its own files are shared."""
    folder = Path(_folder_of_thread())
    with suppress(OSError):  # such as a cache that takes no files: the thread has its own
        for made in folder.glob("*.pch"):
            if not made.is_symlink() and made not in _shared:
                _shared.add(made)
                _share(made, shared)
        for made in shared.glob("*.pch"):
            link = folder / made.name
            if link not in _linked | _shared:
                _linked.add(link)
                link.symlink_to(made)
    return str(folder)


def _share(made: Path, shared: Path) -> None:
    """Put precompiled headers whole where other processes find them."""
    shared.mkdir(parents=True, exist_ok=True)
    clear_left_over(shared)
    with temporary_in(shared) as temporary:
        shutil.copyfile(made, temporary)
        temporary.replace(shared / made.name)


def _fingerprint(runtime: Any, native: Path) -> str:
    """Return a name of the headers and the processor; a file's name is of the flags and the level of optimization."""
    found = (native / "builtin.h").stat()
    processor = runtime.llvm.wp_get_host_cpu_name(), runtime.llvm.wp_get_host_cpu_features()
    what = str(native), found.st_mtime_ns, found.st_size, *processor
    return hashlib.sha256(repr(what).encode()).hexdigest()[:16]


@cache
@without_garbage_collection()
def quiet_warp() -> int:
    """Start Warp with only its errors shown: no banner, no word of each kernel compiled, none about a missing GPU.

    Return the process that started it: this one, or one that it was forked from.

    Whoever wants to hear more is heard: this happens once, so that a `warp.config.log_level` that is set afterwards
    stays, and one that asks for more than Warp says by itself (`warp.LOG_DEBUG`) stays anyway.
    """
    import warp as wp

    open_closed_streams()
    if wp.config.log_level >= wp.LOG_INFO:
        wp.config.log_level = max(wp.config.log_level, wp.LOG_ERROR)
    # Warp's native library says on standard error itself, whatever the level, that there is no GPU.
    standard_error = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            wp.init()
        except OSError:  # no home to cache kernels in, as in a locked-down container
            wp.config.kernel_cache_dir = str(folder_of_process() / "kernels")
            wp.init()
        finally:
            os.dup2(standard_error, 2)
            os.close(standard_error)
    clear_left_over(Path(tempfile.gettempdir()))
    from warp._src.context import runtime  # once it is there

    share_headers(runtime, Path(str(wp.config.kernel_cache_dir)), Path(wp.__file__).parent / "native")
    return os.getpid()


LIBRARY = "nvcuda.dll" if os.name == "nt" else "libcuda.so.1"


def begin_driver(device: str | None) -> None:
    """Start the driver and the context of a GPU in a thread, which takes half a second in which no Python runs.

    Warp's own start finds both there, or waits for them. A driver that cannot start is left to Warp, which reports why.

    Args:
        device: a Warp device's name such as "cuda:0"; the first GPU, if missing. A CPU has none to start.
    """
    named = re.fullmatch(r"cuda(?::(\d+))?", device or "cuda")
    if named:
        _begin(int(named[1] or 0))


@cache
def _begin(number: int) -> None:
    Thread(target=_retain_context, args=[number], name="driver").start()


def _retain_context(number: int) -> None:
    """Retain the context until the process ends, as Warp does."""
    try:
        driver = ctypes.CDLL(LIBRARY)
    except OSError:  # no GPU
        return
    device, context = ctypes.c_int(), ctypes.c_void_p()
    if driver.cuInit(0) == 0 and driver.cuDeviceGet(ctypes.byref(device), number) == 0:
        driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)
