"""Temporary files and folders that no kill leaves for long: whoever writes beside them next clears them away.

Each has a lock file beside it. The process that made both holds the lock, and the system lets go of it however that
process ends. So a lock that can be had is of a process that was killed, and its temporaries may go.
"""

import atexit
import errno
import hashlib
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

try:
    import fcntl
except ModuleNotFoundError:  # Windows has none
    fcntl = None

PREFIX, LOCK = ".balloon-warp-", ".partial.lock"
"""Prefix and suffix of the names of lock files"""
MOST_SAID = 4096
"""Largest size of the message of a lock's holder [bytes]"""
OLD_SECONDS = 86400.0
"""Age after which an untouched file counts as left over, where there are no locks [s]"""


@contextmanager
def temporary_in(folder: Path, suffix: str = "") -> Iterator[Path]:
    """Yield a path in a folder at which there is nothing; a file or folder put there goes when the block ends.

    Raises:
        OSError: the folder takes no files.
    """
    lock, descriptor = _new_lock(folder)
    temporary = lock.with_name(f"{_stem(lock)}{suffix}")
    try:
        yield temporary
    finally:
        _remove(temporary)
        os.close(descriptor)
        _remove(lock)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield an empty folder among the system's temporary ones, which goes when the block ends.

    Raises:
        OSError: it cannot be made.
    """
    place = Path(tempfile.gettempdir())
    clear_left_over(place)
    with temporary_in(place) as folder:
        folder.mkdir(0o700)
        yield folder


@cache
def folder_of_process() -> Path:
    """Make a folder among the system's temporary ones, which goes when this process ends.

    Raises:
        OSError: it cannot be made.
    """
    files, process = ExitStack(), os.getpid()
    folder = files.enter_context(scratch_folder())
    atexit.register(lambda: files.close() if os.getpid() == process else None)  # a fork's end is not this one's
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=folder_of_process.cache_clear)
    return folder


def clear_left_over(folder: Path) -> None:
    """Remove the temporaries of killed processes in a folder; those of a living one stay."""
    with suppress(OSError):
        with os.scandir(folder) as entries:
            names = [each.name for each in entries if each.name.startswith(PREFIX) and each.name.endswith(LOCK)]
        for name in names:
            with suppress(OSError):  # somebody else's, or gone meanwhile
                _clear(folder / name)


@contextmanager
def sole_holder(path: Path, said: str) -> Iterator[None]:
    """Hold a file or folder, which need not be there, until the block or this process ends.

    Args:
        path: of it, at the end of links.
        said: message for others who want it.

    Raises:
        BlockingIOError: somebody else holds it; `strerror` is their message.
        OSError: the folder takes no files.
    """
    folder, name = (path, "") if path.is_dir() else (path.parent, path.name)
    stem = hashlib.sha256(os.fsencode(name)).hexdigest()[:8]  # a name may be as long as names can be
    lock = folder / f"{PREFIX}{stem}{LOCK}"
    descriptor = _held(lock)
    try:
        os.truncate(descriptor, 0)
        os.pwrite(descriptor, said.encode(errors="replace"), 0)
        yield
    finally:
        _remove(lock)
        os.close(descriptor)


def _held(lock: Path) -> int:
    """Open a lock file, which is made if it is not there, and hold it.

    Raises:
        BlockingIOError, OSError: as `sole_holder`.
    """
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
        try:
            if _is_held_elsewhere(descriptor):
                said = os.pread(descriptor, MOST_SAID, 0).decode(errors="replace")
                os.close(descriptor)
                raise BlockingIOError(errno.EWOULDBLOCK, said)
        except BlockingIOError:
            raise
        except OSError:  # the file system has no locks
            return descriptor
        if lock.exists() and os.path.samestat(lock.stat(), os.fstat(descriptor)):
            return descriptor
        os.close(descriptor)  # whoever held it before has removed it


def hold(path: Path) -> int | None:
    """Lock a file until its descriptor, which is returned, is closed or this process ends.

    Returns None if somebody has it, or where there are no locks.

    Raises:
        OSError: there is no such file.
    """
    descriptor = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    with suppress(OSError):
        if not _is_held_elsewhere(descriptor):
            return descriptor
    os.close(descriptor)
    return None


def _new_lock(folder: Path) -> tuple[Path, int]:
    """Make a lock file, and hold it."""
    while True:
        # Without any name of an output, which may be as long as names can be.
        lock = folder / f"{PREFIX}{secrets.token_hex(4)}{LOCK}"
        try:
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            continue
        try:
            is_ours = not _is_held_elsewhere(descriptor) and lock.exists()
        except OSError:  # the file system has no locks
            is_ours = True
        if is_ours:
            return lock, descriptor
        os.close(descriptor)  # somebody cleared it away before it was held


def _clear(lock: Path) -> None:
    """Remove a lock file and its temporaries, if its process is gone."""
    descriptor = os.open(lock, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    # The temporary, and files beside it of the library that was writing it.
    beside = [path for path in lock.parent.iterdir() if path.name.startswith(_stem(lock)) and path != lock]
    try:
        try:
            is_left = not _is_held_elsewhere(descriptor)
        except OSError:
            is_left = all(time.time() - _last_touched(path) > OLD_SECONDS for path in (*beside, lock))
        for path in (*beside, lock) if is_left else ():
            _remove(path)
    finally:
        os.close(descriptor)


def _is_held_elsewhere(descriptor: int) -> bool:
    """Take a lock, and return whether that failed because another process, or another place of this one, has it.

    Raises:
        OSError: there are no locks, in this file system or on this machine.
    """
    if fcntl is None:
        raise OSError("no locks")
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def _stem(lock: Path) -> str:
    return lock.name.removesuffix(".lock")


def _remove(path: Path) -> None:
    """Remove a file or folder, as far as that is possible."""
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _last_touched(path: Path) -> float:
    """Return the time of the last write, in seconds since 1970."""
    return max(each.lstat().st_mtime for each in (path, *(path.iterdir() if path.is_dir() else ())))
