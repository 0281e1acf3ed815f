"""View of a stage: direction, distance, target, and whether the camera follows."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError, did_you_mean
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.usd.material import SHOWN, is_called, is_shown
from balloon_warp.usd.studio import AZIMUTH, ELEVATION, Z_TO_Y_UP, Camera, CameraFit

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


Point = tuple[float, float, float]
CLEAR = (".png", ".webp")
"""Formats with transparency"""
ZOOM = (0.01, 100.0)
"""Range of the zoom factor"""
MOST_NAMES = 8
"""Largest number of names in a sentence"""


@dataclass(frozen=True)
class View:
    """Requested view."""

    azimuth: float | None = None
    """Azimuth from the front, +Z, or -Y where Z is up, toward +X [degrees]; `AZIMUTH` when missing"""
    elevation: float | None = None
    """Elevation above the horizon [degrees]; `ELEVATION` when missing"""
    zoom: float | None = None
    """Zoom factor; 1 when missing"""
    look_at: str | Point | None = None
    """Name of a prim, or a point of the stage, in the middle; the middle of the action when missing"""
    follow: bool = False
    """Whether the camera follows its target, which is the balloons when nothing is named"""
    aperture: float = 0.0
    """Diameter of the lens, in the stage's unit: things nearer or farther than `focus` are blurred; 0 for a pinhole"""
    focus: str | Point | None = None
    """Name of a prim, or a point of the stage, in focus; the middle of the picture when missing"""

    def check(self) -> None:
        """Check that numbers make sense.

        Raises:
            InputError: A number makes no sense.
        """
        if self.azimuth is not None and not math.isfinite(self.azimuth):
            raise InputError(f"azimuth: {self.azimuth:g} degrees; expected a finite angle")
        if self.elevation is not None and not 0.0 <= self.elevation <= 90.0:
            raise InputError(f"elevation: {self.elevation:g} degrees; expected 0 to 90")
        if self.zoom is not None and not ZOOM[0] <= self.zoom <= ZOOM[1]:
            raise InputError(f"zoom: {self.zoom:g}; expected {ZOOM[0]:g} to {ZOOM[1]:g}")
        if isinstance(self.look_at, tuple):
            if not all(map(math.isfinite, self.look_at)):
                raise InputError(f"look-at: {self.look_at}; expected finite numbers")
            if self.follow:
                raise InputError("follow: a point does not move; expected a prim as look-at, or no look-at")
        if not 0.0 <= self.aperture < math.inf:
            raise InputError(f"aperture: {self.aperture:g}; expected the lens's diameter, 0 or more")
        if isinstance(self.focus, tuple) and not all(map(math.isfinite, self.focus)):
            raise InputError(f"focus: {self.focus}; expected finite numbers")
        if self.focus is not None and self.aperture == 0.0:
            raise InputError("focus: needs an aperture")

    @property
    def from_own_place(self) -> bool:
        """Return whether the stage's camera is ignored."""
        return (self.azimuth, self.elevation, self.look_at, self.follow) != (None, None, None, False)

    def cameras(
        self, stage: RenderStage, frames: Sequence[int], aspect: float
    ) -> tuple[Framing, Callable[[int], Camera]]:
        """Return the framing of the action at some frames, and the camera of each.

        Raises:
            InputError: everything is in one point, or there is nothing of that name.
        """
        own_first = not self.from_own_place
        return self._over(stage.picture_view)._cameras(stage, frames, aspect, own_first)

    def _over(self, said: dict[str, Any]) -> "View":
        """Return the view with the stage's values where nothing is asked.

        A camera that follows something ignores them.
        """
        names = ("azimuth", "elevation") if self.follow else ("azimuth", "elevation", "zoom", "look_at")
        return replace(self, **{name: said[name] for name in names if name in said and getattr(self, name) is None})

    def _cameras(
        self, stage: RenderStage, frames: Sequence[int], aspect: float, own_first: bool
    ) -> tuple[Framing, Callable[[int], Camera]]:
        azimuth = AZIMUTH if self.azimuth is None else self.azimuth
        elevation = ELEVATION if self.elevation is None else self.elevation
        framing = frame_action([(stage, frame) for frame in frames], aspect, azimuth, elevation)
        if self.follow:
            fit = CameraFit(aspect, azimuth, elevation)
            for frame in frames:
                subject = self._subject(stage, frame, self.look_at)
                fit.include(subject - _middle(subject))
            fitted = fit.camera()

            def camera(frame: int) -> Camera:
                return replace(fitted, eye=fitted.eye + _middle(self._subject(stage, frame, self.look_at)))
        else:
            moved = framing.camera
            if self.look_at is not None:
                looked_at = _middle(self._subject(stage, frames[0], self.look_at))
                moved = moved.looking_at(looked_at, framing.center)

            def camera(frame: int) -> Camera:
                own = stage.camera(frame, aspect) if own_first else None
                return own or moved

        return framing, lambda frame: self._with_lens(camera(frame).zoomed(self.zoom or 1.0), stage, frame, framing)

    def _with_lens(self, camera: Camera, stage: RenderStage, frame: int, framing: Framing) -> Camera:
        if self.aperture == 0.0:
            return camera
        named = self.look_at if self.focus is None else self.focus
        sharp = framing.center if named is None else _middle(self._subject(stage, frame, named))
        return replace(camera, aperture=self.aperture, focus=float((camera.eye - sharp) @ camera.axes[2]))

    def _subject(self, stage: RenderStage, frame: int, named: str | Point | None) -> NDArray[np.float64]:
        """Return the points of the named prim or place, Y up, shape (n, 3); of the balloons if none is named."""
        if named is None:
            shapes = zip(stage.points(frame), stage.meshes, strict=True)
            soft = [points[mesh.used] for points, mesh in shapes if mesh.soft]
            if not soft:
                raise InputError(f"{stage.path}: has no balloon to follow; expected a prim as look-at")
            return np.concatenate(soft)
        turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage.stage) == UsdGeom.Tokens.z else np.eye(3)
        if not isinstance(named, str):
            return np.array([named]) @ turn
        prims = [prim for prim in stage.stage.Traverse() if is_called(prim, named)]
        bounds = UsdGeom.BBoxCache(Usd.TimeCode(frame), [*SHOWN, UsdGeom.Tokens.proxy])  # a string's curve is a proxy
        boxes = [bounds.ComputeWorldBound(prim).ComputeAlignedRange() for prim in prims]
        boxes = [box for box in boxes if not box.IsEmpty()]
        if not boxes:
            raise self._unknown(named, stage.stage, stage.path)
        return np.array([boxes[0].GetCorner(corner) for corner in range(8)]) @ turn

    def check_names(self, stage: Usd.Stage, path: Path) -> None:
        """Check the names of prims before anything is simulated.

        Args:
            stage: Stage with its prims, and perhaps without frames.
            path: Path of the stage.

        Raises:
            InputError: It has nothing of a name.
        """
        for named in (self.look_at, self.focus):
            if isinstance(named, str) and not any(is_called(prim, named) for prim in stage.Traverse()):
                raise self._unknown(named, stage, path)

    def _unknown(self, named: str, stage: Usd.Stage, path: Path) -> InputError:
        """Return the error for a name of nothing visible."""
        place = "look-at" if named == self.look_at else "focus"
        seen = [prim.GetName() for prim in stage.Traverse() if UsdGeom.Gprim(prim) and is_shown(prim)]
        known = did_you_mean(named, seen) or f"; visible are {', '.join(seen[:MOST_NAMES])}"
        return InputError(f"{place}: {named!r} is not visible in {path}{known}")


def check_view(output: Path, shutter: float = 0.0, transparent: bool = False, **asked: Any) -> View:
    """Return the view of a picture, once it is known to make sense.

    Args:
        asked: Fields of a `View`.

    Raises:
        InputError: It does not.
    """
    view = View(**asked)
    view.check()
    if not 0.0 <= shutter <= 1.0:
        raise InputError(f"shutter: {shutter:g}; expected 0 to 1 of a frame")
    if transparent and output.suffix.lower() not in CLEAR:
        raise InputError(f"transparent: {output.name} has no transparency; expected {' or '.join(CLEAR)}")
    return view


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the center of the bounding box."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
