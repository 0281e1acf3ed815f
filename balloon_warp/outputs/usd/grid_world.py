"""World of a batch in the stage: prims that refer to the prototypes, and their time samples.

Authored in Sdf, on the layer itself: the stage's own functions look up the composed prim at each call.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, UsdGeom, Vt

from balloon_warp.mesh.corners import beside_faces, corner_faces, corners_beside
from balloon_warp.model import ModelPlan
from balloon_warp.model.anchors import Carriers
from balloon_warp.outputs.knot import Knot
from balloon_warp.outputs.usd.body import inertia_of
from balloon_warp.outputs.usd.grid_obstacles import PLACE, TURN, GridObstacles, values_over_time
from balloon_warp.outputs.usd.names import identifier, prim_names, show_names
from balloon_warp.outputs.usd.obstacle import as_gf
from balloon_warp.outputs.usd.prototypes import Prototypes
from balloon_warp.outputs.usd.string_curve import string_curve
from balloon_warp.scene.timeline import is_there

Types = Sdf.ValueTypeNames


class GridWorld:
    """Prims of one world.

    Args:
        world: the world's own prim.
        shift: where the world stands [m], shape (3,).
        values: what differs between worlds, of this one: dotted paths, and numbers or the files of meshes.
        plan: what the world is made of.
        row: the world's number in that plan.
    """

    def __init__(
        self,
        world: Sdf.PrimSpec,
        shift: NDArray[np.float64],
        values: Mapping[str, float | str],
        prototypes: Prototypes,
        plan: ModelPlan,
        row: int,
    ):
        self.plan, self.layer, self.path = plan, world.layer, world.path
        _translated(world, shift)
        for path, value in values.items():
            _say(world, path, value)
        names = prim_names((shape.name for shape in plan.shapes), prototypes.other_names)
        self._balloons = [
            _animated(
                _referring(world, name, prototypes.balloon(plan, number)),
                {"points": Types.Point3fArray, "velocities": Types.Vector3fArray, "extent": Types.Float3Array},
            )
            for number, name in enumerate(names)
        ]
        paths = [path.GetPrimPath() for path, _, _ in self._balloons]
        show_names(self.layer, paths, [shape.name for shape in plan.shapes])
        self._corners = []
        """Numbers of balloons that may burst, whose faces may vanish, and paths of their corners"""
        for number, (path, _, _) in enumerate(self._balloons):
            if plan.scene.balloon[number].material.strength is not None:
                prim = self.layer.GetPrimAtPath(path.GetPrimPath())
                self._corners += [(number, *_animated(prim, {"faceVertexIndices": Types.IntArray}))]
        self._spheres = []
        for number, path in enumerate(prototypes.spheres):
            sphere = _referring(world, path.name, path)
            radius = plan.of_world("sphere_radius", row)[number] or plan.scene.sphere[number].radius  # 0: not there yet
            if radius != plan.scene.sphere[number].radius:
                _set(sphere, "radius", Types.Double, radius)
                _set(sphere, "extent", Types.Float3Array, Vt.Vec3fArray([Gf.Vec3f(-radius), Gf.Vec3f(radius)]))
            self._spheres += _animated(sphere, {"xformOp:translate": Types.Double3})
        self._strings = [
            _animated(_referring(world, path.name, path), {"points": Types.Point3fArray, "extent": Types.Float3Array})
            for path in prototypes.strings
        ]
        self._knots = {}
        """Knots of the strings that have one: pose, and paths of position and rotation"""
        for number, path in prototypes.knots.items():
            knot = Knot(plan.shapes[plan.scene.string[number].balloon].mesh, plan.held[number])
            animated = _animated(_referring(world, path.name, path), {PLACE: Types.Double3, TURN: Types.Quatf})
            self._knots[number] = knot, animated
        self._lasting = []
        """Things that appear or end: path of the visibility, and the sphere or string"""
        strings = [*zip(prototypes.strings, plan.scene.string, strict=True)]
        strings += [(path, plan.scene.string[number]) for number, path in prototypes.knots.items()]
        for path, body in (*zip(prototypes.spheres, plan.scene.sphere, strict=True), *strings):
            if body.start > 0.0 or body.end is not None:
                prim = self.layer.GetPrimAtPath(world.path.AppendChild(path.name))
                self._lasting.append((_animated(prim, {"visibility": Types.Token})[0], body))
        self._ground_height = plan.of_world("ground_height", row)
        for plane, path in prototypes.pieces.items():
            piece = _referring(world, plane.piece, path)
            _translated(piece, plan.of_world(plane.height, row) * np.array(plan.scene.up))
        self._positions = values_over_time(plan, "obstacle_position", row)
        self.obstacles = GridObstacles(
            [_referring(world, path.name, path) for path in prototypes.obstacles],
            plan,
            prototypes.obstacle_motion,
            self._positions,
        )
        self._bodies = [
            _animated(self._body(world, path, number, row), {PLACE: Types.Double3, TURN: Types.Quatf})
            for number, path in enumerate(prototypes.bodies)
        ]
        self._string_anchors = values_over_time(plan, "string_anchor", row)
        self._carriers = Carriers.of(plan.scene, plan.bodies)
        self._string_lengths = values_over_time(plan, "string_length", row)
        self._string_widths = prototypes.string_widths

    def _body(self, world: Sdf.PrimSpec, path: Sdf.Path, number: int, row: int) -> Sdf.PrimSpec:
        """Return a free body with its mass in this world."""
        prim, mass = _referring(world, path.name, path), float(self.plan.of_world("body_mass", row)[number])
        _set(prim, "physics:mass", Types.Float, mass)
        _set(prim, "physics:diagonalInertia", Types.Float3, inertia_of(self.plan.bodies[number], mass))
        return prim

    def write(
        self,
        time: int,
        points: NDArray[np.float32],
        sphere_positions: NDArray[np.float32],
        body_poses: NDArray[np.float32],
        torn: NDArray[np.int8],
    ) -> None:
        """Write a frame's samples, without velocities.

        The arrays have shape (particle_count, 3), (sphere_count, 3), (body_count, 7) and (face_count,), or (0,).
        """
        begin = 0
        for number, (shape, (point_path, _, extent_path)) in enumerate(
            zip(self.plan.shapes, self._balloons, strict=True)
        ):
            own = points[begin : begin + shape.mesh.vertex_count]
            self.layer.SetTimeSample(point_path, time, Vt.Vec3fArray.FromNumpy(own))
            if len(torn):  # a particle without faces flies far, unseen
                own = own[beside_faces(shape.mesh, self._of_faces(torn, number) == 1)]
            extent = UsdGeom.PointBased.ComputeExtent(Vt.Vec3fArray.FromNumpy(own))
            self.layer.SetTimeSample(extent_path, time, extent)
            begin += shape.mesh.vertex_count
        for number, path in self._corners:
            corners = corners_beside(self.plan.shapes[number].mesh, self._of_faces(torn, number) == 1)
            self.layer.SetTimeSample(path, time, Vt.IntArray.FromNumpy(corners))
        for path, position in zip(self._spheres, sphere_positions.tolist(), strict=True):
            self.layer.SetTimeSample(path, time, Gf.Vec3d(*position))
        for paths, pose in zip(self._bodies, body_poses, strict=True):
            for path, value in zip(paths, as_gf(pose), strict=True):
                self.layer.SetTimeSample(path, time, value)
        for number, (point_path, extent_path) in enumerate(self._strings):
            own = self._held(number, points)
            curve = self._string_curve(number, own, body_poses, time)
            places = Vt.Vec3fArray.FromNumpy(curve)
            extent = UsdGeom.Curves.ComputeExtent(places, self._string_widths[number])
            self.layer.SetTimeSample(point_path, time, places)
            self.layer.SetTimeSample(extent_path, time, extent)
            if number in self._knots:
                knot, paths = self._knots[number]
                for path, value in zip(paths, as_gf(knot.pose(own, curve, self.plan.scene.up)), strict=True):
                    self.layer.SetTimeSample(path, time, value)
        for path, value in zip(self.obstacles.paths, self.obstacles.samples(time), strict=True):
            self.layer.SetTimeSample(path, time, value)
        for path, body in self._lasting:
            seen = is_there(self.plan.scene, body, time)
            self.layer.SetTimeSample(path, time, UsdGeom.Tokens.inherited if seen else UsdGeom.Tokens.invisible)

    def points(self, source: Sdf.Layer, time: int) -> list[NDArray[np.float32]]:
        """Return the points of each balloon in a frame in `source`, shape (particle_count, 3)."""
        return [np.array(source.QueryTimeSample(path, time)) for path, _, _ in self._balloons]

    def torn(self, source: Sdf.Layer, time: int) -> list[NDArray[np.bool_]]:
        """Return the torn faces of each balloon in a frame in `source`, as `Frame.torn`."""
        found = [np.zeros(shape.mesh.face_count, dtype=bool) for shape in self.plan.shapes] if self._corners else []
        for number, path in self._corners:
            mesh = self.plan.shapes[number].mesh
            moved = np.array(source.QueryTimeSample(path, time)) != mesh.face_vertex_indices
            found[number] = np.bincount(corner_faces(mesh), moved, mesh.face_count) > 0
        return found

    def _of_faces(self, values: NDArray, number: int) -> NDArray:
        """Return a balloon's part of the values of all faces."""
        first = sum(shape.mesh.face_count for shape in self.plan.shapes[:number])
        return values[first : first + self.plan.shapes[number].mesh.face_count]

    @property
    def moving(self) -> list[tuple[Sdf.Path, Sdf.Path]]:
        """Attributes of the points and the velocities of each balloon."""
        return [(points, velocities) for points, velocities, _ in self._balloons]

    def _held(self, number: int, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the balloon that a string holds."""
        balloon = self.plan.scene.string[number].balloon
        before = sum(shape.mesh.vertex_count for shape in self.plan.shapes[:balloon])
        return points[before : before + self.plan.shapes[balloon].mesh.vertex_count]

    def _string_curve(
        self, number: int, points: NDArray[np.float32], body_poses: NDArray[np.float32], time: int
    ) -> NDArray[np.float32]:
        """Return a string's curve, from the points of the balloon that it holds."""
        end = points[self.plan.held[number]]
        anchors, lengths, positions = (
            next(values for frame, values in reversed(over_time) if frame <= time)
            for over_time in (self._string_anchors, self._string_lengths, self._positions)
        )
        anchors = self._carriers.anchors_at(anchors, positions, body_poses, time)
        return string_curve(anchors[number], end, float(lengths[number]), self.plan.scene.up, self._ground_height)


def _referring(parent: Sdf.PrimSpec, name: str, prototype: Sdf.Path) -> Sdf.PrimSpec:
    """Return a prim of the prototype's type."""
    prim = Sdf.PrimSpec(parent, name, Sdf.SpecifierDef)
    prim.referenceList.Prepend(Sdf.Reference(primPath=prototype))
    return prim


def _set(
    prim: Sdf.PrimSpec, name: str, kind: Sdf.ValueTypeName, value: Any, how: Sdf.Variability = Sdf.VariabilityVarying
) -> None:
    Sdf.AttributeSpec(prim, name, kind, how).default = value


def _say(prim: Sdf.PrimSpec, path: str, value: float | str) -> None:
    """Write a value at a dotted path as a user property; for a mesh, the file's name.

    `balloon.0.position.1` is `userProperties:balloon_0:position_1`.
    """
    words = re.sub(r"\.(\d+)", r"_\1", path).split(".")
    name = ":".join(["userProperties", *map(identifier, words)])
    kind = Types.String if isinstance(value, str) else Types.Double
    attribute = Sdf.AttributeSpec(prim, name, kind, Sdf.VariabilityUniform)
    attribute.custom, attribute.displayName = True, path
    attribute.default = Path(value).name if isinstance(value, str) else float(value)


def _translated(prim: Sdf.PrimSpec, shift: NDArray[np.float64]) -> None:
    _set(prim, "xformOp:translate", Types.Double3, Gf.Vec3d(*shift.tolist()))
    _set(prim, "xformOpOrder", Types.TokenArray, Vt.TokenArray(["xformOp:translate"]), Sdf.VariabilityUniform)


def _animated(prim: Sdf.PrimSpec, attributes: dict[str, Sdf.ValueTypeName]) -> list[Sdf.Path]:
    """Return the attributes that will get time samples; returns their paths."""
    return [Sdf.AttributeSpec(prim, name, kind).path for name, kind in attributes.items()]
