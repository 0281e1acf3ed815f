"""Limits of a shell's `ulimit` below which the libraries end a process by a signal, or hang."""

import os

from balloon_warp.errors import InputError

GIB = 2**30
NEEDED = {"-v": ("RLIMIT_AS", 1.75 * GIB, 0.25 * GIB), "-d": ("RLIMIT_DATA", 0.5 * GIB, 0.125 * GIB)}
"""Limits by the options of `ulimit`: addresses, and data, of a small run with a picture, measured on 1 and 2 cores, and
those of the threads of each core beside that [bytes]"""
MOST_CORES = 16
"""Most cores for which libraries start threads"""


def require_addresses() -> None:
    """Make sure that USD, Warp and the others find room, before they are loaded.

    Raises:
        InputError: `ulimit` leaves the process less than they take.
    """
    try:
        import resource
    except ModuleNotFoundError:  # Windows has none
        return
    for option, (name, least, per_core) in NEEDED.items():
        needed = int(least + per_core * min(os.cpu_count() or 1, MOST_CORES))
        soft, _ = resource.getrlimit(getattr(resource, name))
        if soft != resource.RLIM_INFINITY and soft < needed:
            raise InputError(
                f"ulimit {option}: {soft // 1024} is less than the libraries take on this machine; expected at least "
                f"{needed // 1024}, {needed / GIB:.3g} GiB, or unlimited"
            )
