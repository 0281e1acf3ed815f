"""Pictures of a time that is not short: several moments of it, one over the other."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

MOMENTS = 8
"""Number of moments within the shutter time"""


def moments(frame: int, shutter: float, last_frame: int) -> list[float]:
    """Return evenly spaced times within the shutter time, which begins at the frame, or ends at the last one.

    Args:
        shutter: how long that is, in frames.
    """
    if shutter == 0.0:
        return [frame]
    begin = min(float(frame), last_frame - shutter)
    return [begin + shutter * (number + 0.5) / MOMENTS for number in range(MOMENTS)]


def one_over_the_other(pictures: Iterable[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the mean of pictures, as light adds up; clear pixels add no light."""
    several = list(pictures)
    total = np.zeros(1)
    for picture in several:
        light = LINEAR[picture[..., :3]]
        cover = picture[..., 3:] / 255.0 if picture.shape[2] == 4 else np.ones((1, 1, 1))
        total = total + np.concatenate([light * cover, np.broadcast_to(cover, (*light.shape[:2], 1))], axis=2)
    light = total[..., :3] / np.maximum(total[..., 3:], 1e-9)
    shown = np.searchsorted(_STEPS, light).astype(np.uint8)
    if several[0].shape[2] == 3:
        return shown
    return np.concatenate([shown, np.rint(255.0 * total[..., 3:] / len(several)).astype(np.uint8)], axis=2)


def _linear(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the inverse of sRGB's transfer function."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


LINEAR = _linear(np.arange(256) / 255.0)
"""Linear light of each byte of sRGB"""
_STEPS = _linear((np.arange(255) + 0.5) / 255.0)
