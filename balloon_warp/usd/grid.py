"""Worlds of a batch in one stage, side by side: prims that refer to prototypes.

Prototypes that the worlds of a batch share in the stage: topology, materials, widths.

Each world refers to them.

World of a batch in the stage: prims that refer to the prototypes, and their time samples.

Authored in Sdf, on the layer itself: the stage's own functions look up the composed prim at each call.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from balloon_warp.mesh.topology import beside_faces, box_corners, corner_faces, corners_beside
from balloon_warp.model import ModelPlan
from balloon_warp.model.obstacles import initial_centers, moves, obstacle_motion, obstacle_poses
from balloon_warp.model.starts import Carriers, anchors_of, start_of
from balloon_warp.scene.load import is_there
from balloon_warp.usd.balloon import (
    author_velocities,
    define_balloon,
    define_knot,
    define_string,
    knot_path,
    string_curve,
)
from balloon_warp.usd.material import identifier, prim_names, show_names
from balloon_warp.usd.solids import (
    SIZES,
    Knot,
    Look,
    Plane,
    as_gf,
    body_names,
    define_body,
    define_obstacle,
    define_sphere,
    define_square,
    has_knot,
    inertia_of,
    obstacle_names,
    planes_of,
)
from balloon_warp.usd.stage import GrowingStage, MovingGroup, describe_stage

ROOM = 2.0
"""Side of a cell, as a multiple of the largest world's width at the start"""


def horizontal_axes(up_axis: str) -> tuple[int, int]:
    """Return the axes of a row and of a column of worlds."""
    return (0, 2) if up_axis == "Y" else (0, 1)


