"""Mark of tests in this folder: judged by physics, see `--shake`, but for those that compare bits or files."""

import pytest

OF_BITS = "test_burst_outputs.py"


def pytest_collectstart(collector: pytest.Collector) -> None:
    if isinstance(collector, pytest.Module) and collector.path.name != OF_BITS:
        collector.add_marker(pytest.mark.physics)
