"""Obstacles, free bodies, spheres, ground and water in the stage, and shapes that are drawn, not simulated.

Obstacle in the stage: a gprim of its shape, and a collider for other simulators.

Position and rotation have time samples where it moves.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, face_vector_areas, total_area
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.model import Model
from balloon_warp.model.obstacles import BodyShape, ObstacleShape, initial_centers, initial_turns, moves, obstacle_poses
from balloon_warp.scene import Balloon, Body, Obstacle, Scene, Sphere, String
from balloon_warp.scene.around import (
    BODY_COLORS,
    GROUND_COLOR,
    OBSTACLE_COLOR,
    SPHERE_COLORS,
    WATER_COLOR,
    looks_of_file,
    paper_of,
)
from balloon_warp.usd.material import (
    SURFACE,
    Color,
    make_collider,
    make_free_body,
    make_kinematic,
    paint,
    paint_as_file,
    place_texture,
    prim_names,
    show_while_there,
)

OF_LARGEST, OF_LEAST = 0.02, 0.25
"""Largest radius of the edges over the largest and over the least side"""
STEPS = np.radians([15.0, 30.0, 45.0])
"""Angles along an edge's quarter circle, from either side to its middle"""
RIM = 0.3
"""Width of the flat strip beside the edges, in radii: normals that a renderer finds bend there alone"""


