"""Memory: where arrays come from, their size, and whether it fits, before anything is allocated."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import warp as wp

from balloon_warp.errors import NoRoomError
from balloon_warp.model.limits import least_limit

USABLE = 0.9
"""Fraction of the free memory that a batch may take; kernels, graphs and the allocator need some, too"""


class Room(Protocol):
    """Allocator of arrays.

    All code that allocates uses one, so that the memory can be counted in advance.
    """

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return an array of zeros."""


class Allocating:
    """The memory of a device."""

    def __init__(self, device: wp.Device):
        self.device = device

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.device)


class Counting:
    """Allocator that counts memory without allocating it."""

    def __init__(self) -> None:
        self.bytes = 0

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> None:
        self.bytes += wp.types.type_size_in_bytes(dtype) * math.prod(shape if isinstance(shape, tuple) else (shape,))


def free_memory(device: wp.Device) -> int:
    """Return the bytes that can still be allocated: on a GPU, or of the host."""
    if device.is_cuda:
        return device.free_memory
    meminfo = Path("/proc/meminfo")
    if meminfo.exists() and (available := re.search(r"MemAvailable:\s+(\d+) kB", meminfo.read_text())):
        return 1024 * int(available[1])
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_memory(device: wp.Device, world_counts: Sequence[int], bytes_per_world: Sequence[int]) -> None:
    """Make sure that all worlds fit.

    Args:
        world_counts: of each kind of world.
        bytes_per_world: of each kind of world.

    Raises:
        NoRoomError: they do not; the message says how many would.
    """
    needed = sum(count * size for count, size in zip(world_counts, bytes_per_world, strict=True))
    usable, within = _usable(device)
    if needed > usable:
        worlds = sum(world_counts)
        raise NoRoomError(
            f"{worlds} worlds do not fit: they need {needed / 2**30:.2f} GiB, and {device} has "
            f"{usable / 2**30:.2f} GiB to spare{within}, enough for {usable * worlds // needed} worlds"
        )


def usable_memory(device: wp.Device) -> int:
    """Return the bytes that one may ask for."""
    return _usable(device)[0]


def _usable(device: wp.Device) -> tuple[int, str]:
    """Return the bytes that one may ask for, and within which limit, in words."""
    usable = int(USABLE * free_memory(device))
    if device.is_cpu and (limit := least_limit()) and int(USABLE * limit.left) < usable:
        return max(int(USABLE * limit.left), 0), f" within {limit.name}"
    return usable, ""
