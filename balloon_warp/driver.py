"""A GPU's driver, which begins while Python still loads and plans."""

import ctypes
import os
import re
from functools import cache
from threading import Thread

LIBRARY = "nvcuda.dll" if os.name == "nt" else "libcuda.so.1"


def begin_driver(device: str | None) -> None:
    """Start the driver and the context of a GPU in a thread, which takes half a second in which no Python runs.

    Warp's own start finds both there, or waits for them. A driver that cannot start is left to Warp, which reports why.

    Args:
        device: a Warp device's name such as "cuda:0"; the first GPU, if missing. A CPU has none to start.
    """
    named = re.fullmatch(r"cuda(?::(\d+))?", device or "cuda")
    if named:
        _begin(int(named[1] or 0))


@cache
def _begin(number: int) -> None:
    Thread(target=_retain_context, args=[number], name="driver").start()


def _retain_context(number: int) -> None:
    """Retain the context until the process ends, as Warp does."""
    try:
        driver = ctypes.CDLL(LIBRARY)
    except OSError:  # no GPU
        return
    device, context = ctypes.c_int(), ctypes.c_void_p()
    if driver.cuInit(0) == 0 and driver.cuDeviceGet(ctypes.byref(device), number) == 0:
        driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)
