"""Files that appear whole or not at all, in places that are ours, and arrays in them: decimal text, .npz, HDF5.

Marks: a stage has its mark in its metadata, a scene in its first line, with a hash of the others, a folder in its
manifest, and any other file, such as a picture, in a comment at its begin.

Temporary files and folders: no kill leaves them for long, since whoever writes beside them next clears them away. Each
has a lock file beside it. The process that made both holds the lock, and the system lets go of it however that process
ends. So a lock that can be had is of a process that was killed, and its temporaries may go.

Many float32 as decimal text at once: the text that `"%.9g" % value` gives, and so the same number when it is read.

A number x of the decimal exponent e has the nine digits round(x 10^(8 - e)). In float64 that power is exact where e is
from `LEAST` to `MOST`, and the product is rounded once, by less than 1e-7: only next to a half could that change a
digit. Such numbers, and those of other exponents, are written one by one.
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
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from pathlib import Path
from stat import S_ISREG
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError

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


WIDTH = 15
"""Largest number of characters of a number"""
PAD = 0xFF
"""Padding: a byte that no text has"""
LEAST, MOST = -14, 30
"""Decimal exponents whose powers of ten, 10^22 at most, float64 has exactly"""
_POINT, _NOUGHT, _E, _SIGN_OF_EXPONENT, _TENS, _UNITS, _NOTHING, _SIGN = range(9, 17)
"""Places behind the nine digits of a number, in the row that its characters are taken from"""


def decimals(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the text of each number as ASCII, with `PAD` wherever nothing stands, shape (*values.shape, WIDTH)."""
    flat = np.ascontiguousarray(values, dtype=np.float32).reshape(-1)
    bits = flat.view(np.uint32)
    with np.errstate(invalid="ignore"):  # a NaN
        size = np.abs(flat).astype(np.float64)
    index = _INDEX_OF_POWER[(bits >> 23) & 0xFF]
    index += size >= _NEXT_TENS[index]
    nought = size == 0.0
    alone = ((index == 0) | (index == len(_NEXT_TENS) - 1)) & ~nought
    size[alone] = 0.0
    scaled = size * _FACTORS[index] / _DIVISORS[index]
    alone |= np.abs(scaled - np.floor(scaled) - 0.5) < 1e-6
    digits = np.rint(scaled).astype(np.uint32)
    carried = digits == 10**9
    digits[carried] = 10**8
    text = _lay_out(digits, np.where(nought | alone, 0, index + (LEAST - 1) + carried), bits >> 31)
    for number in np.flatnonzero(alone).tolist():
        word = b"%.9g" % flat[number]
        text[number] = PAD
        text[number, : len(word)] = np.frombuffer(word, dtype=np.uint8)
    return text.reshape(*values.shape, WIDTH)


