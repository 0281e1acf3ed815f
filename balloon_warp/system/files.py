"""Files that appear whole or not at all, in places that are ours; leftovers of killed processes are removed.

Marks by which the program knows the files that it made.

A stage has its mark in its metadata, a scene in its first line, with a hash of the others, a folder in its manifest,
and any other file, such as a picture, in a comment at its begin.

Temporary files and folders that no kill leaves for long: whoever writes beside them next clears them away.

Each has a lock file beside it. The process that made both holds the lock, and the system lets go of it however that
process ends. So a lock that can be had is of a process that was killed, and its temporaries may go.
"""

import atexit
import errno
import hashlib
import json
import os
import platform
import secrets
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from stat import S_ISREG
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import InputError

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngInfo


PROGRAM = "Balloon Warp"
LINE = f"Written by {PROGRAM}"
"""Comment at the begin of a text file"""
MANIFEST = {"written_by": PROGRAM}
"""Entry of a folder's manifest, as JSON"""
STAGE_KEY = "balloonWarp"
"""Key in the `customLayerData` of a stage"""
STAGES = (".usd", ".usda", ".usdc")
HEAD_BYTES = 1024
"""Largest size of a file's head up to the end of its mark [bytes]"""


def is_ours(path: Path) -> bool:
    """Return whether a file has our mark, and, if it is a scene, nobody edited it since."""
    try:
        if path.suffix.lower() in STAGES:
            return path.is_file() and _is_our_stage(path)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
            return _is_unedited(head + file.read()) if path.suffix.lower() == ".toml" else PROGRAM.encode() in head
    except OSError:
        return False


def marked_scene(text: str) -> str:
    """Return the text of a scene's file, behind a line by which `is_ours` sees whether it was edited."""
    return f"{_first_line(text.encode())}\n{text}"


def png_mark() -> "PngInfo":
    """Return the mark of a PNG file, as Pillow's `save` takes it for `pnginfo`."""
    from PIL.PngImagePlugin import PngInfo  # only where there is a picture

    mark = PngInfo()
    mark.add_text("Software", PROGRAM)
    return mark


def manifest_text(manifest: Mapping[str, Any]) -> str:
    """Return the text of a folder's manifest, with its mark."""
    return json.dumps({**MANIFEST, **manifest}, indent=1) + "\n"


