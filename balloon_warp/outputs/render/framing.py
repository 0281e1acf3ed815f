"""What the pictures of a stage have in common: where the action is, how large it is, and a camera on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.outputs.render.camera import Camera, CameraFit
from balloon_warp.outputs.render.stage_reader import RenderStage

MOST_FRAMES = 40
"""frames that are looked at to find out where the action is"""


@dataclass(frozen=True)
class Framing:
    """The union over some frames of everything but the ground, with Y up, in the stage's unit."""

    center: NDArray[np.float64]
    """the middle of its bounding box, shape (3,)"""
    size: float
    """the longest side of its bounding box"""
    camera: Camera
    """a camera that has it all in the picture"""


def frame_action(stage: RenderStage, frames: list[int], aspect: float) -> Framing:
    """Look where the action is in some frames.

    Args:
        stage: its prims have been read.
        frames: the frames that will be shown.
        aspect: the picture's width over its height.

    Raises:
        InputError: everything is in one point.
    """
    fit = CameraFit(aspect)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    looked_at = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))
    for frame in (frames[place] for place in looked_at):
        capsules = stage.capsules(frame)
        used = [points[mesh.used] for points, mesh in zip(stage.points(frame), stage.meshes, strict=True)]
        centers = np.concatenate([capsules.begins, capsules.ends, *used])
        radii = np.concatenate([capsules.radii, capsules.radii, *(np.zeros(len(points)) for points in used)])
        fit.include(centers, radii)
        lower = np.minimum(lower, (centers - radii[:, None]).min(axis=0))
        upper = np.maximum(upper, (centers + radii[:, None]).max(axis=0))
    size = float((upper - lower).max())
    if not size > 0.0:
        raise InputError(f"{stage.path}: all that it shows is in one point")
    return Framing(0.5 * (lower + upper), size, fit.camera())
