"""Cluster: the workers that a batch may be given to."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from balloon_warp.sweep.distribute import distribute_batch
from balloon_warp.sweep.options import WorkerOptions
from balloon_warp.sweep.place import BatchPlace, SimulateBatch
from balloon_warp.sweep.remote import connect

SHARES = "balloon_warp.sweep.shares"
"""Module that simulates shares"""


@dataclass(frozen=True)
class Cluster(WorkerOptions, BatchPlace):
    """Workers that simulate a batch: one of `address`, `gpus` and `workers` is given.

    Raises:
        InputError: none or several are, the address is none, or a number is below 1.
    """

    @contextmanager
    def started(self) -> Iterator[SimulateBatch]:
        """Start the workers, or connect to them; those that are started end with the `with` block.

        Raises:
            MissingExtraError, InputError: as `connect`.
        """
        with connect(self, SHARES) as workers:
            yield partial(distribute_batch, cluster=self, workers=workers)
