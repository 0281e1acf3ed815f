"""Early start of a GPU's driver, only where a GPU is wanted."""

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from balloon_warp import driver


@pytest.fixture
def of_two(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """Yield the stand-in driver of a machine with two GPUs."""
    two = SimpleNamespace(begun=[])

    def get(device: Any, number: int) -> int:
        device._obj.value = number
        return 0 if number < 2 else 101

    two.cuInit, two.cuDeviceGet = lambda _: 0, get
    two.cuDevicePrimaryCtxRetain = lambda _, device: two.begun.append(device.value)
    monkeypatch.setattr(driver.ctypes, "CDLL", lambda _: two)
    driver._begin.cache_clear()
    yield two
    driver._begin.cache_clear()


def begun(device: str | None) -> None:
    """Start the driver and wait until it has begun."""
    driver.begin_driver(device)
    for thread in threading.enumerate():
        if thread.name == "driver":
            thread.join()


WANTED = {None: [0], "cuda": [0], "cuda:0": [0], "cuda:1": [1], "cpu": [], "cuda:2": [], "cuda:x": [], "gpu": []}


@pytest.mark.parametrize(("device", "numbers"), WANTED.items())
def test_the_gpu_that_is_wanted_and_there_begins_once(of_two: SimpleNamespace, device: str | None, numbers: list[int]):
    for name in (device, *(f"cuda:{number}" for number in numbers)):
        begun(name)
    assert of_two.begun == numbers


def test_a_machine_without_a_driver_is_left_alone(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(driver, "LIBRARY", "libnothing.so")
    driver._begin.cache_clear()
    begun(None)
    driver._begin.cache_clear()
