"""Objects that live from loading to the end, which Python's search for garbage leaves alone."""

import gc
from collections.abc import Iterator

import pytest

gc.set_threshold(20_000)  # Warp's code generator makes much that stays, too


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Load all tests without a search, each of which would take a second from then on."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
