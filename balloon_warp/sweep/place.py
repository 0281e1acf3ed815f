"""Places beside this process where a batch may be simulated."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager

from balloon_warp.beginning import Beginning
from balloon_warp.resume import Checkpoints
from balloon_warp.sweep.task import BatchTask, Outcome

SimulateBatch = Callable[
    [BatchTask, str | None, Checkpoints, Callable[[Beginning], None], Callable[[int], None]], Outcome
]
"""Function that simulates a batch: its task, device, checkpoints, and listeners to its beginning and frames"""


class BatchPlace(ABC):
    """Workers that simulate a batch in the place of this process, to the same files."""

    @abstractmethod
    def device(self, asked: str | None) -> str | None:
        """Return the device of each worker.

        Raises:
            InputError: a device is asked for that the place chooses itself.
        """

    @abstractmethod
    def started(self) -> AbstractContextManager[SimulateBatch]:
        """Start the workers, which end with the `with` block."""
