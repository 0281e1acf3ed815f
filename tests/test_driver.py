"""Early start of a GPU's driver, only where a GPU is wanted."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from balloon_warp import driver


class Driver:
    """Stand-in for the driver of a machine with some GPUs."""

    def __init__(self, gpus: int):
        self.gpus = gpus
        self.begun: list[int] = []

    def cuInit(self, _: int) -> int:  # noqa: N802
        return 0

    def cuDeviceGet(self, device: Any, number: int) -> int:  # noqa: N802
        device._obj.value = number
        return 0 if number < self.gpus else 101

    def cuDevicePrimaryCtxRetain(self, _: Any, device: Any) -> int:  # noqa: N802
        self.begun.append(device.value)
        return 0


@pytest.fixture
def of_two(monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    """Yield the stand-in driver of a machine with two GPUs."""
    two = Driver(2)
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


@pytest.mark.parametrize(("device", "number"), [(None, 0), ("cuda", 0), ("cuda:0", 0), ("cuda:1", 1)])
def test_the_gpu_that_is_wanted_begins(of_two: Driver, device: str | None, number: int):
    begun(device)
    assert of_two.begun == [number]


def test_a_gpu_begins_once(of_two: Driver):
    begun(None)
    begun("cuda:0")
    assert of_two.begun == [0]


@pytest.mark.parametrize("device", ["cpu", "cuda:2", "cuda:x", "gpu"])
def test_nothing_begins_for_a_cpu_or_what_is_not_there(of_two: Driver, device: str):
    begun(device)
    assert of_two.begun == []


def test_a_machine_without_a_driver_is_left_alone(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(driver, "LIBRARY", "libnothing.so")
    driver._begin.cache_clear()
    begun(None)
    driver._begin.cache_clear()