def world_bounds(plans: Sequence[ModelPlan]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner of the box around every world [m].

    It holds balloons, spheres, free bodies and anchors at the start, anchors at the end, too, and obstacles wherever
    they get.
    """
    clouds = []
    for plan in plans:
        for number, shape in enumerate(plan.shapes):
            clouds += [start_of(plan.scene, plan.parameters, number, box_corners(shape.mesh)).reshape(-1, 3)]
        told = plan.scene, plan.bodies, plan.parameters
        clouds += [anchors_of(*told, frame).reshape(-1, 3) for frame in (0, plan.scene.frames)]
        centers, radii = plan.parameters["initial_sphere_positions"], plan.parameters["sphere_radius"][..., None]
        clouds += [(centers - radii).reshape(-1, 3), (centers + radii).reshape(-1, 3), *_obstacle_bounds(plan)]
        places = initial_centers(plan.scene, plan.bodies, plan.parameters["initial_body_positions"])
        reaches = np.array([shape.solid.reach for shape in plan.bodies]).reshape(-1, 1)
        clouds += [(places - reaches).reshape(-1, 3), (places + reaches).reshape(-1, 3)]
    points = np.concatenate(clouds)
    return points.min(axis=0), points.max(axis=0)


def _obstacle_bounds(plan: ModelPlan) -> list[NDArray[np.float64]]:
    """Return corners around each bounded obstacle, over its motion in all worlds [m], shape (n, 3) each."""
    positions, shifts = plan.parameters["obstacle_position"], obstacle_motion(plan.scene)[:, :, :3]
    reaches = np.array([[shape.reach] for shape in plan.obstacles]).reshape(-1, 1)
    lowest = positions.min(axis=0) + shifts.min(axis=0) - reaches
    highest = positions.max(axis=0) + shifts.max(axis=0) + reaches
    ended = np.isfinite(reaches[:, 0])
    return [lowest[ended], highest[ended]]


def grid_shifts(world_count: int, side: float, up_axis: str) -> NDArray[np.float64]:
    """Return the shift of each world [m]: row by row, the whole grid centered, shape (world_count, 3)."""
    columns = ceil(sqrt(world_count))
    rows = ceil(world_count / columns)
    column, row = np.arange(world_count) % columns, np.arange(world_count) // columns
    across, along = horizontal_axes(up_axis)
    shifts = np.zeros((world_count, 3))
    shifts[:, across] = side * (column - 0.5 * (columns - 1))
    shifts[:, along] = side * (row - 0.5 * (rows - 1))
    return shifts


HOME = Sdf.Path("/World/Prototypes")


class Prototypes:
    """Abstract prims, one for each balloon's mesh, or each of its meshes, sphere, string, obstacle and free body.

    Args:
        plans: Plans of all groups of worlds.
        middle: Middle of the worlds at the start, before they are put side by side [m], shape (3,).
        half: Half the side of the square that is drawn of an obstacle's plane [m].
    """

    def __init__(self, stage: Usd.Stage, plans: Sequence[ModelPlan], middle: NDArray[np.float64], half: float):
        stage.CreateClassPrim(HOME)
        scene = plans[0].scene
        shapes = {_key(plan, number): shape for plan in plans for number, shape in enumerate(plan.shapes)}
        self.spheres = [HOME.AppendChild(f"Sphere_{number}") for number in range(len(scene.sphere))]
        self.strings = [HOME.AppendChild(f"String_{number}") for number in range(len(scene.string))]
        self.pieces: dict[Plane, Sdf.Path] = {}
        bodies = [path.name for path in (*self.spheres, *self.strings, *map(knot_path, self.strings))]
        self.obstacles = [HOME.AppendChild(name) for name in obstacle_names(scene, bodies)]
        self.obstacle_motion = obstacle_motion(scene)
        named = [*bodies, *(path.name for path in self.obstacles)]
        self.bodies = [HOME.AppendChild(name) for name in body_names(scene, named)]
        self.other_names = [*named, *(path.name for path in self.bodies)]
        names = prim_names((shape.mesh.name for shape in shapes.values()), self.other_names)
        self._balloons = {key: HOME.AppendChild(name) for key, name in zip(shapes, names, strict=True)}
        for key, shape in shapes.items():
            define_balloon(stage, self._balloons[key], shape, key[0], scene.balloon[key[0]])
        for number, path in enumerate(self.spheres):
            define_sphere(stage, path, scene.sphere[number], number)
        poses = obstacle_poses(plans[0].parameters["obstacle_position"][0], self.obstacle_motion, 0)
        for path, obstacle, shape, pose in zip(self.obstacles, scene.obstacle, plans[0].obstacles, poses, strict=True):
            define_obstacle(stage, path, obstacle, shape, pose, Look(scene.up_axis, middle, half))
        for number, path in enumerate(self.bodies):
            define_body(stage, path, scene, plans[0].bodies[number], number)
        for paths, named in ((self.obstacles, scene.obstacle), (self.bodies, scene.body)):
            show_names(stage.GetRootLayer(), paths, [each.name for each in named])
        self.string_widths = [
            define_string(stage, path, plans[0].shapes[string.balloon].mesh).GetWidthsAttr().Get()
            for path, string in zip(self.strings, scene.string, strict=True)
        ]
        self.knots: dict[int, Sdf.Path] = {}
        """Knots of the strings that have one, by their numbers"""
        for number, string in enumerate(scene.string):
            if has_knot(string, scene.balloon[string.balloon]):
                self.knots[number] = knot_path(self.strings[number])
                define_knot(stage, self.knots[number], scene, number, plans[0].shapes[string.balloon].mesh)

    def define_piece(
        self, stage: Usd.Stage, plane: Plane, middle: NDArray[np.float64], half: float, up_axis: str
    ) -> None:
        """Define the piece of a plane of each world, at height 0, where heights differ.

        Arguments are those of `define_square`.
        """
        self.pieces[plane] = HOME.AppendChild(plane.piece)
        define_square(stage, self.pieces[plane], plane, middle, half, 0.0, up_axis)

    def balloon(self, plan: ModelPlan, number: int) -> Sdf.Path:
        """Return the prototype of a balloon of this plan."""
        return self._balloons[_key(plan, number)]


def _key(plan: ModelPlan, number: int) -> tuple[int, Path | int]:
    mesh = plan.scene.balloon[number].mesh
    return number, mesh if isinstance(mesh, Path) else id(mesh)


PLACE, TURN = "xformOp:translate", "xformOp:orient"


class GridObstacles:
    """Obstacles of a world.

    Args:
        prims: Prims of the world, each with an order of ops from its prototype.
        motion: Motion, as from `obstacle_motion`.
        positions: Positions in the world, each from a frame on [m], shape (obstacle_count, 3); see `values_over_time`.
    """

    def __init__(
        self,
        prims: Sequence[Sdf.PrimSpec],
        plan: ModelPlan,
        motion: NDArray[np.float64],
        positions: Sequence[tuple[int, NDArray[np.float64]]],
    ):
        self._motion, self._positions = motion, positions
        self._moving: dict[int, tuple[Sdf.Path, Sdf.Path]] = {}
        """Paths of position and rotation of those that move"""
        poses = self.poses(0)
        for number, prim in enumerate(prims):
            place = Sdf.AttributeSpec(prim, PLACE, Sdf.ValueTypeNames.Double3)
            turn = Sdf.AttributeSpec(prim, TURN, Sdf.ValueTypeNames.Quatf)
            if moves(plan.scene, number, (change.values for change in plan.due_changes)):
                self._moving[number] = place.path, turn.path
            else:
                place.default, turn.default = as_gf(poses[number])

    @property
    def paths(self) -> list[Sdf.Path]:
        """Paths with time samples."""
        return [path for paths in self._moving.values() for path in paths]

    def samples(self, frame: int) -> list[Gf.Vec3d | Gf.Quatf]:
        """Return their values at a frame, in the order of `paths`."""
        poses = self.poses(frame)
        return [value for number in self._moving for value in as_gf(poses[number])]

    def poses(self, frame: int) -> NDArray[np.float64]:
        """Return their poses at a frame, as `Frame.obstacle_poses`, shape (obstacle_count, 7)."""
        positions = next(positions for begin, positions in reversed(self._positions) if begin <= frame)
        return obstacle_poses(positions, self._motion, frame)


def values_over_time(plan: ModelPlan, name: str, row: int) -> list[tuple[int, NDArray[np.float64]]]:
    """Return a parameter of a world of a plan, as it is from each frame on at which it is another."""
    rows = plan.parameters[name]
    values = [(0, rows[row % len(rows)])]
    for change in plan.due_changes:
        if name in change.values:
            moved = values[-1][1][None].copy()
            change.apply(name, moved)
            values.append((change.frame + 1, moved[0]))
    return values


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


PIECE = 0.4
"""Half the side of a world's own piece of ground or water, as a fraction of its cell"""


@dataclass(frozen=True)
class GridGroup:
    """Chosen worlds of the same meshes."""

    plan: ModelPlan
    rows: NDArray[np.integer]
    """Numbers of the worlds in the plan, shape (chosen,)"""
    worlds: NDArray[np.integer]
    """Numbers of the worlds in the whole batch, shape (chosen,)"""
    values: Mapping[str, NDArray] = field(default_factory=dict)
    """Values that differ between worlds: dotted paths, and numbers or the files of meshes, shape (chosen,)"""


Shapes = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int8]]
"""Points, sphere positions, body poses and torn faces of chosen worlds, shapes (chosen, particle_count, 3), (chosen,
sphere_count, 3), (chosen, body_count, 7) and (chosen, face_count), or (chosen, 0)"""


