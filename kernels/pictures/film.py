"""Conversion of light to a picture's bytes."""

import warp as wp

from balloon_warp.kernels.pictures.studio import mix


@wp.func
def tone(light: wp.vec3):
    """Map tones by Khronos PBR Neutral (2024): it keeps the colors of things, and compresses only highlights."""
    low = wp.min(light)
    lifted = wp.where(low < 0.08, low - 6.25 * low * low, 0.04)
    color = light - wp.vec3(lifted)
    peak = wp.max(color)
    if peak < 0.76:
        return color
    shown = 1.0 - 0.24 * 0.24 / (peak + 0.24 - 0.76)
    return mix(wp.vec3(shown), (shown / peak) * color, 1.0 / (0.15 * (peak - shown) + 1.0))


@wp.func
def srgb_byte(shown: float):
    """Return the sRGB transfer function (IEC 61966-2-1), in 256 steps."""
    encoded = 12.92 * shown
    if shown > 0.0031308:
        encoded = 1.055 * wp.pow(wp.min(shown, 1.0), 1.0 / 2.4) - 0.055
    return wp.uint8(255.0 * encoded + 0.5)