def beveled_box(half: NDArray[np.float64]) -> tuple[PolygonMesh, NDArray[np.float64]]:
    """Return a box about the origin, and the unit normal of each of its points, shape (vertex_count, 3).

    Args:
        half: half its sides, shape (3,); the flat parts of its faces lie there exactly.
    """
    radius = 2.0 * min(OF_LARGEST * float(half.max()), OF_LEAST * float(half.min()))
    inner = half - radius
    edge = np.concatenate([[-RIM, 0.0], np.tan(STEPS)]) * radius
    lines = [np.concatenate([-(length + edge)[::-1], length + edge]) for length in inner]
    count = 2 * len(edge)
    corner = count * np.arange(count - 1)[:, None] + np.arange(count - 1)
    quad = np.stack([corner, corner + count, corner + count + 1, corner + 1], axis=-1).reshape(-1, 4)
    points, quads = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            u, v = np.meshgrid(lines[(axis + 1) % 3], lines[(axis + 2) % 3], indexing="ij")
            side = np.empty((count * count, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign * half[axis], u.ravel(), v.ravel()
            quads.append(len(points) * count * count + (quad if sign > 0.0 else quad[:, ::-1]))
            points.append(side)
    cube = np.concatenate(points)
    core = np.clip(cube, -inner, inner)
    normals = (cube - core) / np.linalg.norm(cube - core, axis=1, keepdims=True)
    _, first, same = np.unique(np.round(cube / half, 9), axis=0, return_index=True, return_inverse=True)
    corners = same.ravel()[np.concatenate(quads)].astype(np.int32)
    box = PolygonMesh((core + radius * normals)[first], np.full(len(corners), 4, np.int32), corners.ravel())
    return box, normals[first]


SIDES = 6
"""Number of sides of a line's cross section"""


def tube_topology(lengths: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the quads around curves, as `tube_points` places them: corners of each face, and of all."""
    goes_on = np.ones(int(lengths.sum()), bool)
    goes_on[np.cumsum(lengths)[lengths > 0] - 1] = False
    begins = np.flatnonzero(goes_on)
    side = np.arange(SIDES)
    after = (side + 1) % SIDES
    here = SIDES * begins[:, None]
    quads = np.stack([here + side, here + after, here + SIDES + after, here + SIDES + side], axis=-1).reshape(-1, 4)
    return np.full(len(quads), 4, np.int32), quads.ravel().astype(np.int32)


def tube_points(centers: NDArray[np.float64], lengths: NDArray[np.int32], radius: float) -> NDArray[np.float64]:
    """Return the points around curves: `SIDES` about each point, shape (SIDES * len(centers), 3).

    The cross section is carried along each curve with as little turning as can be, so that nothing is twisted.
    """
    rings = np.empty((len(centers), SIDES, 3))
    turn = 2.0 * np.pi * np.arange(SIDES)[:, None] / SIDES
    begin = 0
    for length in lengths.tolist():
        curve = centers[begin : begin + length]
        steps = np.diff(curve, axis=0, prepend=2.0 * curve[:1] - curve[1:2] if length > 1 else curve[:1] - 1.0)
        across = np.eye(3)[np.abs(steps[0]).argmin()] if length else np.zeros(3)
        for place, step in enumerate(steps):
            size = np.linalg.norm(step)
            direction = step / size if size > 0.0 else np.zeros(3)
            across = across - (across @ direction) * direction
            across = across / max(float(np.linalg.norm(across)), 1e-12)
            ring = np.cos(turn) * across + np.sin(turn) * np.cross(direction, across)
            rings[begin + place] = curve[place] + radius * ring
        begin += length
    return rings.reshape(-1, 3)


PROFILE = np.array(
    [
        *((-0.035, 0.028), (0.000, 0.026), (0.015, 0.018)),  # the neck, from under the balloon's surface
        *((0.025, 0.024), (0.040, 0.033), (0.055, 0.024)),  # the knot
        *((0.063, 0.016), (0.078, 0.024), (0.092, 0.038), (0.097, 0.036)),  # the lip, and its rolled rim
        *((0.084, 0.016), (0.076, 0.000)),  # the funnel in the lip, where the string comes out
    ]
)
"""Distance outward of each ring, and its radius, in `knot_size`"""
AROUND = 12
"""Number of points of a ring"""


def has_knot(string: String, balloon: Balloon) -> bool:
    """Return whether a knot shows where a string is tied; foil is not knotted."""
    return string.knot and balloon.looks_like != "foil"


class Knot:
    """Knot of one string.

    Args:
        mesh: Mesh of the balloon at the start.
        particle: Particle that the string holds, by its number in the mesh.
    """

    def __init__(self, mesh: PolygonMesh, particle: int):
        self.particle = particle
        faces = corner_faces(mesh)
        about = np.isin(faces, faces[mesh.face_vertex_indices == particle])
        self._used, corners = np.unique(mesh.face_vertex_indices[about], return_inverse=True)
        counts = mesh.face_vertex_counts[np.unique(faces[about])]
        self._around = PolygonMesh(mesh.points[self._used], counts, corners.reshape(-1).astype(np.int32))

    def pose(self, points: NDArray[np.floating], curve: NDArray[np.floating], up: ArrayLike) -> NDArray[np.float64]:
        """Return the pose of the knot.

        Args:
            points: Points of the balloon [m], shape (particle_count, 3).
            curve: Curve of the string, from its anchor to the particle [m], shape (n, 3).
            up: Unit vector: without rotation the knot hangs down.

        Returns:
            Position [m], and orientation as a quaternion (x, y, z, w), shape (7,).
        """
        place = points[self.particle].astype(np.float64)
        down = -np.asarray(up, float)
        return np.concatenate([place, turn_between(down, self._direction(points, curve, down))])

    def _direction(
        self, points: NDArray[np.floating], curve: NDArray[np.floating], otherwise: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the direction along the string, bent away from the balloon.

        It is never nearer to the balloon's surface than 45 degrees.
        """
        ends = curve.astype(np.float64)
        along = ends[-2] - ends[-1]
        normal = face_vector_areas(replace(self._around, points=points[self._used].astype(np.float64))).sum(axis=0)
        normal, along = (_unit(vector) for vector in (normal, along))
        if not normal.any():
            return along if along.any() else otherwise
        return _unit(along + (1.0 - along @ normal) * normal)


def knot_size(mesh: PolygonMesh) -> float:
    """Return the diameter of a sphere of a balloon's area at the start [m]: the unit of `PROFILE`."""
    return float(np.sqrt(total_area(mesh) / np.pi))


def knot_mesh(size: float, up: ArrayLike) -> PolygonMesh:
    """Return a knot that hangs down from the origin, in quads whose outside is outward.

    Args:
        size: as `knot_size` has it.
        up: unit vector, along an axis.
    """
    up = np.asarray(up, float)
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    out, radius = size * PROFILE[:-1].T
    side = np.roll(up, 1)
    other = np.cross(side, up)
    ring = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    points = (radius[:, None, None] * ring - out[:, None, None] * up).reshape(-1, 3)
    points = np.concatenate([points, [-size * PROFILE[-1, 0] * up]])
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    starts = AROUND * np.arange(len(out) - 1)[:, None]
    quads = np.stack([starts + here, starts + after, starts + AROUND + after, starts + AROUND + here], axis=-1)
    bottom = AROUND * (len(out) - 1)
    even = here[::2]
    closing = [bottom + even, bottom + even + 1, bottom + (even + 2) % AROUND, np.full_like(even, len(points) - 1)]
    indices = np.concatenate([quads.reshape(-1, 4), np.stack(closing, axis=1)]).astype(np.int32)
    return PolygonMesh(points, np.full(len(indices), 4, np.int32), indices.ravel())


def turn_between(one: NDArray[np.floating], other: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the quaternion (x, y, z, w) of the shortest turn from one unit vector to another."""
    half = 1.0 + float(one @ other)
    if half < 1e-9:  # half a turn, about any axis across
        across = np.cross(one, np.eye(3)[np.abs(one).argmin()])
        return np.append(_unit(across), 0.0)
    quaternion = np.append(np.cross(one, other), half)
    return quaternion / np.linalg.norm(quaternion)


def _unit(vector: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return a unit vector; a vector of no length stays as it is."""
    return vector.astype(np.float64) / max(float(np.linalg.norm(vector)), 1e-300)


SIZES = 20.0
"""Half the square's side, as a multiple of the scene's size"""


class Plane(NamedTuple):
    """Name and look of a level plane."""

    name: str
    """Name of the plane's prim"""
    piece: str
    """Name of the prims of worlds that each have their own, at their own height"""
    height: str
    """Name of the plane's height, in the model and in a frame"""
    color: Color
    roughness: float
    opacity: float


PLANES = {
    "ground": Plane("Ground", "Floor", "ground_height", GROUND_COLOR, roughness=0.9, opacity=1.0),
    "water": Plane("Water", "Pool", "water_level", WATER_COLOR, roughness=0.05, opacity=0.5),
}
"""Planes by their tables of the scene"""


def planes_of(scene: Scene) -> list[Plane]:
    """Return the planes that the scene has; its ground is of the paper of its picture."""
    planes = PLANES | {"ground": PLANES["ground"]._replace(color=paper_of(scene))}
    return [plane for table, plane in planes.items() if getattr(scene, table)]


def define_square(
    stage: Usd.Stage,
    path: Sdf.Path,
    plane: Plane,
    middle: NDArray[np.float64],
    half: float,
    height: float,
    up_axis: str,
) -> UsdGeom.Mesh:
    """Return a level square: `half` is half its side [m], `middle` a point above its center."""
    prim = UsdGeom.Mesh.Define(stage, path)
    square = level_square(middle, half, height, up_axis)
    prim.CreatePointsAttr(square)
    prim.CreateFaceVertexCountsAttr([4])
    prim.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(square))
    prim.GetPrim().SetCustomDataByKey(SCENERY, plane.name)
    paint(prim, plane.color, roughness=plane.roughness, opacity=plane.opacity)
    return prim


class PlanePrim:
    """A plane of the scene: a square around the balloons as they are at the start."""

    def __init__(self, stage: Usd.Stage, plane: Plane, model: Model):
        points = np.concatenate([shape.mesh.points for shape in model.shapes])
        self.plane, self.up_axis = plane, model.scene.up_axis
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.half = SIZES * float(np.ptp(points, axis=0).max())
        self._moves = any(plane.height in change.values for change in model.due_changes)
        height = float(model.parameters[plane.height].numpy()[0])
        path = Sdf.Path(f"/World/{plane.name}")
        self.prim = define_square(stage, path, plane, self.middle, self.half, height, self.up_axis)
        if plane.name == "Ground":
            make_collider(
                self.prim.GetPrim(), *(float(model.parameters[f"ground_{each}"].numpy()[0]) for each in SURFACE)
            )

    def write(self, frame: Frame) -> None:
        """Write the plane's height, if the scene moves it: one at rest has no time samples."""
        if self._moves:
            self._place(getattr(frame, self.plane.height), frame.number)

    def _place(self, height: float, time: float) -> None:
        square = level_square(self.middle, self.half, height, self.up_axis)
        self.prim.GetPointsAttr().Set(square, time)
        self.prim.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(square), time)


def level_square(middle: NDArray[np.float64], half: float, height: float, up_axis: str) -> Vt.Vec3fArray:
    """Return the square's corners, counter-clockwise from above; arguments as for `define_square`."""
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    if up_axis == "Y":
        square = np.stack([middle[0] + corners[:, 0], np.full(4, height), middle[2] - corners[:, 1]], axis=1)
    else:
        square = np.stack([middle[0] + corners[:, 0], middle[1] + corners[:, 1], np.full(4, height)], axis=1)
    return Vt.Vec3fArray.FromNumpy(square.astype(np.float32))


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
        make_collider(
            self.prim.GetPrim(), *(float(model.parameters[f"obstacle_{each}"].numpy()[0, number]) for each in SURFACE)
        )
        if self._moves:
            make_kinematic(self.prim.GetPrim())

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


def body_names(scene: Scene, taken: Collection[str] = ()) -> list[str]:
    """Return a prim name for each body: its own, or its shape's."""
    return prim_names((body.name or body.shape for body in scene.body), taken)


def define_body(stage: Usd.Stage, path: Sdf.Path, scene: Scene, shape: BodyShape, number: int) -> UsdGeom.Gprim:
    """Define a body's gprim, with ops for position and rotation without values, and its `UsdPhysics` properties."""
    body, look = scene.body[number], Look(scene.up_axis, np.zeros(3), 1.0)
    otherwise = BODY_COLORS[number % len(BODY_COLORS)]
    prim = define_obstacle(stage, path, body, shape.solid, np.zeros(7), look, otherwise)
    _, axes = _principal(shape)
    from scipy.spatial.transform import Rotation  # takes long to load

    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    weighed = UsdPhysics.MassAPI.Apply(prim.GetPrim())
    weighed.CreateCenterOfMassAttr(Gf.Vec3f(0.0))
    weighed.CreatePrincipalAxesAttr(Gf.Quatf(w, x, y, z))
    return prim


def inertia_of(shape: BodyShape, mass: float) -> Gf.Vec3f:
    """Return the moments about its principal axes [kg m^2]."""
    return Gf.Vec3f(*(mass * _principal(shape)[0]).tolist())


def _principal(shape: BodyShape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the moments of 1 kg [m^2], shape (3,), and axes, the columns of a rotation, shape (3, 3)."""
    moments, axes = np.linalg.eigh(shape.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return moments, axes


class BodyPrim:
    """Body of the scene, with its mass and velocities as `UsdPhysics` has them."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        self.prim = define_body(stage, path, model.scene, model.bodies[number], number)
        self._place, self._turn = self.prim.GetOrderedXformOps()[:2]
        mass = float(model.parameters["body_mass"].numpy()[0, number])
        weighed = UsdPhysics.MassAPI(self.prim.GetPrim())
        weighed.CreateMassAttr(mass)
        weighed.CreateDiagonalInertiaAttr(inertia_of(model.bodies[number], mass))
        self._start(model)

    def _start(self, model: Model) -> None:
        """Write the body's start pose and velocities, before there are any frames."""
        from scipy.spatial.transform import Rotation  # takes long to load

        def own(name: str) -> NDArray[np.float32]:
            return model.parameters[name].numpy()[0, self.number]

        places = np.asarray(model.parameters["initial_body_positions"].numpy(), dtype=np.float64)
        center = initial_centers(model.scene, model.bodies, places)[0, self.number]
        turn = initial_turns(model.scene)[self.number]
        self._put(np.concatenate([center, turn]), Usd.TimeCode.Default())
        make_collider(self.prim.GetPrim(), *(float(own(f"body_{name}")) for name in SURFACE))
        back = Rotation.from_quat(turn).inv()
        velocity, spin = (back.apply(own(f"initial_body_{name}")) for name in ("velocities", "spins"))
        make_free_body(self.prim.GetPrim(), velocity, spin)

    def write(self, frame: Frame) -> None:
        """Write the body's pose."""
        self._put(frame.body_poses[self.number], Usd.TimeCode(frame.number))

    def _put(self, pose: NDArray[np.floating], time: Usd.TimeCode) -> None:
        for op, value in zip((self._place, self._turn), as_gf(pose), strict=True):
            op.Set(value, time)


def define_sphere(stage: Usd.Stage, path: Sdf.Path, sphere: Sphere, number: int) -> UsdGeom.XformOp:
    """Return a sphere and its material; returns the translate that moves it."""
    prim = UsdGeom.Sphere.Define(stage, path)
    prim.CreateRadiusAttr(sphere.radius)
    prim.CreateExtentAttr([Gf.Vec3f(-sphere.radius), Gf.Vec3f(sphere.radius)])
    translate = prim.AddTranslateOp()
    paint(prim, sphere.color or SPHERE_COLORS[number % len(SPHERE_COLORS)], roughness=0.3)
    return translate


class SpherePrim:
    """Sphere of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number, self._scene = number, model.scene
        self._translate = define_sphere(stage, path, model.scene.sphere[number], number)
        self.prim = UsdGeom.Sphere(stage.GetPrimAtPath(path))
        if model.scene.sphere[number].start == 0.0:  # UsdPhysics has no word for a body that is not there yet
            self._start(model)

    def _start(self, model: Model) -> None:
        """Write the sphere's start position, mass and velocities, before there are any frames."""
        names = ("mass", *SURFACE)
        mass, friction, restitution = (
            float(model.parameters[f"sphere_{name}"].numpy()[0, self.number]) for name in names
        )
        place, velocity, spin = (
            model.parameters[f"initial_sphere_{name}"].numpy()[0, self.number]
            for name in ("positions", "velocities", "spins")
        )
        self._translate.Set(Gf.Vec3d(*place.tolist()))
        UsdPhysics.MassAPI.Apply(self.prim.GetPrim()).CreateMassAttr(mass)
        make_collider(self.prim.GetPrim(), friction, restitution)
        make_free_body(self.prim.GetPrim(), velocity, spin)

    def write(self, frame: Frame) -> None:
        self._translate.Set(Gf.Vec3d(*frame.sphere_positions[self.number].tolist()), frame.number)
        show_while_there(self.prim, self._scene, self._scene.sphere[self.number], frame.number)
