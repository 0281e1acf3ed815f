"""The choice of a Warp device by name."""

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.warp_lock import PROCESS_LOCK, record_by_thread
from balloon_warp.warp_logging import quiet_warp


def pick_device(name: str | wp.Device | None) -> wp.Device:
    """Return the device of that name, such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU. Starts Warp.

    Raises:
        InputError: there is no such device.
    """
    with PROCESS_LOCK:
        quiet_warp()
        record_by_thread()
    try:
        return wp.get_device(name) if name else wp.get_preferred_device()
    except (ValueError, TypeError, AttributeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"--device {name}: no such device; this machine has {known}") from None
