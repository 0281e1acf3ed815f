"""`--shake N`: each test of physics N times, from places moved by a millionth of the size and from other seeds.

A verdict that changes is one of chance."""

import sys
from pathlib import Path

import numpy as np
import pytest

from balloon_warp.model import Model
from balloon_warp.model.state import State, initial_state

MOVED = 1e-6
"""of the size of a balloon: ten times the rounding of its places"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--shake", type=int, metavar="N", help="run each test of physics N times, from slightly other places and seeds"
    )


def pytest_configure(config: pytest.Config) -> None:
    times = config.getoption("--shake")
    if times is not None and times < 1:
        raise pytest.UsageError(f"--shake: must be at least 1 (got {times})")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    times = metafunc.config.getoption("--shake")
    if times and metafunc.definition.get_closest_marker("physics"):
        metafunc.fixturenames.append("shaken")
        metafunc.parametrize("shaken", range(times), indirect=True, ids="shake {}".format)


@pytest.fixture
def shaken(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Move the start of every simulation, and take other seeds than the test says."""
    number, seeded = request.param, np.random.default_rng
    draw = seeded([number, 7])

    def moved(model: Model) -> State:
        begun = initial_state(model)
        sizes = [np.ptp(shape.mesh.points, axis=0).max() for shape in model.shapes]
        reach = MOVED * np.repeat(sizes, [len(shape.mesh.points) for shape in model.shapes])[:, None]
        points = begun.points.numpy()
        begun.points.assign(points + (reach * draw.uniform(-1.0, 1.0, points.shape)).astype(np.float32))
        return begun

    for module in list(sys.modules.values()):
        if getattr(module, initial_state.__name__, None) is initial_state and module is not sys.modules[__name__]:
            monkeypatch.setattr(module, initial_state.__name__, moved)
    monkeypatch.setattr(
        np.random, "default_rng", lambda seed=None: seeded(seed if seed is None else [number, *np.ravel(seed)])
    )
    _forget_results()


def _forget_results() -> None:
    """Clear the caches of the tests' own functions, which keep the results of a former start."""
    here = str(Path(__file__).parent)
    for module in list(sys.modules.values()):
        if str(getattr(module, "__file__", "")).startswith(here):
            for value in list(vars(module).values()):
                if hasattr(value, "cache_clear"):
                    value.cache_clear()
