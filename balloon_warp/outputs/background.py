"""Work done in order on a thread of its own, while the simulation goes on."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

WAITING = 2
"""frames that may wait to be written; more would only fill the memory"""


class Background:
    """Runs jobs one after the other; the `with` block ends when all are done. A job's error is raised where the next
    job is submitted, or at the end."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writer")
        self._jobs: deque[Future[None]] = deque()

    def __enter__(self) -> Self:
        return self

    def submit(self, job: Callable[..., None], *arguments: Any) -> None:
        """Queue a job; waits while `WAITING` are queued already."""
        if len(self._jobs) > WAITING:
            self._jobs.popleft().result()
        self._jobs.append(self._thread.submit(job, *arguments))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._thread.shutdown(wait=True, cancel_futures=error is not None)
        if error is None:
            for job in self._jobs:
                job.result()
