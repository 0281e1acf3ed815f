"""Plugin of pytest: chosen tests alone, in the order in which they were chosen, until their time is up.

    pytest -p balloon_warp.benchmarks.chosen_tests --chosen FILE --chosen-seconds S --chosen-report REPORT

The file has a node id a line. The report gets a line as a test begins, `begins ID`, and as it fails, `fails ID`; a file
that cannot be imported fails, too. A test that goes on for `LONGEST` beyond the time is killed by SIGXCPU.
"""

import resource
from pathlib import Path

import pytest

MOST_MEMORY = 24 << 30
"""Bytes of address space"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--chosen", help="file of node ids")
    parser.addoption("--chosen-seconds", type=float, help="of the processor, from the start of the process")
    parser.addoption("--chosen-report", help="file for what begins and fails")


def pytest_configure(config: pytest.Config) -> None:
    chosen, seconds = Path(config.option.chosen), config.option.chosen_seconds
    _bound(resource.RLIMIT_CPU, int(2.0 * seconds))
    _bound(resource.RLIMIT_AS, MOST_MEMORY)
    report = Path(config.option.chosen_report)
    config.pluginmanager.register(Chosen(chosen.read_text().splitlines(), seconds, report))


def _bound(what: int, most: int) -> None:
    """Limit a resource of this process and of each of its children."""
    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def processor_seconds() -> float:
    """Return the time of the processor that this process and those that it has waited for have taken [s]."""
    taken = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in taken)


class Chosen:
    """Deselect all other tests, and leave out those that come too late."""

    def __init__(self, tests: list[str], seconds: float, report: Path):
        self._place = {test: place for place, test in enumerate(tests)}
        self._seconds, self._report = seconds, report

    def _say(self, line: str) -> None:
        with self._report.open("a") as file:
            file.write(f"{line}\n")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the chosen tests, in order."""
        items[:] = [item for item in items if item.nodeid in self._place]
        items.sort(key=lambda item: self._place[item.nodeid])

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Report a file that cannot be imported."""
        if report.failed:
            self._say(f"fails {report.nodeid}")

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        """Leave out a test once the time is up."""
        if processor_seconds() > self._seconds:
            return True
        self._say(f"begins {item.nodeid}")
        return None

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Report a test that fails, or whose fixtures do."""
        if report.failed:
            self._say(f"fails {report.nodeid}")
