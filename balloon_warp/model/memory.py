"""What a batch will take, and whether it fits, before anything is allocated."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.model.model import Model

VECTOR_BYTES = 12
USABLE = 0.9
"""the part of the free memory that a batch may take; kernels, graphs and the allocator want some, too"""


def world_bytes(model: Model) -> int:
    """Device memory of one world's state."""
    vectors = 3 * model.particle_count + 3 * model.sphere_count
    return VECTOR_BYTES * vectors + 28 * model.balloon_count + 4


def free_memory(device: wp.Device) -> int:
    """Bytes that can still be allocated: on a GPU, or of the host."""
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
        InputError: they do not; the message says how many would.
    """
    needed = sum(count * size for count, size in zip(world_counts, bytes_per_world, strict=True))
    usable = int(USABLE * free_memory(device))
    if needed > usable:
        worlds = sum(world_counts)
        raise InputError(
            f"{worlds} worlds do not fit: they need {needed / 2**30:.2f} GiB, and {device} has "
            f"{usable / 2**30:.2f} GiB to spare, enough for {usable * worlds // needed} worlds"
        )
