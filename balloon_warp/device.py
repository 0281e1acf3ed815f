"""The choice of a Warp device by name."""

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.quiet import quiet_warp
from balloon_warp.turns import ALONE, record_by_thread


def pick_device(name: str | wp.Device | None) -> wp.Device:
    """The device of that name, such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU. Starts Warp.

    Raises:
        InputError: there is no such device.
    """
    with ALONE:
        quiet_warp()
        record_by_thread()
    try:
        return wp.get_device(name) if name else wp.get_preferred_device()
    except (ValueError, TypeError, AttributeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"--device {name}: no such device; this machine has {known}") from None
