"""Writes recordings in a process of its own: USD holds Python's lock while it writes, and time would stand still."""

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.standard_streams import open_closed_streams
from balloon_warp.viewer.recording import Recorded, write_recording
from balloon_warp.warp_logging import quiet_warp

NICENESS = 10
"""Niceness of the process: the simulation comes first"""


class Done(str):
    """A notice of success."""


def save_recording(recorded: Recorded, folder: Path, name: str, laws: Sequence[Law] = ()) -> list[Path]:
    """Write a recording as `write_recording` in another process.

    Laws that only this process knows keep it here.

    Raises:
        InputError: nothing was recorded, a file cannot be written, or too much was done to be replayed.
    """
    try:
        others = pickle.dumps((recorded.journal, recorded.bodies, folder, name, tuple(laws)))
    except (pickle.PicklingError, AttributeError, TypeError):
        return write_recording(recorded, folder, name, laws)
    if any(law.force.func.__module__ == "__main__" for law in laws):
        return write_recording(recorded, folder, name, laws)
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", __name__]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=found) as process:
        assert process.stdin
        assert process.stdout
        try:
            process.stdin.write(others)
            for frame in recorded.frames:  # one by one: each holds Python's lock for a moment only
                pickle.dump(frame, process.stdin)
            process.stdin.close()
            answer = pickle.load(process.stdout)
        except (BrokenPipeError, EOFError, pickle.UnpicklingError):
            raise InputError(f"{name}: the process that writes it died") from None
    if isinstance(answer, InputError):
        raise answer
    return answer


def told_of_saving(
    recorded: Recorded, folder: Path, name: str, laws: Sequence[Law] = ()
) -> tuple[str, tuple[Path, ...]]:
    """Save a recording, and return the outcome in a sentence, and the files."""
    try:
        files = save_recording(recorded, folder, name, laws)
    except InputError as mistake:
        return str(mistake), ()
    return Done(f"wrote {' and '.join(file.name for file in files)} in {folder}"), tuple(files)


def main() -> None:
    """Read a recording from standard input, write it, and tell the files, or the error, on standard output."""
    open_closed_streams()
    answers = os.dup(1)
    os.dup2(2, 1)  # a library's output is no answer
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    quiet_warp()
    source = sys.stdin.buffer
    journal, bodies, folder, name, laws = pickle.load(source)
    recorded = Recorded([pickle.load(source) for _ in bodies], journal, bodies)
    try:
        answer: object = write_recording(recorded, folder, name, laws)
    except InputError as mistake:
        answer = InputError(str(mistake))
    with os.fdopen(answers, "wb") as out:
        pickle.dump(answer, out)


if __name__ == "__main__":
    main()
