"""Options and marks of tests: which ones run, and where."""

import gc
import os
from pathlib import Path
from typing import Any

import pytest
import warp as wp
from xdist.scheduler import LoadScopeScheduling

wp.config.log_level = wp.LOG_ERROR
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the processes that test: two threads each only wait for a core
gc.set_threshold(20_000)  # Warp's code generator makes much that stays, which is else looked through again and again

pytest_plugins = ("costs", "page_fixtures", "shared_fixtures", "shaking")
OWN_SCHEDULE = {"cpu": "octets", "cuda:0": "block"}
"""schedule that `auto` takes for small balloons, by device"""


HERE = Path(__file__).parent
LEFT_OUT = (HERE / "physics", HERE / "full")
"""folders that run with --full, or by name"""
PROCESSES = "full/processes/"
"""folder of tests that start processes or wait for a page"""


class ByFile(LoadScopeScheduling):
    """Distribution of tests by files, which share kernels and simulations. One process goes through the folder of tests
    with processes of their own, since a machine of two cores is too slow for several of them at once."""

    def _split_scope(self, nodeid: str) -> str:
        return PROCESSES if PROCESSES in nodeid else nodeid.partition("::")[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    return ByFile(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--full",
        action="store_true",
        help="add tests/physics, tests/full and all marked full; with -m full these alone",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "full: runs with --full only, as do tests/physics and tests/full")
    config.addinivalue_line("markers", "schedules: is in a schedule that its device does not take by itself")
    config.addinivalue_line("markers", "physics: is judged by physics: --shake starts it from other places")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out what only `--full` runs, unless a path on the command line is in it."""
    named = [Path(argument.partition("::")[0]).resolve() for argument in config.args]
    is_left_out = collection_path in LEFT_OUT and not config.getoption("--full")
    return True if is_left_out and not any(path.is_relative_to(collection_path) for path in named) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests marked full without `--full`, and begin with those that wait for other processes.

    Physics runs in the device's own schedule alone, if there it can: test_reference.py holds all others to the same.
    """
    full = config.getoption("--full")
    in_own = {function_of(item) for item in items if not in_another_schedule(item)}
    left, left_out = [], []
    for item in items:
        another = in_another_schedule(item) and function_of(item) in in_own
        if another:
            item.add_marker(pytest.mark.schedules)
            item.add_marker(pytest.mark.full)
        is_marked = item.get_closest_marker("full")
        if any(folder in item.path.parents for folder in LEFT_OUT):
            item.add_marker(pytest.mark.full)
        again = another and item.get_closest_marker("physics")
        (left_out if again or (is_marked and not full) else left).append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = sorted(left, key=lambda item: PROCESSES not in item.nodeid)


def function_of(item: pytest.Item) -> str:
    """Return the name of a test without its parameters."""
    return item.nodeid.partition("[")[0]


def in_another_schedule(item: pytest.Item) -> bool:
    """Return whether a parameter of a test names a schedule that its device does not take by itself."""
    parameters = getattr(getattr(item, "callspec", None), "params", {})
    own = OWN_SCHEDULE.get(parameters.get("device", "cpu"))
    named = {str(parameters.get(name)).partition(",")[0] for name in ("schedule", "way", "layout")}
    return not named.isdisjoint({"scatter", "gather", "lanes", "octets", "block"} - {own})
