"""Fuzzing command: its cases, and no lost failure; and outputs of processes that are killed."""

import json
import os
import signal
from collections import Counter
from multiprocessing.process import BaseProcess
from typing import Any

import pytest
from commands import status_of

from balloon_warp.benchmarks import kills, trust, viewer_nonsense
from balloon_warp.benchmarks.kills import KINDS, judge, kill_at_random
from balloon_warp.benchmarks.trust import Count, counted, efforts_of
from balloon_warp.benchmarks.worker_kills import kill_workers
from balloon_warp.studio.page.session import Session

GOOD = Count("good", 3, {"accepted": 3}, [])


def die() -> Count:
    os._exit(3)


def fail() -> Count:
    raise ZeroDivisionError("planted")


def harm() -> Count:
    return Count("harm", 5, {"same": 4, "damaged": 1}, ["1 damaged"])


def test_the_table_of_meshes_is_counted_and_all_kinds_are_tried():
    count = trust.bad_meshes()
    assert count.tried == sum(count.outcomes.values()) > 60
    assert not count.failures
    names = [trust._name(effort) for effort in efforts_of(trust.FULL)]
    assert names[0] == "bad meshes"
    assert {name.partition(" ")[0] for name in names[1:]} == {"mutated", "killed", "viewer"}
    assert sum(name.startswith("killed ") for name in names) == len(kills.KINDS) + 1


def test_what_dies_or_fails_is_a_failure_and_not_the_end():
    died, failed, harmed = counted([die, fail, harm])
    assert died.failures[0].startswith("BrokenProcessPool: ")
    assert failed.failures == ["ZeroDivisionError: planted"]
    assert harmed == harm()


HARM = {
    "kills.kill_at_random": (lambda: trust.killed("run", 3), Counter(kept=2, damaged=1), "1 damaged"),
    "worker_kills.kill_workers": (lambda: trust.killed_workers(3), Counter(same=1, damaged=2), "2 damaged"),
    "viewer_nonsense.send_nonsense": (
        lambda: trust.viewer_messages(9),
        Counter({"looks found time standing still": 1}),
        "1 looks found time standing still",
    ),
    "fuzz.fuzz_for": (lambda: trust.mutated_files("meshes", 1.0), (Counter(), "a hang"), "a hang"),
    "fuzz.try_table": (trust.bad_meshes, (Counter(), ["plain: refused"]), "plain: refused"),
}
"""harm that may be found, by its finder: the effort, the findings, and the failure"""


@pytest.mark.parametrize("finder", HARM)
def test_what_did_harm_is_a_failure(finder: str, monkeypatch):
    if finder.startswith("viewer_nonsense"):
        pytest.importorskip("viser", reason="needs an extra")
    effort, found, failure = HARM[finder]
    monkeypatch.setattr(f"balloon_warp.benchmarks.{finder}", lambda *_: found)
    assert effort().failures == [failure]


@pytest.mark.parametrize("options", [[], ["--json"]])
@pytest.mark.parametrize(("counts", "status"), [([GOOD], 0), ([GOOD, harm()], 1)])
def test_a_failure_is_the_status(options: list[str], counts: list[Count], status: int, monkeypatch, capsys):
    monkeypatch.setattr(trust, "counted", lambda efforts: iter(counts))
    assert status_of("--quick", *options, main=trust.main) == status
    said = capsys.readouterr().out
    if options:
        assert json.loads(said)["failures"] == status
        assert json.loads(said)["counts"][-1]["what"] == counts[-1].what
    else:
        assert said.splitlines()[-1] == ("1 failed" if status else "nothing failed")
        assert ("FAILED: 1 damaged" in said) == bool(status)


def test_a_killed_worker_leaves_the_batch_of_one_process(tmp_path):
    assert kill_workers(1, tmp_path) == {"same": 1}


def test_nonsense_does_not_stop_the_viewer(monkeypatch):
    assert viewer_nonsense.send_nonsense(200) == {viewer_nonsense.WENT_ON: 1}
    monkeypatch.setattr(viewer_nonsense, "PATIENCE", 0.5)
    monkeypatch.setattr(Session, "run", lambda *_: None)
    monkeypatch.setattr(Session, "start", lambda *_: None)
    assert viewer_nonsense.send_nonsense(1) == {viewer_nonsense.STOOD_STILL: 1}


BEFORE, AFTER = {"a": b"old", "b": b"older"}, {"a": b"new", "b": b"newer"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_killed_process_leaves_good_files(kind: str, tmp_path, monkeypatch):
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
