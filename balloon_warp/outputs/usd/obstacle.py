"""Obstacle in the stage: a gprim of its shape, and a collider for other simulators.

Position and rotation have time samples where it moves.
"""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Model
from balloon_warp.model.obstacle_motion import moves, obstacle_poses
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.outputs.beveled import beveled_box
from balloon_warp.outputs.usd.looks import paint_as_file, place_texture
from balloon_warp.outputs.usd.material import Color, paint
from balloon_warp.outputs.usd.names import prim_names
from balloon_warp.outputs.usd.planes import SIZES, level_square
from balloon_warp.outputs.usd.rigid import SURFACE, be_hit, be_moved
from balloon_warp.scene import Body, Obstacle, Scene
from balloon_warp.scene.colors import OBSTACLE_COLOR, looks_of_file

HALF_SPACE = "balloonWarpHalfSpace"
"""Key of the custom data of a square that stands for the half space below it"""
ROUGHNESS = 0.45
"""Roughness as of oiled wood, or of painted metal"""


class Look(NamedTuple):
    """Look of obstacles besides their shapes."""

    up_axis: str
    middle: NDArray[np.float64]
    """Point below which a plane is drawn [m], shape (3,)"""
    half: float
    """Half the side of the square that is drawn of a plane [m]"""


def obstacle_names(scene: Scene, taken: Collection[str] = ()) -> list[str]:
    """Return a prim name for each obstacle: its own, or its shape's."""
    return prim_names((obstacle.name or obstacle.shape for obstacle in scene.obstacle), taken)


def define_obstacle(
    stage: Usd.Stage,
    path: Sdf.Path,
    obstacle: Obstacle | Body,
    shape: ObstacleShape,
    pose: NDArray[np.float64],
    look: Look,
    otherwise: Color = OBSTACLE_COLOR,
) -> UsdGeom.Gprim:
    """Define an obstacle's gprim and material, with ops for position and rotation without values.

    Args:
        pose: Pose at the start, as in `obstacle_poses`, shape (7,).
        otherwise: Color where neither the scene nor the mesh's file has one.
    """
    if shape.mesh is not None:
        prim = _define_mesh(stage, path, shape.mesh)
    elif shape.kind == "box":
        prim = _define_box(stage, path, shape.size)
    elif shape.kind == "capsule":
        prim = _define_capsule(stage, path, float(shape.size[0]), float(shape.size[1]), look.up_axis)
    else:
        prim = _define_plane(stage, path, pose, look)
    prim.AddTranslateOp()
    prim.AddOrientOp()
    own = obstacle.color or otherwise
    if shape.mesh is not None and (looks := looks_of_file(shape.mesh, obstacle)):
        paint_as_file(UsdGeom.Mesh(prim), shape.mesh, looks, own, roughness=ROUGHNESS)
    else:
        paint(prim, own, roughness=ROUGHNESS)
    return prim


def as_gf(pose: NDArray[np.floating]) -> tuple[Gf.Vec3d, Gf.Quatf]:
    """Return a pose as its ops have it."""
    x, y, z, w = pose[3:].tolist()
    return Gf.Vec3d(*pose[:3].tolist()), Gf.Quatf(w, x, y, z)


class ObstaclePrim:
    """Obstacle of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        points = np.concatenate([shape.mesh.points for shape in model.shapes])
        middle, half = 0.5 * (points.min(axis=0) + points.max(axis=0)), SIZES * float(np.ptp(points, axis=0).max())
        positions = model.parameters["obstacle_position"].numpy()[0]
        pose = obstacle_poses(positions, np.asarray(model.obstacle_motion.numpy(), dtype=np.float32), 0)[number]
        self.prim = define_obstacle(
            stage,
            path,
            model.scene.obstacle[number],
            model.obstacles[number],
            pose,
            Look(model.scene.up_axis, middle, half),
        )
        self._place, self._turn = self.prim.GetOrderedXformOps()[:2]
        self._moves = moves(model.scene, number, (change.values for change in model.due_changes))
        self._put(pose, Usd.TimeCode.Default())
        be_hit(
            self.prim.GetPrim(), *(float(model.parameters[f"obstacle_{each}"].numpy()[0, number]) for each in SURFACE)
        )
        if self._moves:
            be_moved(self.prim.GetPrim())

    def write(self, frame: Frame) -> None:
        """Write the obstacle's pose, if it moves: one at rest has no time samples."""
        if self._moves:
            self._put(frame.obstacle_poses[self.number], Usd.TimeCode(frame.number))

    def _put(self, pose: NDArray[np.float64], time: Usd.TimeCode) -> None:
        for op, value in zip((self._place, self._turn), as_gf(pose), strict=True):
            op.Set(value, time)


def _define_mesh(stage: Usd.Stage, path: Sdf.Path, mesh: PolygonMesh) -> UsdGeom.Mesh:
    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateDoubleSidedAttr(True)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    place_texture(prim, mesh)
    return prim


def _define_box(stage: Usd.Stage, path: Sdf.Path, half: NDArray[np.float64]) -> UsdGeom.Mesh:
    box, normals = beveled_box(half)
    prim = _define_mesh(stage, path, box)
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    # Physics takes it for the box that it is.
    UsdPhysics.MeshCollisionAPI.Apply(prim.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.boundingCube)
    return prim


def _define_capsule(
    stage: Usd.Stage, path: Sdf.Path, radius: float, half_length: float, up_axis: str
) -> UsdGeom.Capsule:
    prim = UsdGeom.Capsule.Define(stage, path)
    prim.CreateAxisAttr(up_axis)
    prim.CreateRadiusAttr(radius)
    prim.CreateHeightAttr(2.0 * half_length)
    reach = np.full(3, radius)
    reach["XYZ".index(up_axis)] += half_length
    prim.CreateExtentAttr([Gf.Vec3f(*(sign * reach).tolist()) for sign in (-1.0, 1.0)])
    return prim


def _define_plane(stage: Usd.Stage, path: Sdf.Path, pose: NDArray[np.float64], look: Look) -> UsdGeom.Mesh:
    """Return a square of it, below the middle at the start."""
    prim = UsdGeom.Mesh.Define(stage, path)
    from scipy.spatial.transform import Rotation  # takes long to load

    below = Rotation.from_quat(pose[3:]).inv().apply(look.middle - pose[:3])
    square = level_square(below, look.half, 0.0, look.up_axis)
    prim.GetPrim().SetCustomDataByKey(HALF_SPACE, True)
    prim.CreatePointsAttr(square)
    prim.CreateFaceVertexCountsAttr([4])
    prim.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateDoubleSidedAttr(True)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(square))
    return prim
