"""Files that appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from balloon_warp.errors import InputError

STAGE, PICTURES = ".usdc", (".png", ".webp", ".gif", ".mp4")


def legible(name: str) -> str:
    """A file's name with _ for what is no Unicode, as USD and JSON take it: names are bytes, of any encoding."""
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
            + ("; `balloon-warp render` makes pictures and films of these" if is_picture else "")
        )
    if legible(str(path.absolute())) != str(path.absolute()):
        raise InputError(f"{legible(str(path))}: its name or its folder's is not UTF-8; expected one that is, by -o")
    if ":SDF_FORMAT_ARGS:" in str(path):
        raise InputError(f"{path}: USD takes :SDF_FORMAT_ARGS: for the start of options; expected a name without it")
    try:
        if not path.parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist")
        if path.is_dir():
            raise InputError(f"{path}: is a folder; expected a file name")
        # Only trying tells: a folder may let the superuser in and still take no files.
        probe = _temporary(path)
        try:
            probe.touch(exist_ok=False)
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, of the same suffix, that takes its place when the block ends well.

    It is on the disk before it takes the place, so that a crash of the machine leaves a good file, too.

    Raises:
        InputError: the block, or the end of it, failed to write the file.
    """
    temporary = _temporary(path)
    try:
        yield temporary
        _flush(temporary)
        os.replace(temporary, path)
        with suppress(OSError):  # what is not a disk may not know how; the file is in its place
            _flush(path.parent)
    except OSError as error:
        if error.filename is not None and Path(error.filename) != temporary:
            raise  # another file's
        reason = error.strerror or str(error).partition("\n")[0]
        raise InputError(f"{path}: cannot be written: {reason}") from error
    except RuntimeError as error:
        if not _is_from_usd(error):
            raise
        raise InputError(f"{path}: cannot be written: USD failed to save it; is the disk full?") from error
    finally:
        temporary.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _temporary(path: Path) -> Path:
    """Without the name itself, which may be as long as names can be."""
    return path.with_name(f".{secrets.token_hex(4)}.partial{path.suffix}")


def _is_from_usd(error: RuntimeError) -> bool:
    from pxr import Tf  # loads USD: only once something failed

    return isinstance(error, Tf.ErrorException)
