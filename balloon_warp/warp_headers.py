"""Warp's own headers, compiled once for all processes of a machine.

Warp compiles them in each thread that compiles a kernel, and throws them away with the process: two to three seconds of
a first frame on a CPU. Here a thread begins with files compiled by others, which are kept beside the kernels.
"""

import hashlib
import shutil
import threading
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from balloon_warp.files import clear_left_over, folder_of_process, temporary_in

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
