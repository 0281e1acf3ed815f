"""Results of shares that are lost with their worker. See test_cluster.py."""

from typing import Any

import numpy as np
import pytest

from balloon_warp.errors import WorkersLostError

dask_workers = pytest.importorskip("balloon_warp.sweep.dask_workers")
pytest.importorskip("distributed")


class FarAway:
    """Pending result of a worker, and the client that waits for it."""

    def __init__(self, workers: int, seconds: float):
        self.workers, self.seconds = workers, seconds
        self.timeouts: list[float] = []

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(map(str, range(self.workers)), 1)

    def result(self, timeout: float) -> str:
        self.timeouts.append(timeout)
        if timeout < self.seconds:
            raise TimeoutError
        return "share"


def test_a_result_that_went_with_its_worker_is_not_waited_for_for_ever():
    """A result lost with its worker is not waited for: the share is repeated, and there is no worker left to do so."""
    lost: Any = FarAway(workers=0, seconds=np.inf)
    with pytest.raises(WorkersLostError, match=r"^all workers ended, and none came for 60 s"):
        dask_workers._result(lost, lost)
    slow: Any = FarAway(workers=1, seconds=200.0)
    assert dask_workers._result(slow, slow) == "share"
    assert slow.timeouts == [60.0, 120.0, 240.0]