def without_mark(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a manifest that was read, without its mark."""
    return {name: value for name, value in manifest.items() if name not in MANIFEST}


def _is_our_stage(path: Path) -> bool:
    from pxr import Sdf, Tf  # loads USD: only where a stage is in the way

    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and STAGE_KEY in layer.customLayerData


def _first_line(below: bytes) -> str:
    return f"# {LINE}, which may replace this file until it is edited: {hashlib.sha256(below).hexdigest()[:16]}"


def _is_unedited(content: bytes) -> bool:
    first, _, below = content.partition(b"\n")
    return first == _first_line(below).encode()


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


LARGEST_FILE = 1 << 30
"""Largest size of a file that is read whole [bytes]"""
MOST_LINKS = 40
"""Largest number of symbolic links in a chain, as Linux follows them"""
STAGE, PICTURES = ".usdc", (".png", ".webp", ".gif", ".mp4")


def legible(name: str) -> str:
    """Write a file's name with _ for bytes that are no Unicode, for USD and JSON: names are bytes, of any encoding."""
    return "".join("_" if "\ud800" <= letter <= "\udfff" else letter for letter in name)


def check_writable(path: Path, suffixes: tuple[str, ...]) -> None:
    """Make sure, before any work is done, that an output can be written.

    Raises:
        InputError: the suffix is not one of `suffixes`, or the folder is missing or cannot be written to.
    """
    if path.suffix.lower() not in suffixes:
        is_picture = path.suffix.lower() in PICTURES and STAGE in suffixes
        raise InputError(
            f"{path}: cannot write {path.suffix or 'a file without a suffix'}; expected {', '.join(suffixes)}"
            + ("; `balloon-warp render` renders pictures and films" if is_picture else "")
        )
    try:
        target = target_of(path)
        _check_name(path)
        _check_name(target, path)
        if not target.parent.is_dir():
            raise InputError(f"{path}: the folder {target.parent} does not exist")
        if target.is_dir():
            raise InputError(f"{path}: is a folder; expected a file name")
        clear_left_over(target.parent)
        # Only trying tells: a folder may let the superuser in and still take no files.
        with temporary_in(target.parent, path.suffix) as probe:
            probe.touch(exist_ok=False)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _check_name(path: Path, given: Path | None = None) -> None:
    """Make sure that USD takes the name of an output.

    Args:
        given: the link that leads there.

    Raises:
        InputError: it does not.
    """
    said = legible(str(given or path))
    if legible(str(path.absolute())) != str(path.absolute()):
        raise InputError(f"{said}: the path is not UTF-8; expected one that is, with -o")
    if ":SDF_FORMAT_ARGS:" in str(path):
        raise InputError(f"{said}: USD reads :SDF_FORMAT_ARGS: as the start of options; expected a name without it")


def check_regular(path: Path, most: int = LARGEST_FILE) -> None:
    """Make sure that a file may be read whole: that it is none that waits, such as a pipe, and none without an end.

    Raises:
        InputError: it is missing, no regular file, or has more bytes than `most`.
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:  # too long for a name, or with a zero in it
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not S_ISREG(found.st_mode):
        raise InputError(f"{path}: is not a regular file")
    if found.st_size > most:
        raise InputError(f"{path}: has {found.st_size:,} bytes; expected at most {most:,}")


def regular_content(path: Path, most: int = LARGEST_FILE) -> bytes:
    """Return the content of a regular file of no more than so many bytes.

    Raises:
        InputError: it cannot be read, or as `check_regular`.
    """
    check_regular(path, most)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def target_of(path: Path) -> Path:
    """Follow links, and return where a file or folder is, or would be: a file written there leaves the links.

    Raises:
        InputError: the links lead in a circle, or to something that is no file, such as a device.
    """
    target = path
    for _ in range(MOST_LINKS):
        if not target.is_symlink():
            break
        target = target.parent / target.readlink()
    else:
        raise InputError(f"{path}: is a circular link; expected a link to a file")
    if target.exists() and not target.is_file() and not target.is_dir():
        raise InputError(f"{path}: {target} is neither a file nor a folder; expected a file name")
    return target


def file_behind(path: Path) -> Path:
    """Return the file that a link leads to, beside which the files that it names lie.

    It is the link itself, where the file has another suffix, as in stores that call files by their content.
    """
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    return target if target.suffix.lower() == path.suffix.lower() else path


def is_same_file(one: Path, other: Path) -> bool:
    """Return whether two paths lead to the same file, which need not be there."""
    return os.path.realpath(one) == os.path.realpath(other)


def whole_path(path: Path) -> Path:
    """Return a path from the root on, with all folders as they are, and the file's own name, even if it is a link."""
    return Path(os.path.realpath(path.parent), path.name)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`, of the same suffix, that takes its place when the block ends well.

    It is on the disk before it takes the place, so that a crash of the machine leaves a good file, too. Where `path` is
    a link, the place is where that leads.

    Raises:
        InputError: the block, or the end of it, failed to write the file.
    """
    own = None
    try:
        target = target_of(path)
        with temporary_in(target.parent, path.suffix) as temporary:
            own = temporary
            yield temporary
            _flush(temporary)
            os.replace(temporary, target)
            with suppress(OSError):  # not every file system can flush; the file is in its place
                _flush(target.parent)
    except OSError as error:
        if own is not None and error.filename is not None and Path(error.filename) != own:
            raise  # another file's
        reason = error.strerror or str(error).partition("\n")[0]
        raise InputError(f"{path}: cannot be written: {reason}") from error
    except RuntimeError as error:
        if not _is_from_usd(error):
            raise
        raise InputError(f"{path}: cannot be written: USD failed to save it; is the disk full?") from error


@contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """Yield an empty hidden folder where an output goes, which goes itself when the block ends.

    Raises:
        InputError: it cannot be made.
    """
    with ExitStack() as files:
        try:
            folder = files.enter_context(temporary_in(target_of(path).parent))
            folder.mkdir()
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        yield folder


def _flush(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _is_from_usd(error: RuntimeError) -> bool:
    from pxr import Tf  # loads USD: only once something failed

    return isinstance(error, Tf.ErrorException)


_replaces_any: ContextVar[bool] = ContextVar("replaces_any", default=False)
"""Whether `--force` is said"""
_held_targets: ContextVar[frozenset[Path]] = ContextVar("held", default=frozenset())
"""Outputs that this thread is the only writer of"""


@contextmanager
def replacing_any(wanted: bool = True) -> Iterator[None]:
    """Replace in a `with` block whatever stands in the place of an output, as `--force` does, if that is wanted."""
    before = _replaces_any.set(wanted)
    try:
        yield
    finally:
        _replaces_any.reset(before)


def replaces_any() -> bool:
    """Return whether any file may be replaced."""
    return _replaces_any.get()


def require_ours(path: Path, what: str = "an output goes") -> None:
    """Make sure that a file which nobody named as the output is not there, or is ours to replace.

    Args:
        what: subject and verb, as in "the materials of ball.obj go".

    Raises:
        InputError: somebody else made it, or edited it since.
    """
    if path.exists() and not replaces_any() and not is_ours(path):
        who = "somebody wrote or edited it" if path.suffix.lower() == ".toml" else "another program wrote it"
        raise InputError(f"{path}: {who}, and {what} there; expected another name, with -o, or --force to replace it")


def require_same(path: Path, data: bytes) -> bool:
    """Return whether a file, whose name follows from its content, is there; otherwise it may be written.

    Raises:
        InputError: there is something else, which somebody made.
        OSError: it cannot be read.
    """
    if not path.exists():
        return False
    if path.is_file() and path.read_bytes() == data:
        return True
    if replaces_any():
        return False
    raise InputError(f"{path}: was edited; expected another name of the output, with -o, or --force to replace it")


def require_ours_in(folder: Path, names: Iterable[str], manifests: Iterable[str]) -> None:
    """Make sure that files of these names in a folder are not there, or are ours to replace.

    Args:
        manifests: names of files in it, of which one of ours tells that the others are, too.

    Raises:
        InputError: somebody else made one.
    """
    if replaces_any() or any(is_ours(folder / name) for name in manifests):
        return
    for name in names:
        if (path := folder / name).exists():
            raise InputError(
                f"{path}: another program wrote it, and an output goes there; expected another folder, or --force to "
                "replace such files"
            )


@contextmanager
def sole_writer(*outputs: Path | None) -> Iterator[None]:
    """Keep other processes and threads from writing some outputs, files or folders, in a `with` block.

    None is no output. This thread may hold again an output that it holds already, as a run that renders its picture.

    Raises:
        InputError: somebody else writes one; the message says who.
    """
    targets = {target_of(output): output for output in outputs if output}
    with ExitStack() as holds:
        for target in targets.keys() - _held_targets.get():
            try:
                holds.enter_context(sole_holder(target, _this_process()))
            except BlockingIOError as held:
                raise InputError(
                    f"{targets[target]}: {held.strerror or 'another process'} is writing it; wait for its end, or give "
                    "another name, with -o"
                ) from None
            except OSError:
                continue  # it will be told by whoever writes there
        before = _held_targets.set(_held_targets.get() | targets.keys())
        try:
            yield
        finally:
            _held_targets.reset(before)


def _this_process() -> str:
    """Return who this is, as another process tells its user."""
    program = Path(sys.argv[0]).name.replace("__main__.py", "balloon-warp") if sys.argv else ""
    command = shlex.join([program, *sys.argv[1:]]) if program else "Python"
    return f"process {os.getpid()} on {platform.node()} ({command[:200]}), since {time.strftime('%H:%M:%S')},"


def require_no_inputs(outputs: Iterable[Path | None], inputs: Mapping[Path, str]) -> None:
    """Make sure that none of the outputs is an input.

    Args:
        outputs: None is no output.
        inputs: the role of each, as "the scene's mesh".

    Raises:
        InputError: one is.
    """
    read = {os.path.realpath(path): what for path, what in inputs.items()}
    for output in outputs:
        if output and (what := read.get(os.path.realpath(output))):
            raise InputError(f"{output}: is {what}; expected another name, with -o")
