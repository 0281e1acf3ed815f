"""What is safe of a job that is not finished: a folder beside its output, from which the job can go on."""

import json
import secrets
import shutil
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file

JOB_NAME = "job.json"


class PartialFolder:
    """A folder of files that each appear whole, in the order in which they are written, and that say of what job.

    Args:
        path: where it is, or will be.
    """

    def __init__(self, path: Path):
        self.path = path
        self.aside = path.with_name(f"{path.name}.old")
        """where the files of an earlier job go when another begins: whoever forgot to resume it has lost nothing yet"""

    def job(self) -> dict[str, Any] | None:
        """What the files are of; nothing where there are none.

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
        return job

    def require_own(self) -> None:
        """Make sure that what is there, if anything, is ours to replace.

        Raises:
            InputError: it is something else of the same name.
        """
        for path in (self.path, self.aside):
            if path.exists() and not (path / JOB_NAME).is_file():
                begun = path.is_dir() and all(file.name.startswith(".") for file in path.iterdir())
                if not begun:
                    raise InputError(f"{path}: is in the way of checkpoints; expected nothing of that name")

    def begin(self, job: Mapping[str, Any]) -> None:
        """Make the folder, for a job; what was there of an earlier one is put aside.

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
            path.write_text(json.dumps(job, indent=1) + "\n", encoding="utf-8")

    def file(self, name: str) -> AbstractContextManager[Path]:
        """A temporary path, which becomes the file of that name when the `with` block ends well."""
        return whole_file(self.path / name)

    def remove(self) -> None:
        """Once the job is done: the folder, and what was put aside."""
        for path in (self.path, self.aside):
            _remove(path)


def _remove(path: Path) -> None:
    """All at once: under another name first, so that a kill leaves no part of it that looks whole."""
    doomed = path.with_name(f".{secrets.token_hex(4)}.partial")
    try:
        path.rename(doomed)
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None
    shutil.rmtree(doomed, ignore_errors=True)
