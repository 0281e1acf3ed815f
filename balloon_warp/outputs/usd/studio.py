"""Lights, a backdrop, and a camera that has the run in view, in a group of their own that can be left out or deleted.

They stand around the subject as the camera sees it, and so are defined once the run is over.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from balloon_warp.outputs.usd.backdrop import define_backdrop
from balloon_warp.outputs.usd.camera import camera_of_run, define_camera
from balloon_warp.outputs.usd.lights import define_lights
from balloon_warp.scene import Scene

HOME = Sdf.Path("/World/Studio")
GROUND, OBSTACLES = Sdf.Path("/World/Ground"), Sdf.Path("/World/Obstacles")
MOST_FRAMES = 40
"""that the subject's place is found from"""
HOVER = 0.6
"""how far below the subject the floor is where nothing stands on one, in sizes of the subject"""
LARGE = 12.0
"""what an obstacle is, in sizes of the subject, that is a floor or a wall itself"""
BELOW = 1e-3
"""how far the backdrop lies below what stands on it, in sizes of the subject"""


def define_studio(
    stage: Usd.Stage, scene: Scene, paths: Sequence[Sdf.Path], frames: Sequence[int], *, backdrop: bool = True
) -> None:
    """Define a camera, and lights and a backdrop around what it sees; nothing where nothing is to be seen.

    Args:
        scene: whose picture says from where to look.
        paths: of the prims that matter.
        frames: whose time samples are there.
        backdrop: whether there is one.
    """
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))
    moments = [frames[place] for place in chosen.tolist()]
    points = np.concatenate([np.empty((0, 3)), *_points(stage, paths, moments)])
    if not len(points) or not np.isfinite(points).all() or not np.ptp(points, axis=0).max() > 0.0:
        return
    home = UsdGeom.Xform.Define(stage, HOME)
    if scene.up_axis == "Z":  # what is in it is placed as if Y were up
        home.AddRotateXOp().Set(90.0)
    center, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), float(np.ptp(points, axis=0).max())
    camera = camera_of_run(points, center, scene)
    define_camera(stage, HOME.AppendChild("Camera"), camera, center)
    level = camera.level_axes
    define_lights(stage, HOME, center, level, size)
    if backdrop:
        foot = np.array([center[0], _floor(stage, points, size, moments) - BELOW * size, center[2]])
        define_backdrop(stage, HOME.AppendChild("Backdrop"), foot, level, size)


def _floor(stage: Usd.Stage, points: NDArray[np.float64], size: float, moments: Sequence[int]) -> float:
    """How high it is: the ground's lowest height, or that of the lowest obstacle, or below all that moves."""
    if ground := _points(stage, [GROUND], moments):
        return float(np.concatenate(ground)[:, 1].min())
    lowest = float(points[:, 1].min())
    obstacles = stage.GetPrimAtPath(OBSTACLES)
    paths = [prim.GetPath() for prim in obstacles.GetChildren()] if obstacles else []
    stands = [box[:, 1].min() for box in _points(stage, paths, moments) if np.ptp(box, axis=0).max() < LARGE * size]
    return min([float(height) for height in stands if height < lowest], default=lowest - HOVER * size)


def _points(stage: Usd.Stage, paths: Sequence[Sdf.Path], moments: Sequence[int]) -> list[NDArray[np.float64]]:
    """The points of each mesh at some frames, and of what is none the corners of its box, Y up, shape (n, 3) each."""
    # A room that reads stages, and so loads this one.
    from balloon_warp.outputs.render.moment import Moment

    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    found: list[NDArray[np.float64]] = []
    prims = [prim for path in paths if (prim := stage.GetPrimAtPath(path))]
    for frame in moments:
        moment, boxes = Moment(stage, frame), UsdGeom.BBoxCache(Usd.TimeCode(frame), purposes)
        for prim in prims:
            if UsdGeom.PointBased(prim):
                points = UsdGeom.PointBased(prim).GetPointsAttr().Get(frame)
            else:
                box = boxes.ComputeUntransformedBound(prim).ComputeAlignedRange()
                points = [] if box.IsEmpty() else [box.GetCorner(number) for number in range(8)]
            if points:
                found.append(moment.place(prim, np.array(points, np.float64)))
    return found
