"""Folder beside the output of an unfinished job, from which the job can be resumed."""

import json
import os
import weakref
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.files import target_of, whole_file
from balloon_warp.marks import is_ours, manifest_text, without_mark
from balloon_warp.temporaries import clear_left_over, hold, temporary_in

JOB_NAME = "job.json"


class PartialFolder:
    """A folder of files that each appear whole, in the order in which they are written, and their job.

    Args:
        path: where it is, or will be, or a link that leads there.
    """

    def __init__(self, path: Path):
        self.path = target_of(path)
        self.aside = self.path.with_name(f"{self.path.name}.old")
        """Place for the files of an earlier job when another begins, so that forgetting to resume loses nothing"""
        self._let_go: Callable[[], object] = lambda: None

    def job(self) -> dict[str, Any] | None:
        """Read the job of the files; None where there are none.

        Raises:
            InputError: there is something else.
        """
        path = self.path / JOB_NAME
        try:
            job = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {error}") from None
        if not isinstance(job, dict):
            raise InputError(f"{path}: expected an object (got {type(job).__name__})")
        return without_mark(job)

    def require_own(self) -> None:
        """Make sure that an existing file or folder is ours to replace.

        Raises:
            InputError: it is something else of the same name.
        """
        for path in (self.path, self.aside):
            if path.exists() and not is_ours(path / JOB_NAME):
                begun = path.is_dir() and all(file.name.startswith(".") for file in path.iterdir())
                if not begun:
                    raise InputError(f"{path}: is where checkpoints go; expected no file of that name")

    def clear(self, has_checkpoint: bool) -> None:
        """Clear away the beginnings of a process that was killed: all of them, where it came to no checkpoint."""
        clear_left_over(self.path)
        if has_checkpoint:
            return
        with suppress(OSError):  # it has files, or there is no such folder
            self.path.rmdir()
        if self._take():
            self._let_go()
            _remove(self.path)

    def begin(self, job: Mapping[str, Any]) -> None:
        """Make the folder, for a job; the files of an earlier one are put aside.

        Raises:
            InputError: it cannot be made, or there is something else.
        """
        self.require_own()
        try:
            if self.path.exists():
                _remove(self.aside)
                self.path.rename(self.aside)
            self.path.mkdir()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be made: {error.strerror}") from None
        with self.file(JOB_NAME) as path:
            path.write_text(manifest_text(job), encoding="utf-8")
        self._take()

    def go_on(self) -> None:
        """Go on with the job whose files are there."""
        self._take()

    def _take(self) -> bool:
        """Show other processes, as long as this one is at work here, that it is; return whether nobody else is."""
        try:
            descriptor = hold(self.path / JOB_NAME)
        except OSError:  # there is none
            return False
        if descriptor is None:
            return False
        self._let_go = weakref.finalize(self, os.close, descriptor)
        return True

    def file(self, name: str) -> AbstractContextManager[Path]:
        """Give a temporary path, which becomes the file of that name when the `with` block ends well."""
        return whole_file(self.path / name)

    def remove(self) -> None:
        """Remove the folder, and the files put aside, once the job is done."""
        self._let_go()
        for path in (self.path, self.aside):
            _remove(path)


def _remove(path: Path) -> None:
    """Remove a folder atomically: it is renamed first, so that a kill leaves no part of it that looks whole."""
    try:
        with temporary_in(path.parent) as doomed:
            path.rename(doomed)
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None
