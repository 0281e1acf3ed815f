"""Options and marks of tests: which ones run, and where."""

import os
from pathlib import Path

import pytest
import warp as wp

wp.config.log_level = wp.LOG_ERROR
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the processes that test: two threads each only wait for a core

pytest_plugins = ("costs", "distribution", "lasting", "page_fixtures", "shared_fixtures", "shaking")
OWN_SCHEDULE = {"cpu": "octets", "cuda:0": "block"}
"""schedule that `auto` takes for small balloons, by device"""
HERE = Path(__file__).parent
LEFT_OUT = (HERE / "physics", HERE / "full")
"""folders that run with --full, or by name, but for tests marked `always`"""


def pytest_addoption(parser: pytest.Parser) -> None:
    told = "add tests/physics, tests/full and all marked full; with -m full these alone"
    parser.addoption("--full", action="store_true", help=told)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "full: runs with --full only, as do tests/physics and tests/full")
    config.addinivalue_line("markers", "always(*ids): runs without --full; ids: those of its cases that do, else all")
    config.addinivalue_line("markers", "schedules: is in a schedule that its device does not take by itself")
    config.addinivalue_line("markers", "nightly: takes longer than a run of CI may: runs with --full")
    config.addinivalue_line("markers", "physics: is judged by physics: --shake starts it from other places")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of which no test runs."""
    is_file = collection_path.suffix == ".py" and is_left_out(collection_path, config)
    return True if is_file and "mark.always" not in collection_path.read_text("utf-8") else None


def is_left_out(path: Path, config: pytest.Config) -> bool:
    """Return whether only `--full` runs a file, and the command line names neither it nor a folder of such that it is
    in."""
    folders = [folder for folder in LEFT_OUT if folder in path.parents]
    named = [Path(argument.partition("::")[0]).resolve() for argument in config.args]
    is_named = any(path.is_relative_to(each) for each in named if any(each.is_relative_to(above) for above in folders))
    return bool(folders) and not config.getoption("--full") and not is_named


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests marked full without `--full`.

    Physics runs in the device's own schedule alone, if there it can: test_reference.py holds all others to the same.
    """
    full = config.getoption("--full")
    in_own = {item.nodeid.partition("[")[0] for item in items if not in_another_schedule(item)}
    left, left_out = [], []
    for item in items:
        if item.get_closest_marker("nightly"):
            item.add_marker(pytest.mark.full)
        another = in_another_schedule(item) and item.nodeid.partition("[")[0] in in_own
        if another:
            item.add_marker(pytest.mark.schedules)
            item.add_marker(pytest.mark.full)
        is_full = bool(item.get_closest_marker("full"))
        if not is_full and any(folder in item.path.parents for folder in LEFT_OUT) and not runs_always(item):
            item.add_marker(pytest.mark.full)
            is_full = is_left_out(item.path, config)
        again = another and item.get_closest_marker("physics")
        (left_out if again or (is_full and not full) else left).append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = left


def runs_always(item: pytest.Item) -> bool:
    """Return whether a test of those folders runs without `--full`."""
    marker = item.get_closest_marker("always")
    return bool(marker) and (not marker.args or item.nodeid.partition("[")[2][:-1] in marker.args)


def in_another_schedule(item: pytest.Item) -> bool:
    """Return whether a parameter of a test names a schedule that its device does not take by itself."""
    parameters = getattr(getattr(item, "callspec", None), "params", {})
    own = OWN_SCHEDULE.get(parameters.get("device", "cpu"))
    named = {str(parameters.get(name)).partition(",")[0] for name in ("schedule", "way", "layout")}
    return not named.isdisjoint({"scatter", "gather", "lanes", "octets", "block"} - {own})
