"""Framing of pictures that belong together: place and size of the action, and a camera on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.outputs.camera import AZIMUTH, ELEVATION, Camera, CameraFit
from balloon_warp.outputs.render.stage_reader import RenderStage

MOST_FRAMES = 40
"""Number of moments sampled to find the action"""
BACKDROP = 12.0
"""Size of a rigid mesh, over that of all soft meshes together, beyond which it is a floor or a wall"""


@dataclass(frozen=True)
class Framing:
    """The union over some moments of everything but ground, water and backdrops, with Y up, in the stage's unit."""

    center: NDArray[np.float64]
    """Center of the bounding box, shape (3,)"""
    size: float
    """Longest side of its bounding box"""
    camera: Camera
    """Camera that has it all in the picture"""


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
        used = _without_backdrops(stage, frame)
        centers = np.concatenate([capsules.begins, capsules.ends, *used])
        radii = np.concatenate([capsules.radii, capsules.radii, *(np.zeros(len(points)) for points in used)])
        fit.include(centers, radii)
        lower = np.minimum(lower, (centers - radii[:, None]).min(axis=0))
        upper = np.maximum(upper, (centers + radii[:, None]).max(axis=0))
    size = float((upper - lower).max())
    if not size > 0.0:
        raise InputError(f"{moments[0][0].path}: all visible geometry is at one point")
    return Framing(0.5 * (lower + upper), size, fit.camera())


def _without_backdrops(stage: RenderStage, frame: int) -> list[NDArray[np.float64]]:
    """Return the points of each mesh, without rigid ones that are far larger than the soft parts."""
    used = [points[mesh.used] for points, mesh in zip(stage.points(frame), stage.meshes, strict=True)]
    soft = [points for points, mesh in zip(used, stage.meshes, strict=True) if mesh.soft]
    if not soft:
        return used
    most = BACKDROP * float(np.ptp(np.concatenate(soft), axis=0).max())
    pairs = zip(used, stage.meshes, strict=True)
    return [points for points, mesh in pairs if mesh.soft or np.ptp(points, axis=0).max() <= most]
