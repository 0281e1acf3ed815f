"""Placement of the lights: over the photographer's left shoulder, and behind the subject on the right."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.pictures.studio import KEY, KEY_RADIANCE, Studio
from balloon_warp.mesh.looks import Color
from balloon_warp.outputs.camera import KEY_AZIMUTH, Camera, turned
from balloon_warp.scene.colors import GROUND_COLOR

RIM = (0.95, 0.28, -0.15)
"""Direction to the strip light"""
KEY_SPREAD = 0.15


def light_studio(camera: Camera, paper: Color = GROUND_COLOR, light: float = KEY_AZIMUTH) -> Any:
    """Return the lights for a camera. They turn with it, but only around the vertical.

    Args:
        paper: color of the backdrop, linear RGB.
        light: azimuth of the key light from the camera toward its right [degrees].
    """
    axes = turned(camera.level_axes, light)
    studio = Studio()
    for name, toward in (("key", KEY), ("rim", RIM)):
        direction = _unit(np.array(toward) @ axes)
        across = _unit(np.cross([0.0, 1.0, 0.0], direction))
        for suffix, vector in (("", direction), ("_right", across), ("_up", np.cross(direction, across))):
            setattr(studio, name + suffix, wp.vec3(*vector))
    studio.key_radiance = wp.vec3(*KEY_RADIANCE)
    studio.paper = wp.vec3(*(np.array(paper) / GROUND_COLOR))
    studio.key_spread = KEY_SPREAD
    return studio


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
