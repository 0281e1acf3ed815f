"""Work done in order on a thread of its own, while the simulation goes on."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

WAITING = 2
"""Number of frames that may wait to be written; more would only fill the memory"""


class Background:
    """Runner of jobs, one after the other, in a background thread.

    The `with` block ends when all are done.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writer")
        self._jobs: deque[Future[None]] = deque()
        self._failed = False

    def __enter__(self) -> Self:
        return self

    def submit(self, job: Callable[..., None], *arguments: Any) -> None:
        """Queue a job; waits while `WAITING` are queued already."""
        if len(self._jobs) > WAITING:
            self._jobs.popleft().result()
        self._jobs.append(self._thread.submit(self._run, job, *arguments))

    def wait(self) -> None:
        """Wait until all queued jobs are done."""
        while self._jobs:
            self._jobs.popleft().result()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._thread.shutdown(wait=True)
        if error is None:
            self.wait()

    def _run(self, job: Callable[..., None], *arguments: Any) -> None:
        if not self._failed:
            try:
                job(*arguments)
            except BaseException:
                self._failed = True
                raise
