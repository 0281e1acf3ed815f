"""A process of Balloon Warp beside Blender, which tells lines of JSON."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from . import preferences
from .snapshot import RefusedError

TOLD, ERRORS = "progress.jsonl", "errors.txt"
"""Files with what a process tells, and with its standard error"""
STOP_SECONDS = 30.0
"""Time that a process has to keep what it has [s]"""


class Worker:
    """A process that works on a request.

    Args:
        module: of `balloon_warp.blender` that runs.
        folder: of the request.
        options: of its command.

    Raises:
        OSError: the folder cannot be written.
        RefusedError: there is no such Python.
    """

    def __init__(self, module: str, folder: Path, *options: str):
        self.folder, self._read = folder, 0
        python = preferences.python()
        environment = dict(os.environ, PYTHONUNBUFFERED="1")
        if not python:  # Blender's own, which finds what Blender finds
            environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        command = [python or sys.executable, "-m", f"balloon_warp.blender.{module}", str(folder), *options]
        with (folder / TOLD).open("wb") as told, (folder / ERRORS).open("wb") as errors:
            pipes = {"stdin": subprocess.PIPE, "stdout": told, "stderr": errors}
            try:
                self.process = subprocess.Popen(command, env=environment, **pipes)
            except OSError as error:
                raise RefusedError(
                    f"{command[0]}: cannot be started: {error.strerror}; see Preferences, Python"
                ) from None

    @property
    def ended(self) -> bool:
        """Return whether the process has ended."""
        return self.process.poll() is not None

    def hear(self) -> list[dict[str, Any]]:
        """Return the lines that it has told since the last time."""
        heard = []
        with (self.folder / TOLD).open("rb") as told:
            told.seek(self._read)
            for line in told:
                if line.endswith(b"\n"):  # the rest comes next time
                    self._read += len(line)
                    heard.append(json.loads(line))
        return heard

    def tell(self, what: dict[str, Any]) -> None:
        """Tell the process a line, if it still listens."""
        with suppress(OSError):  # it has ended
            if self.process.stdin:
                self.process.stdin.write(json.dumps(what).encode() + b"\n")
                self.process.stdin.flush()

    def ask_to_end(self) -> None:
        """Close the input of the process, which then saves its frames and exits."""
        with suppress(OSError):
            if self.process.stdin:
                self.process.stdin.close()

    def stop(self) -> None:
        """End the process, and wait for that."""
        self.ask_to_end()
        try:
            self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()

    def last_error(self) -> str:
        """Return the last line that it wrote on its standard error."""
        lines = (self.folder / ERRORS).read_text(encoding="utf-8", errors="replace").split("\n")
        last = [line.strip() for line in lines if line.strip()][-1:]
        return last[0] if last else f"its process was killed ({self.process.returncode})"
