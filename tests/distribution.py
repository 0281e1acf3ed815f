"""Distribution of tests among processes: one goes through those that share kernels and simulations."""

from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

PROCESSES = "full/processes/"
"""folder of tests that start processes or wait for a page"""
BY_SETS = "test_reference.py"
"""file of tests of feature sets, which share kernels by these: as a whole it would take longer than all others"""


class ByFile(LoadScopeScheduling):
    """Distribution of tests by files, or by feature sets. One process goes through the folder of tests with processes
    of their own, since a machine of two cores is too slow for several of them at once."""

    def _split_scope(self, nodeid: str) -> str:
        file, _, test = nodeid.partition("::")
        if PROCESSES in file:
            return PROCESSES
        return f"{file} {set_named(test)}" if file.endswith(BY_SETS) else file


def set_named(test: str) -> str:
    """Return the feature set that a test is of, by its name; empty where it names none."""
    from feature_sets import SETS  # loads what the process that distributes does not need otherwise

    return "".join(SETS.keys() & test.partition("[")[2].rstrip("]").split("-"))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    return ByFile(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with tests that wait for other processes."""
    items.sort(key=lambda item: PROCESSES not in item.nodeid)
