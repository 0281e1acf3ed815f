"""Strings, tubes and knots in the stage."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.model import Model
from balloon_warp.model.starts import ANCHORED, anchors_of
from balloon_warp.scene import Scene
from balloon_warp.scene.around import STRING_COLOR, balloon_color, mean_color
from balloon_warp.usd.material import PAIRED, paint, show_while_there
from balloon_warp.usd.solids import SIDES, Knot, as_gf, has_knot, knot_mesh, knot_size, tube_topology


def define_lines(stage: Usd.Stage, path: Sdf.Path, point_counts: Sequence[int], width: float) -> UsdGeom.BasisCurves:
    """Return the curves of `point_counts` points each; `width` in meters."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateCurveVertexCountsAttr(list(point_counts))
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    return curves


def write_lines(curves: UsdGeom.BasisCurves, points: NDArray[np.float32], time: float) -> None:
    """Write the points of all curves in order, shape (sum of the curves' point counts, 3), and their extent."""
    curves.GetPointsAttr().Set(points, time)
    widths = curves.GetWidthsAttr().Get()
    curves.GetExtentAttr().Set(UsdGeom.Curves.ComputeExtent(Vt.Vec3fArray.FromNumpy(points), widths), time)


POINT_COUNT = 17


def string_curve(
    anchor: ArrayLike, end: ArrayLike, length: float, up: ArrayLike, ground_height: float
) -> NDArray[np.float32]:
    """Return the points along a string: straight when taut, hanging in a parabola of about its length when slack.

    A shallow parabola of sag s over a chord c is 8 s^2 / 3 c longer than the chord. It lies on the ground where it
    would sink below.

    Returns:
        positions [m], shape (POINT_COUNT, 3)
    """
    anchor, end, up = np.asarray(anchor, float), np.asarray(end, float), np.asarray(up, float)
    chord = end - anchor
    distance = max(float(np.linalg.norm(chord)), 1e-12)
    sag = np.sqrt(0.375 * distance * max(length - distance, 0.0))
    t = np.linspace(0.0, 1.0, POINT_COUNT)[:, None]
    points = anchor + t * chord + 4.0 * t * (1.0 - t) * sag * _across(chord / distance, -up)
    below = np.maximum(ground_height - points @ up, 0.0)
    below[0] = 0.0  # the anchor stays where the scene put it
    return (points + below[:, None] * up).astype(np.float32)


