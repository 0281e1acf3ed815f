"""Background jobs of a batch."""

import threading

import pytest

from balloon_warp.outputs.background import WAITING, Background


def test_jobs_run_in_order_off_the_main_thread_and_only_so_many_wait():
    done, gate = [], threading.Event()

    def job(number: int) -> None:
        gate.wait(10.0)
        done.append((number, threading.current_thread() is threading.main_thread()))

    with Background() as background:
        for number in range(WAITING + 1):
            background.submit(job, number)
        threading.Timer(0.2, gate.set).start()
        background.submit(job, WAITING + 1)
        assert gate.is_set()  # it had to wait for a place
    assert done == [(number, False) for number in range(WAITING + 2)]


def test_an_error_of_a_job_is_raised_where_the_batch_runs():
    with pytest.raises(OSError, match="disk full"), Background() as background:
        background.submit(_fail)


def _fail() -> None:
    raise OSError("disk full")


def test_a_failed_job_takes_what_is_behind_it_along():
    """Jobs queued behind a failed one do not run, so that no checkpoint follows frames that could not be written."""
    done: list[int] = []
    gate = threading.Event()

    def fail() -> None:
        gate.wait()
        raise OSError("disk full")

    def run() -> None:
        with Background() as background:
            background.submit(fail)
            background.submit(done.append, 1)
            gate.set()

    with pytest.raises(OSError, match="disk full"):
        run()
    assert done == []
