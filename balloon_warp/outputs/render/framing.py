"""What pictures that belong together have in common: where the action is, how large it is, and a camera on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.outputs.render.camera import AZIMUTH, ELEVATION, Camera, CameraFit
from balloon_warp.outputs.render.stage_reader import RenderStage

MOST_FRAMES = 40
"""moments that are looked at to find out where the action is"""


@dataclass(frozen=True)
class Framing:
    """The union over some moments of everything but ground and water, with Y up, in the stage's unit."""

    center: NDArray[np.float64]
    """the middle of its bounding box, shape (3,)"""
    size: float
    """the longest side of its bounding box"""
    camera: Camera
    """a camera that has it all in the picture"""


def frame_action(
    moments: Sequence[tuple[RenderStage, int]], aspect: float, azimuth: float = AZIMUTH, elevation: float = ELEVATION
) -> Framing:
    """Look where the action is at some moments.

    Args:
        moments: the stages and frames that will be shown; the stages' prims have been read.
        aspect: the picture's width over its height.
        azimuth, elevation: where one looks from, as `CameraFit` has them [degrees].

    Raises:
        InputError: everything is in one point.
    """
    fit = CameraFit(aspect, azimuth, elevation)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    looked_at = np.unique(np.linspace(0, len(moments) - 1, min(len(moments), MOST_FRAMES)).round().astype(int))
    for stage, frame in (moments[place] for place in looked_at):
        capsules = stage.capsules(frame)
        used = [points[mesh.used] for points, mesh in zip(stage.points(frame), stage.meshes, strict=True)]
        centers = np.concatenate([capsules.begins, capsules.ends, *used])
        radii = np.concatenate([capsules.radii, capsules.radii, *(np.zeros(len(points)) for points in used)])
        fit.include(centers, radii)
        lower = np.minimum(lower, (centers - radii[:, None]).min(axis=0))
        upper = np.maximum(upper, (centers + radii[:, None]).max(axis=0))
    size = float((upper - lower).max())
    if not size > 0.0:
        raise InputError(f"{moments[0][0].path}: all that it shows is in one point")
    return Framing(0.5 * (lower + upper), size, fit.camera())
