"""How one looks at a stage: from where, how near, at what, and whether one goes along with it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.outputs.render.camera import AZIMUTH, ELEVATION, Camera, CameraFit
from balloon_warp.outputs.render.framing import Framing, frame_action
from balloon_warp.outputs.render.moment import Z_TO_Y_UP
from balloon_warp.outputs.render.stage_reader import RenderStage

Point = tuple[float, float, float]
ZOOM = (0.01, 100.0)
"""least and most"""


@dataclass(frozen=True)
class View:
    """What is asked of the camera."""

    azimuth: float | None = None
    """from the front, +Z, or -Y where Z is up, toward +X [degrees]; `AZIMUTH` when missing"""
    elevation: float | None = None
    """from level toward above [degrees]; `ELEVATION` when missing"""
    zoom: float = 1.0
    """how many times as large everything is"""
    look_at: str | Point | None = None
    """a prim's name, or a point of the stage, that is in the middle; when missing, the middle of the action is"""
    follow: bool = False
    """whether the camera goes along with what it looks at, which are the balloons when nothing is named"""

    def check(self) -> None:
        """Raises:
        InputError: a number makes no sense.
        """
        if self.azimuth is not None and not math.isfinite(self.azimuth):
            raise InputError(f"azimuth: {self.azimuth:g} degrees; expected a finite angle")
        if self.elevation is not None and not 0.0 <= self.elevation <= 90.0:
            raise InputError(f"elevation: {self.elevation:g} degrees; expected 0 to 90")
        if not ZOOM[0] <= self.zoom <= ZOOM[1]:
            raise InputError(f"zoom: {self.zoom:g}; expected {ZOOM[0]:g} to {ZOOM[1]:g}")
        if isinstance(self.look_at, tuple):
            if not all(map(math.isfinite, self.look_at)):
                raise InputError(f"look-at: {self.look_at}; expected finite numbers")
            if self.follow:
                raise InputError("follow: a point does not move; expected look-at to name a prim, or nothing")

    @property
    def from_own_place(self) -> bool:
        """whether a camera of the stage is passed over"""
        return (self.azimuth, self.elevation, self.look_at, self.follow) != (None, None, None, False)

    def cameras(
        self, stage: RenderStage, frames: Sequence[int], aspect: float
    ) -> tuple[Framing, Callable[[int], Camera]]:
        """Where the action is at some frames, and the camera of each.

        Raises:
            InputError: everything is in one point, or there is nothing of that name.
        """
        azimuth = AZIMUTH if self.azimuth is None else self.azimuth
        elevation = ELEVATION if self.elevation is None else self.elevation
        framing = frame_action([(stage, frame) for frame in frames], aspect, azimuth, elevation)
        if self.follow:
            fit = CameraFit(aspect, azimuth, elevation)
            for frame in frames:
                subject = self._subject(stage, frame)
                fit.include(subject - _middle(subject))
            fitted = fit.camera()

            def camera(frame: int) -> Camera:
                return replace(fitted, eye=fitted.eye + _middle(self._subject(stage, frame)))
        else:
            moved = framing.camera
            if self.look_at is not None:
                backward = moved.axes[2]
                distance = float((moved.eye - framing.center) @ backward)
                moved = replace(moved, eye=_middle(self._subject(stage, frames[0])) + distance * backward)

            def camera(frame: int) -> Camera:
                own = None if self.from_own_place else stage.camera(frame, aspect)
                return own or moved

        return framing, lambda frame: self._zoomed(camera(frame))

    def _zoomed(self, camera: Camera) -> Camera:
        wide, high = camera.half_width / self.zoom, camera.half_height / self.zoom
        return replace(camera, half_width=wide, half_height=high)

    def _subject(self, stage: RenderStage, frame: int) -> NDArray[np.float64]:
        """Points of what is looked at, Y up, shape (n, 3)."""
        if self.look_at is None:
            shapes = zip(stage.points(frame), stage.meshes, strict=True)
            soft = [points[mesh.used] for points, mesh in shapes if mesh.soft]
            if not soft:
                raise InputError(f"{stage.path}: has no balloon to follow; expected look-at to name a prim")
            return np.concatenate(soft)
        turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage.stage) == UsdGeom.Tokens.z else np.eye(3)
        if not isinstance(self.look_at, str):
            return np.array([self.look_at]) @ turn
        named = [prim for prim in stage.stage.Traverse() if prim.GetName() == self.look_at]
        bounds = UsdGeom.BBoxCache(Usd.TimeCode(frame), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render])
        boxes = [bounds.ComputeWorldBound(prim).ComputeAlignedRange() for prim in named]
        boxes = [box for box in boxes if not box.IsEmpty()]
        if not boxes:
            raise InputError(f"look-at: {self.look_at!r} is nothing to be seen in {stage.path}; expected a prim's name")
        return np.array([boxes[0].GetCorner(corner) for corner in range(8)]) @ turn


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the bounding box."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
