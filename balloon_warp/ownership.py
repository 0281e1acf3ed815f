"""Files whose place an output may take: the program's own, none of its inputs, and nobody else's at the same time."""

import os
import platform
import shlex
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path

from balloon_warp.errors import InputError
from balloon_warp.files import target_of
from balloon_warp.marks import is_ours
from balloon_warp.temporaries import sole_holder

_replaces_any: ContextVar[bool] = ContextVar("replaces_any", default=False)
"""Whether `--force` is said"""
_held: ContextVar[frozenset[Path]] = ContextVar("held", default=frozenset())
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
        for target in targets.keys() - _held.get():
            try:
                holds.enter_context(sole_holder(target, _this_process()))
            except BlockingIOError as held:
                raise InputError(
                    f"{targets[target]}: {held.strerror or 'another process'} is writing it; wait for its end, or give "
                    "another name, with -o"
                ) from None
            except OSError:
                continue  # it will be told by whoever writes there
        before = _held.set(_held.get() | targets.keys())
        try:
            yield
        finally:
            _held.reset(before)


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