def _lay_out(digits: NDArray[np.uint32], exponent: NDArray[np.int64], sign: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return Args: nine digits as one number, the exponent of the first, and 1 for a minus; each of shape (N,)."""
    high, rest = np.divmod(digits, np.uint32(10**6))
    middle, low = np.divmod(rest, np.uint32(1000))
    characters = np.empty((len(digits), 17), dtype=np.uint8)
    for begin, three in ((0, high), (3, middle), (6, low)):
        characters[:, begin : begin + 3] = _TRIPLES[three]
    characters[:, _POINT : _NOTHING + 1] = _BEHIND[exponent - LEAST]
    characters[:, _SIGN] = _SIGNS[sign]
    noughts = _NOUGHTS[low]
    noughts += (noughts == 3) * _NOUGHTS[middle]
    noughts += (noughts == 6) * _NOUGHTS[high]
    places = _LAYOUTS[exponent - LEAST, 9 - noughts]
    return characters.reshape(-1)[places + 17 * np.arange(len(digits))[:, None]]


def _layout(exponent: int, count: int) -> list[int]:
    """Return the place in its row of each character of a number.

    Args:
        count: Number of its digits, without trailing zeros.
    """
    figures = list(range(count))
    if exponent < -4 or exponent > 8:
        power = [_E, _SIGN_OF_EXPONENT, _TENS, _UNITS]
        places = [*figures[:1], *([_POINT] if count > 1 else []), *figures[1:], *power]
    elif exponent < 0:
        places = [_NOUGHT, _POINT, *[_NOUGHT] * (-exponent - 1), *figures]
    else:
        whole = [*figures, *[_NOUGHT] * 9][: exponent + 1]
        after = figures[exponent + 1 :]
        places = [*whole, *([_POINT] if after else []), *after]
    return [_SIGN, *places, *[_NOTHING] * WIDTH][:WIDTH]


_EXPONENTS = range(LEAST, MOST + 2)
"""Exponents of numbers that are laid out: one that is rounded up to a power of ten has the next one"""
_TRIPLES = np.array([list(b"%03d" % number) for number in range(1000)], dtype=np.uint8)
_NOUGHTS = np.array([3 - len((b"%03d" % number).rstrip(b"0")) for number in range(1000)], dtype=np.int64)
"""Trailing zeros of three digits"""
_BEHIND = np.array([[*b".0e", *(b"%+03d" % exponent), PAD] for exponent in _EXPONENTS], dtype=np.uint8)
_SIGNS = np.array([PAD, ord("-")], dtype=np.uint8)
_LAYOUTS = np.array([[_layout(exponent, count) for count in range(10)] for exponent in _EXPONENTS])
_INDEXED = range(LEAST - 1, MOST + 2)
"""Exponents by their index in the tables below: at both ends, all that are beyond"""
_FACTORS = np.array([10.0 ** max(8 - exponent, 0) for exponent in _INDEXED])
_DIVISORS = np.array([10.0 ** max(exponent - 8, 0) for exponent in _INDEXED])
_NEXT_TENS = np.array([*(float(f"1e{exponent + 1}") for exponent in _INDEXED[:-1]), np.nan])
"""Number from which on the exponent is one more; nothing is behind the last"""
_INDEX_OF_POWER = np.array(
    [min(max(int(np.floor(np.log10(2.0) * (power - 127))), _INDEXED[0]), _INDEXED[-1]) for power in range(256)]
) - (LEAST - 1)
"""Index of each power of two that a float32 is at least; its own may be one more"""


def write_npz(path: Path, arrays: Iterable[tuple[str, NDArray]], level: int = 0) -> None:
    """Write named arrays as they come; the same arrays give the same bytes.

    Args:
        level: of compression, 1 to 9, or 0 for none.
    """
    with zipfile.ZipFile(
        path, "w", zipfile.ZIP_DEFLATED if level else zipfile.ZIP_STORED, compresslevel=level
    ) as archive:
        for name, array in arrays:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                if array.flags.c_contiguous and array.ndim and not array.dtype.hasobject:
                    np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(array))
                    file.write(array.data.cast("B") if array.size else b"")  # in one piece, without a copy
                else:
                    np.lib.format.write_array(file, array, allow_pickle=False)


PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""Options of h5py by which arrays are compressed, without loss, as every reader of HDF5 knows it"""


def require_h5py() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("h5py")
    except ImportError:
        raise MissingExtraError("an .h5 needs h5py: pip install 'balloon-warp[data]'") from None


class NamedArrays:
    """Writes arrays into a group of an HDF5 file, or into the file itself.

    Args:
        group: of h5py.
    """

    def __init__(self, group: Any):
        self.group = group

    def add(self, name: str, values: NDArray, dimensions: tuple[str, ...], unit: str) -> None:
        """Write an array."""
        self._label(self.group.create_dataset(name, data=values), dimensions, unit)

    def room(
        self, name: str, shape: tuple[int, ...], dimensions: tuple[str, ...], unit: str, dtype: Any, **storage: Any
    ) -> Any:
        """Create an array that is written later; `storage` is as of h5py's `create_dataset`."""
        data = self.group.create_dataset(name, shape, dtype, **storage)
        self._label(data, dimensions, unit)
        return data

    @staticmethod
    def _label(data: Any, dimensions: tuple[str, ...], unit: str) -> None:
        for dimension, name in zip(data.dims, dimensions, strict=True):
            dimension.label = name
        data.attrs["units"] = unit
