"""The choice of a Warp device by name."""

import os

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.warp_lock import PROCESS_LOCK, record_by_thread
from balloon_warp.warp_logging import quiet_warp


def pick_device(name: str | wp.Device | None) -> wp.Device:
    """Return the device of that name, such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU. Starts Warp.

    Raises:
        InputError: there is no such device, or it is a GPU and this process a fork.
    """
    with PROCESS_LOCK:
        started_by = quiet_warp()
        record_by_thread()
    try:
        device = wp.get_device(name) if name else wp.get_preferred_device()
    except (ValueError, TypeError, AttributeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"device {name}: no such device; this machine has {known}") from None
    if device.is_cuda and started_by != os.getpid():
        raise InputError(
            f"{device}: this process was forked from one that uses the GPU, and CUDA works in no fork; "
            'start it with multiprocessing.get_context("spawn"), or choose device="cpu"'
        )
    return device
