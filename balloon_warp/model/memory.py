"""Memory: where arrays come from, their size, and whether it fits, before anything is allocated."""

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import warp as wp

from balloon_warp.errors import NoRoomError

MIB = 2**20


class Limit(NamedTuple):
    """A limit on the memory of a process, and the memory left below it."""

    name: str
    """Name of the limit"""
    left: int
    """Free bytes"""


def least_limit(root: Path = Path("/"), environment: Mapping[str, str] = os.environ) -> Limit | None:
    """Find the limit that is met first, or None where there is none.

    Args:
        root: where `proc` and `sys` are.
        environment: of the process.
    """
    status = _text(root / "proc/self/status")
    limits = [*_of_cgroups(root), *_of_slurm(environment, status), *_of_ulimit(status)]
    return min(limits, key=lambda limit: limit.left, default=None)


def _of_cgroups(root: Path) -> Iterator[Limit]:
    """Iterate over the memory limits of the process's control group and its parents, of versions 1 and 2.

    The page cache of files that nobody works on is released on demand, and so counts as free.
    """
    for line in _text(root / "proc/self/cgroup").splitlines():
        _, controllers, own = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        old = bool(controllers)
        mount = root / "sys/fs/cgroup" / ("memory" if old else "")
        most, used, idle = (
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            if old
            else ("memory.max", "memory.current", "inactive_file")
        )
        group = mount / own.strip("/")
        for folder in (group, *group.parents):
            if not folder.is_relative_to(mount):
                break
            with suppress(ValueError):  # "max", or no such file: a container sees its own group as the root
                limit = int(_text(folder / most))
                given_back = _field(_text(folder / "memory.stat"), rf"^{idle} (\d+)$")
                yield Limit(f"the cgroup's {most}", limit - int(_text(folder / used)) + given_back)


def _of_slurm(environment: Mapping[str, str], status: str) -> Iterator[Limit]:
    """Return the memory limits of a SLURM job [MiB]: of a node, or of each CPU on it.

    0 is all that the node has.
    """
    taken = 1024 * _field(status, r"^VmRSS:\s+(\d+) kB$")
    for name, count in (("SLURM_MEM_PER_NODE", "1"), ("SLURM_MEM_PER_CPU", environment.get("SLURM_CPUS_ON_NODE", ""))):
        with suppress(KeyError, ValueError):
            asked = MIB * int(count) * int(environment[name])
            if asked > 0:
                yield Limit(name, asked - taken)


def _of_ulimit(status: str) -> Iterator[Limit]:
    try:
        import resource
    except ModuleNotFoundError:  # Windows has none
        return
    for option, number, taken in (
        ("-v", resource.RLIMIT_AS, r"^VmSize:\s+(\d+) kB$"),
        ("-d", resource.RLIMIT_DATA, r"^VmData:\s+(\d+) kB$"),
    ):
        soft, _ = resource.getrlimit(number)
        if soft != resource.RLIM_INFINITY:
            yield Limit(f"ulimit {option}", soft - 1024 * _field(status, taken))


def _text(path: Path) -> str:
    """Read a file; nothing where it cannot be read."""
    with suppress(OSError):
        return path.read_text()
    return ""


def _field(text: str, pattern: str) -> int:
    found = re.search(pattern, text, re.MULTILINE)
    return int(found[1]) if found else 0


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
