"""Outputs of processes that are killed."""

import signal
from multiprocessing.process import BaseProcess
from typing import Any

import pytest

from balloon_warp.benchmarks import kills
from balloon_warp.benchmarks.kills import KINDS, judge, kill_at_random

BEFORE, AFTER = {"a": b"old", "b": b"older"}, {"a": b"new", "b": b"newer"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_killed_process_leaves_good_files(kind: str, tmp_path, monkeypatch):
    """A killed process leaves no damaged files; the fourth is killed before it finishes."""
    processes, start = [], kills._start_to_write

    def watch(*how: Any) -> BaseProcess:
        processes.append(start(*how))
        return processes[-1]

    monkeypatch.setattr(kills, "_start_to_write", watch)
    outcomes = kill_at_random(kind, 4, tmp_path)
    assert -signal.SIGKILL in [process.exitcode for process in processes]
    assert outcomes.total() - outcomes["resumed"] == 4
    assert outcomes["damaged"] == 0


@pytest.mark.parametrize(
    ("found", "outcome"),
    [
        (BEFORE, "kept"),
        (AFTER, "replaced"),
        ({"a": b"new", "b": b"older"}, "between"),
        ({"a": b"ne", "b": b"newer"}, "damaged"),
        ({"a": b"newer", "b": b"newer"}, "damaged"),
        ({"a": None, "b": b"older"}, "damaged"),
    ],
)
def test_damage_is_seen(found: dict[str, bytes | None], outcome: str):
    assert judge(found, BEFORE, AFTER) == outcome
