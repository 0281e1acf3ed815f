"""Fixtures that all tests may ask for."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp

import balloon_warp


@pytest.fixture(params=["cpu", "cuda:0"])
def device(request: pytest.FixtureRequest) -> str:
    """Return each device in turn; tests of the GPU are skipped where there is none."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    return request.param


@pytest.fixture
def gpu() -> wp.Device:
    """Return the first GPU."""
    if not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    return wp.get_device("cuda:0")


@pytest.fixture(params=["gather", "lanes", "octets", "block"])
def schedule(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule that is held to the reference, where it runs."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_of_this_process() -> Iterator[None]:
    """Restore the default SIGINT handler, so that Ctrl-C reaches the tests where a shell has told them to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def package_of_this_process() -> Iterator[None]:
    """Put the tested package first on the path of every process that a test starts."""
    tested = str(Path(balloon_warp.__path__[0]).resolve().parent)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", tested, prepend=os.pathsep)
        yield