def _across(direction: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector across `direction`, as much along `wanted` as can be."""
    across = wanted - (wanted @ direction) * direction
    if np.linalg.norm(across) < 1e-6:
        across = np.roll(wanted, 1) - (np.roll(wanted, 1) @ direction) * direction
    return across / np.linalg.norm(across)


class Strand:
    """A curve, and a mesh around it that final pictures of other programs show in its place.

    USD has purposes for such pairs: the mesh is for rendering, and the curve is its proxy.

    Args:
        curve: one that has its material and no points yet.
        start: points along the curve before there are any frames, shape (count, 3): who takes no times, such as a
            simulator that goes on, has them.
    """

    def __init__(self, stage: Usd.Stage, curve: UsdGeom.BasisCurves, start: NDArray[np.floating]):
        self.curve = curve
        (count,) = curve.GetCurveVertexCountsAttr().Get()
        (width,) = curve.GetWidthsAttr().Get()
        self._radius = 0.5 * width
        path = curve.GetPath()
        self.mesh = UsdGeom.Mesh.Define(stage, path.ReplaceName(f"{path.name}_Mesh"))
        counts, indices = tube_topology(np.array([count], np.int32))
        self.mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
        self.mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
        self.mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points_around(start, self._radius)))
        self.mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
        self.mesh.CreateDisplayColorAttr(curve.GetDisplayColorAttr().Get())
        material, _ = UsdShade.MaterialBindingAPI(curve.GetPrim()).ComputeBoundMaterial()
        UsdShade.MaterialBindingAPI.Apply(self.mesh.GetPrim()).Bind(material)
        self.mesh.CreatePurposeAttr(UsdGeom.Tokens.render)
        curve.CreatePurposeAttr(UsdGeom.Tokens.proxy)
        self.mesh.SetProxyPrim(curve.GetPrim())
        self.mesh.GetPrim().SetCustomDataByKey(SCENERY, "Strand")
        for prim, meaning in ((curve, "stands for its mesh"), (self.mesh, "the curve stands for it")):
            prim.GetPrim().SetCustomDataByKey(PAIRED, meaning)

    def write(self, points: NDArray[np.float32], time: float) -> None:
        """Write points along the curve, shape (count, 3)."""
        write_lines(self.curve, points, time)
        around = Vt.Vec3fArray.FromNumpy(points_around(points, self._radius))
        self.mesh.GetPointsAttr().Set(around, time)
        self.mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(around), time)


def points_around(points: NDArray[np.floating], radius: float) -> NDArray[np.float32]:
    """Return `SIDES` points about each point of a curve in a plane, in the order of `tube_topology`.

    Returns:
        shape (SIDES * len(points), 3)
    """
    places = np.asarray(points, float)
    chord = places[-1] - places[0]
    bend = places - places[0]
    if chord @ chord > 0.0:
        bend -= np.outer(bend @ chord / (chord @ chord), chord)
    side = np.cross(chord, bend[(bend * bend).sum(axis=1).argmax()])  # across the plane
    if np.linalg.norm(side) <= 1e-6 * (chord @ chord):  # the curve is straight: any will do
        side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= max(float(np.linalg.norm(side)), 1e-12)
    along = np.gradient(places, axis=0)
    other = np.cross(along, side)
    other /= np.maximum(np.linalg.norm(other, axis=1, keepdims=True), 1e-12)
    turn = 2.0 * np.pi * np.arange(SIDES)[:, None] / SIDES
    rings = places[:, None] + radius * (np.cos(turn) * side + np.sin(turn) * other[:, None])
    return rings.reshape(-1, 3).astype(np.float32)


OPACITY = 0.98
"""Opacity of the rubber there, which is not stretched and lies in folds"""


def knot_path(string: Sdf.Path) -> Sdf.Path:
    """Return the path of a knot, beside the string's."""
    return string.ReplaceName(f"{string.name}_Knot")


def define_knot(stage: Usd.Stage, path: Sdf.Path, scene: Scene, number: int, held: PolygonMesh) -> UsdGeom.Mesh:
    """Define a knot's mesh in the balloon's color, with ops for position and rotation without values.

    Args:
        number: Number of the string.
        held: Mesh of the balloon.
    """
    mesh = knot_mesh(knot_size(held), scene.up)
    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    prim.CreateDoubleSidedAttr(True)
    prim.GetPrim().SetCustomDataByKey(SCENERY, "Knot")
    prim.AddTranslateOp()
    prim.AddOrientOp()
    balloon = scene.string[number].balloon
    color = mean_color(held, scene.balloon[balloon], balloon_color(scene, balloon))
    paint(prim, color, roughness=0.2, opacity=OPACITY, clearcoat=1.0)
    return prim


class KnotPrim:
    """The knot of one string of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, scene: Scene, number: int, held: PolygonMesh, particle: int):
        self._up = scene.up
        self._knot = Knot(held, particle)
        self.prim = define_knot(stage, path, scene, number, held)
        self._place, self._turn = self.prim.GetOrderedXformOps()

    def write(self, points: NDArray[np.float32], curve: NDArray[np.float32], time: float) -> None:
        """Write the knot's pose; arguments as in `Knot.pose`."""
        for op, value in zip((self._place, self._turn), as_gf(self._knot.pose(points, curve, self._up)), strict=True):
            op.Set(value, time)


def define_string(stage: Usd.Stage, path: Sdf.Path, held: PolygonMesh) -> UsdGeom.BasisCurves:
    """Return a curve as thin as suits the mesh that it holds; no points yet."""
    curve = define_lines(stage, path, [POINT_COUNT], width=0.008 * float(np.ptp(held.points, axis=0).max()))
    paint(curve, STRING_COLOR, roughness=0.8)
    return curve


class StringPrim:
    """String of the scene, as a curve, the mesh around it, and the knot where it is tied."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.model, self.number = model, number
        self.string = model.scene.string[number]
        self.particle = int(model.string_particle.numpy()[number]) - model.particle_offsets[self.string.balloon]
        held = model.shapes[self.string.balloon].mesh
        self.prim = define_string(stage, path, held)
        places = {name: model.parameters[name].numpy() for name in ANCHORED}
        anchor = anchors_of(model.scene, model.bodies, places)[0, number]
        start = np.linspace(anchor, held.points[self.particle], POINT_COUNT)
        self._strand = Strand(stage, self.prim, start)
        self._knot = None
        if has_knot(self.string, model.scene.balloon[self.string.balloon]):
            self._knot = KnotPrim(stage, knot_path(path), model.scene, number, held, self.particle)

    def write(self, frame: Frame) -> None:
        points = frame.points[self.string.balloon]
        anchor, end = frame.string_anchors[self.number], points[self.particle]
        length = float(frame.string_lengths[self.number])
        curve = string_curve(anchor, end, length, self.model.scene.up, frame.ground_height)
        self._strand.write(curve, frame.number)
        seen: list[UsdGeom.Gprim] = [self.prim, self._strand.mesh]
        if self._knot:
            self._knot.write(points, curve, frame.number)
            seen.append(self._knot.prim)
        for prim in seen:
            show_while_there(prim, self.model.scene, self.string, frame.number)


class TubePrim:
    """Tube of the scene, as a straight curve and the mesh around it.

    It goes between the particles that face each other at the start.
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.balloons = model.scene.tube[number].balloons
        first, second = (model.shapes[balloon].mesh.points for balloon in self.balloons)
        toward = second.mean(axis=0) - first.mean(axis=0)
        self.particles = int((first @ toward).argmax()), int((second @ toward).argmin())
        size = min(float(np.ptp(points, axis=0).max()) for points in (first, second))
        self.prim = define_lines(stage, path, [2], width=0.1 * size)
        paint(self.prim, STRING_COLOR, roughness=0.5)
        ends = first[self.particles[0]], second[self.particles[1]]
        self._strand = Strand(stage, self.prim, np.array(ends))

    def write(self, frame: Frame) -> None:
        ends = zip(self.balloons, self.particles, strict=True)
        places = np.stack([frame.points[balloon][particle] for balloon, particle in ends])
        self._strand.write(places, frame.number)
