"""Files that appear whole or not at all, at the end of the links that lead to them."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from stat import S_ISREG

from balloon_warp.errors import InputError
from balloon_warp.temporaries import clear_left_over, temporary_in

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