class GridWriter(GrowingStage):
    """Writes frames of the chosen worlds into a stage, which appears at `path` when the `with` block ends well.

    Raises:
        InputError: a texture cannot be written beside it.
    """

    def __init__(self, path: Path, groups: Sequence[GridGroup]):
        super().__init__(path, [group.plan for group in groups])
        self.groups = groups

    def _define(self) -> list[MovingGroup]:
        plans = [group.plan for group in self.groups]
        scene = plans[0].scene
        members = sorted(
            (world, number, row, place)
            for number, group in enumerate(self.groups)
            for place, (world, row) in enumerate(zip(group.worlds.tolist(), group.rows.tolist(), strict=True))
        )
        lowest, highest = world_bounds(plans)
        side = ROOM * float(np.max((highest - lowest)[list(horizontal_axes(scene.up_axis))]))
        shifts = grid_shifts(len(members), side, scene.up_axis)
        middle = 0.5 * (lowest + highest)
        stage = Usd.Stage.Open(self.layer)
        describe_stage(stage, scene)
        prototypes = Prototypes(stage, plans, middle, PIECE * side)
        half = SIZES * float(np.max(highest - lowest)) + float(np.abs(shifts).max())
        for plane in planes_of(scene):
            heights = {plans[number].of_world(plane.height, row) for _, number, row, _ in members}
            if len(heights) == 1:
                path = Sdf.Path(f"/World/{plane.name}")
                define_square(stage, path, plane, middle, half, heights.pop(), scene.up_axis)
            else:
                prototypes.define_piece(stage, plane, middle, PIECE * side, scene.up_axis)
        del stage  # it would follow each change of the layer
        root, digits = self.layer.GetPrimAtPath("/World"), len(str(members[-1][0]))
        self._worlds: list[list[GridWorld]] = [[] for _ in self.groups]
        with Sdf.ChangeBlock():
            for shift, (world, number, row, place) in zip(shifts, members, strict=True):
                prim = Sdf.PrimSpec(root, f"World_{world:0{digits}d}", Sdf.SpecifierDef, "Xform")
                values = {path: column[place].item() for path, column in self.groups[number].values.items()}
                self._worlds[number].append(GridWorld(prim, shift, values, prototypes, plans[number], row))
        return [
            MovingGroup(
                [world.path for world in worlds],
                [pair for world in worlds for pair in world.moving],
                2 * 12 * group.plan.particle_count * len(worlds),
            )
            for group, worlds in zip(self.groups, self._worlds, strict=True)
        ]

    def write(self, number: int, group: int, shapes: Shapes, places: Sequence[int] | None = None) -> None:
        """Write a frame of one group. It follows the one before it, whose velocities are known then.

        Args:
            places: of the worlds that the arrays are of, among the group's; all of them, when missing.
        """
        worlds = self._worlds[group]
        with Sdf.ChangeBlock():
            for row, world in enumerate(worlds if places is None else [worlds[place] for place in places]):
                world.write(number, *(of_worlds[row] for of_worlds in shapes))
                for own, velocities in world.moving:
                    author_velocities(self.layer, velocities, self.layer, own, number - 1)
        self._end_frame(group, number)

    def last_points(self, group: int, place: int) -> list[list[NDArray[np.float32]]]:
        """Return the points of a chosen world in its last two frames.

        For each frame, of each balloon, shape (particle_count, 3).
        """
        assert self._last is not None
        world = self._worlds[group][place]
        return [world.points(self.layer, number) for number in (self._last - 1, self._last)]

    def last_torn(self, group: int, place: int) -> list[NDArray[np.bool_]]:
        """Return the torn faces of a chosen world in its last frame, as `Frame.torn`."""
        assert self._last is not None
        return self._worlds[group][place].torn(self.layer, self._last)

    def last_obstacle_poses(self, group: int, place: int) -> NDArray[np.float64]:
        """Return the obstacle poses of a chosen world in its last frame, as `Frame.obstacle_poses`."""
        assert self._last is not None
        return self._worlds[group][place].obstacles.poses(self._last)

    def _another(self, path: Path) -> "GridWriter":
        return GridWriter(path, self.groups)

    def _finish(self, last: int) -> None:
        """Add nothing: worlds side by side have no studio."""
