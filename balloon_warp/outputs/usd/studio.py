"""Lights, a backdrop, and a camera that has the run in view, in a group of their own that can be left out or deleted.

They stand around the subject as the camera sees it, and so are defined once the run is over.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from balloon_warp.outputs.camera import KEY_AZIMUTH, turned
from balloon_warp.outputs.moment import Moment
from balloon_warp.outputs.usd.backdrop import define_backdrop
from balloon_warp.outputs.usd.camera import as_pictured, define_camera, fit_for
from balloon_warp.outputs.usd.lights import define_lights
from balloon_warp.scene import Scene
from balloon_warp.scene.colors import paper_of

HOME = Sdf.Path("/World/Studio")
GROUND, OBSTACLES = Sdf.Path("/World/Ground"), Sdf.Path("/World/Obstacles")
MOST_FRAMES = 40
"""Number of frames sampled to find the subject's place"""
HOVER = 0.6
"""Height of the subject above the floor where nothing stands on one, in sizes of the subject"""
LARGE = 12.0
"""Size of an obstacle, in sizes of the subject, from which on it is a floor or a wall itself"""
BELOW = 1e-3
"""Depth of the backdrop below the things that stand on it, in sizes of the subject"""


@dataclass
class Bounds:
    """The box around all points that were taken in, Y up."""

    lower: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    """Lowest corner, shape (3,)"""
    upper: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    """Highest corner, shape (3,)"""

    def include(self, points: NDArray[np.float64]) -> None:
        """Take in points, shape (n, 3)."""
        self.lower = np.minimum(self.lower, points.min(axis=0))
        self.upper = np.maximum(self.upper, points.max(axis=0))

    @property
    def center(self) -> NDArray[np.float64]:
        """Center, shape (3,)."""
        return 0.5 * (self.lower + self.upper)

    @property
    def size(self) -> float:
        """Longest side; not finite without points."""
        return float((self.upper - self.lower).max())


def define_studio(
    stage: Usd.Stage, scene: Scene, paths: Sequence[Sdf.Path], frames: Sequence[int], *, backdrop: bool = True
) -> None:
    """Define a camera, and lights and a backdrop around its subject; nothing where there is no subject.

    Args:
        scene: whose picture says from where to look.
        paths: of the prims that matter.
        frames: whose time samples are there.
        backdrop: whether there is one.
    """
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))
    moments = [frames[place] for place in chosen.tolist()]
    fit, subject = fit_for(scene), Bounds()
    for points in _points(stage, paths, moments):
        fit.include(points)
        subject.include(points)
    if not np.isfinite(subject.size) or subject.size <= 0.0:
        return
    shown, center, size = replace(subject), subject.center, subject.size
    lowest = subject.lower[1]
    for points in _obstacles(stage, size, moments):
        lowest = min(lowest, points[:, 1].min())
        if scene.picture is not None:  # whose zoom is of all that is shown
            fit.include(points)
            shown.include(points)
    home = UsdGeom.Xform.Define(stage, HOME)
    if scene.up_axis == "Z":  # its children are placed as if Y were up
        home.AddRotateXOp().Set(90.0)
    camera = as_pictured(fit.camera(), shown.center, scene)
    define_camera(stage, HOME.AppendChild("Camera"), camera, center)
    said = scene.picture and scene.picture.light
    define_lights(stage, HOME, center, turned(camera.level_axes, KEY_AZIMUTH if said is None else said), size)
    if backdrop:
        heights = [points[:, 1].min() for points in _points(stage, [GROUND], moments)]
        hovers = lowest == subject.lower[1]
        floor = min(heights, default=lowest - HOVER * size if hovers else lowest)
        foot = np.array([center[0], floor - BELOW * size, center[2]])
        define_backdrop(stage, HOME.AppendChild("Backdrop"), foot, camera.level_axes, size, paper_of(scene))


def _obstacles(stage: Usd.Stage, size: float, moments: Sequence[int]) -> Iterator[NDArray[np.float64]]:
    """Return the points of those that are no floor or wall themselves, shape (n, 3) each."""
    obstacles = stage.GetPrimAtPath(OBSTACLES)
    paths = [prim.GetPath() for prim in obstacles.GetChildren()] if obstacles else []
    return (points for points in _points(stage, paths, moments) if np.ptp(points, axis=0).max() < LARGE * size)


def _points(stage: Usd.Stage, paths: Sequence[Sdf.Path], moments: Sequence[int]) -> Iterator[NDArray[np.float64]]:
    """Return the points of each mesh at some frames, or the corners of other prims' boxes, Y up, shape (n, 3) each."""
    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    prims = [prim for path in paths if (prim := stage.GetPrimAtPath(path))]
    for frame in moments:
        moment, boxes = Moment(stage, frame), UsdGeom.BBoxCache(Usd.TimeCode(frame), purposes)
        for prim in prims:
            if UsdGeom.Mesh(prim):
                points = _seen(UsdGeom.Mesh(prim), frame)
            elif UsdGeom.PointBased(prim):
                points = UsdGeom.PointBased(prim).GetPointsAttr().Get(frame)
            else:
                box = boxes.ComputeUntransformedBound(prim).ComputeAlignedRange()
                points = [] if box.IsEmpty() else [box.GetCorner(number) for number in range(8)]
            if len(points):
                yield moment.place(prim, np.array(points, np.float64))


def _seen(mesh: UsdGeom.Mesh, frame: int) -> NDArray[np.float64]:
    """Return the points of a mesh at a frame, without those that a tear cut off from all faces, shape (n, 3)."""
    points, corners = np.array(mesh.GetPointsAttr().Get(frame)), mesh.GetFaceVertexIndicesAttr()
    if not corners.GetNumTimeSamples():
        return points
    counts, numbers = np.array(mesh.GetFaceVertexCountsAttr().Get(frame)), np.array(corners.Get(frame))
    begins = np.cumsum(counts) - counts
    is_there = np.logical_or.reduceat(numbers != np.repeat(numbers[begins], counts), begins)
    return points[np.unique(numbers[np.repeat(is_there, counts)])] if is_there.any() else points
