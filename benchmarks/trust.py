"""Counts of all trials that the guarantees speak of, by one command.

    python -m balloon_warp.benchmarks.trust [--quick] [--json]

tries bad meshes, mutated files, kills and messages that are none, prints how many of each and their outcomes, and
ends with status 1 where one did harm. Each kind has a process of its own: one that dies is a failure, not the end.
Needs the extras `test`, `cluster` and `view`.
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from balloon_warp.benchmarks import fuzz, kills
from balloon_warp.system.warp_setup import quiet_warp


@dataclass(frozen=True)
class Effort:
    """Number of trials of each kind."""

    fuzz_seconds: float
    """of each kind of file"""
    kills: int
    """of each kind of output"""
    worker_kills: int
    messages: int


FULL = Effort(fuzz_seconds=300.0, kills=100, worker_kills=10, messages=10_000)
QUICK = Effort(fuzz_seconds=3.0, kills=3, worker_kills=1, messages=400)


@dataclass(frozen=True)
class Count:
    """Trials of a kind, and their outcomes."""

    what: str
    tried: int
    outcomes: dict[str, int]
    failures: list[str]
    """a sentence for each"""


def bad_meshes() -> Count:
    """Every mesh of the table, as the table says."""
    with tempfile.TemporaryDirectory() as folder:
        outcomes, wrong = fuzz.try_table(Path(folder))
    return Count("bad meshes", outcomes.total(), dict(outcomes), wrong)


def mutated_files(what: str, seconds: float) -> Count:
    """Meshes or scenes of which nobody thought."""
    with tempfile.TemporaryDirectory() as folder:
        outcomes, failure = fuzz.fuzz_for(seconds, what, Path(folder))
    return Count(f"mutated {what}", outcomes.total(), dict(outcomes), [failure] if failure else [])


def killed(kind: str, count: int) -> Count:
    """Count the outcomes of killed processes that wrote an output, and those of them that were resumed."""
    with tempfile.TemporaryDirectory() as folder:
        outcomes = kills.kill_at_random(kind, count, Path(folder))
    return Count(f"kills: {kind}", count, dict(outcomes), _failures(outcomes, "damaged"))


def killed_workers(count: int) -> Count:
    """Workers of a cluster."""
    from balloon_warp.benchmarks.worker_kills import kill_workers

    with tempfile.TemporaryDirectory() as folder:
        outcomes = kill_workers(count, Path(folder))
    return Count("kills: cluster worker", count, dict(outcomes), _failures(outcomes, "damaged"))


def viewer_messages(count: int) -> Count:
    """Count the outcomes of messages that no window sends."""
    from balloon_warp.benchmarks.viewer_nonsense import STOOD_STILL, send_nonsense

    looks = send_nonsense(count)
    return Count("malformed viewer messages", count, dict(looks), _failures(looks, STOOD_STILL))


def _failures(outcomes: Counter[str], bad: str) -> list[str]:
    return [f"{outcomes[bad]} {bad}"] if outcomes[bad] else []


def counted(efforts: Sequence[Callable[[], Count]]) -> Iterator[Count]:
    """Count the outcomes of each kind, in a process of its own."""
    for effort in efforts:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=quiet_warp) as process:
            try:
                yield process.submit(effort).result()
            except Exception as failure:
                yield Count(_name(effort), 0, {}, [f"{type(failure).__name__}: {failure}"])


def efforts_of(effort: Effort) -> list[Callable[[], Count]]:
    """Return all trials."""
    return [
        bad_meshes,
        *(partial(mutated_files, what, effort.fuzz_seconds) for what in fuzz.FUZZERS),
        *(partial(killed, kind, effort.kills) for kind in kills.KINDS),
        partial(killed_workers, effort.worker_kills),
        partial(viewer_messages, effort.messages),
    ]


def _name(effort: Callable[[], Count]) -> str:
    """Return the name of a kind whose process died."""
    if isinstance(effort, partial):
        return " ".join([effort.func.__name__, *map(str, effort.args)]).replace("_", " ")
    return effort.__name__.replace("_", " ")


def main() -> None:
    """Print the counts; status 1 where anything failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a moment of each instead of half an hour")
    parser.add_argument("--json", action="store_true", help="print one JSON document instead of the table")
    arguments = parser.parse_args()
    counts = []
    if not arguments.json:
        print(f"{'tried':>8}  {'what':26}  what became of it")
    for count in counted(efforts_of(QUICK if arguments.quick else FULL)):
        counts.append(count)
        if not arguments.json:
            print(f"{count.tried:8,}  {count.what:26}  {fuzz.shown(Counter(count.outcomes))}", flush=True)
            for failure in count.failures:
                print(f"{'':8}  FAILED: {failure}", flush=True)
    failed = sum(len(count.failures) for count in counts)
    if arguments.json:
        print(json.dumps({"counts": [asdict(count) for count in counts], "failures": failed}, indent=2))
    else:
        print("nothing failed" if not failed else f"{failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
