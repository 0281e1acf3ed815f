"""Balloons in the stage: meshes, velocities, forces, contacts, deformables for others; strings, tubes and knots.

Velocities are of the points in the stage, so that motion blur follows the visible motion: a simulated one is that of
one substep, and trembles with vibrations that no frame shows.

A balloon is the surface deformable of the AOUSD physics group's proposal, too. USD does not know these schemas yet, so
they are applied by name: Newton reads them, and who does not know them passes them over. Lengths are meters and masses
kilograms, as the stage says.

The mesh has a fixed topology. Where it may burst, the corners of its faces are written in each frame: those of a torn
face are all at one of its vertices, so that the number of faces stays.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt

from balloon_warp.frame import Frame, things_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.orientation import SOFT_CREASE, sharp_edges
from balloon_warp.mesh.topology import beside_faces, total_area, triangulate
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.model import Model
from balloon_warp.model.materials import law_of
from balloon_warp.model.shape import BalloonShape, vertex_weights
from balloon_warp.model.starts import ANCHORED, anchors_of
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.scene.around import FORCE_COLOR, STRING_COLOR, balloon_color, looks_of_file, mean_color, palette_color
from balloon_warp.usd.material import (
    HOME,
    PAIRED,
    bind_substance,
    define_latex_variant,
    paint,
    paint_as_file,
    place_texture,
    prim_names,
    print_on,
    show_while_there,
)
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


def author_velocities(target: Sdf.Layer, velocities: Sdf.Path, source: Sdf.Layer, points: Sdf.Path, frame: int) -> None:
    """Write the velocities of a frame, if its points are there, as central differences in time [m/s].

    Where a neighbor is missing, as at the first and the last frame, the difference from or to the other; where both
    are, 0.

    Args:
        target: Layer to write to.
        velocities: Attribute of it.
        source: Layer with the points of the frames; it has the same frame rate.
        points: Attribute of it.
        frame: Number of the frame.
    """
    here = _points(source, points, frame)
    if here is None:
        return
    earlier, later = (_points(source, points, neighbor) for neighbor in (frame - 1, frame + 1))
    frames = (earlier is not None) + (later is not None)
    last, first = here if later is None else later, here if earlier is None else earlier
    way = np.subtract(last, first, dtype=np.float64)  # of float32: it loses nothing
    way *= source.timeCodesPerSecond / max(frames, 1)
    target.SetTimeSample(velocities, frame, Vt.Vec3fArray.FromNumpy(way.astype(np.float32)))


def _points(layer: Sdf.Layer, path: Sdf.Path, frame: int) -> NDArray[np.float32] | None:
    """Return the points of a frame, shape (point_count, 3)."""
    value = layer.QueryTimeSample(path, frame)
    return None if value is None else np.asarray(value).reshape(-1, 3)


class NetForcesPrim:
    """A line from each particle along its net force.

    A force as large as the mean inflation force or the mean weight of a particle, whichever is larger, is drawn a
    twentieth of the balloon's size long; the attribute `userProperties:metersPerNewton` says how long a newton is.
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        balloon, mesh = model.scene.balloon[number], model.shapes[number].mesh
        size = float(np.ptp(mesh.points, axis=0).max())
        values = model.parameters["keyframe_values"].numpy()[0, number]
        inflation = _largest_inflation(balloon.inflation, values, total_area(mesh))
        weight = float(model.parameters["mass"].numpy()[0, number]) * abs(model.scene.gravity)
        self.meters_per_newton = 0.05 * size * mesh.vertex_count / max(inflation, weight, 1e-12)
        self.prim = define_lines(stage, path, [2] * mesh.vertex_count, width=0.003 * size)
        paint(self.prim, FORCE_COLOR, roughness=0.6)
        self.prim.GetPrim().CreateAttribute(
            "userProperties:metersPerNewton", Sdf.ValueTypeNames.Double, custom=True
        ).Set(self.meters_per_newton)

    def write(self, frame: Frame) -> None:
        begin = frame.points[self.number]
        end = begin + self.meters_per_newton * frame.net_forces[self.number]
        write_lines(self.prim, np.stack([begin, end], axis=1).reshape(-1, 3).astype(np.float32), frame.number)


def _largest_inflation(inflation: Inflation, values: NDArray[np.float32], area: float) -> float:
    """Return the forces of the inflation added up, whatever their direction, at the start or a keyframe [N]."""
    if inflation.kind == "gas":
        return abs(inflation.start_pressure) * area
    per_value = area if inflation.kind == "pressure" else 100.0
    return per_value * float(np.abs(values).max())


KINDS = {
    "force": Sdf.ValueTypeNames.Vector3d,
    "torque": Sdf.ValueTypeNames.Vector3d,
    "area": Sdf.ValueTypeNames.Double,
    "pressure": Sdf.ValueTypeNames.Double,
}
"""Types of the measures, as `Contact` has them [N, N m, m^2, Pa]"""


class ContactChannels:
    """Contact attributes of one balloon, `userProperties:contacts:THING:force` and so on.

    There are none unless the scene asks for them.
    """

    def __init__(self, prim: Usd.Prim, model: Model, number: int):
        self._attributes: dict[int, dict[str, Usd.Attribute]] = {}
        if not model.scene.contacts:
            return
        things = things_of(model)
        own = len(things) - model.balloon_count + number
        for thing, name in enumerate(prim_names(each.replace(" ", "_") for each in things)):
            if thing != own and (thing > 0 or model.scene.ground):
                self._attributes[thing] = {
                    kind: prim.CreateAttribute(f"userProperties:contacts:{name}:{kind}", value, custom=True)
                    for kind, value in KINDS.items()
                }
        self._number = number

    def write(self, frame: Frame) -> None:
        """Write the contacts of the balloon, and zero for things that do not touch it."""
        found = {each.thing: each for each in frame.contacts if each.number == self._number} if self._attributes else {}
        for thing, attributes in self._attributes.items():
            contact = found.get(thing)
            for kind, attribute in attributes.items():
                if kind in ("force", "torque"):
                    vector = np.asarray(getattr(contact, kind)).tolist() if contact else (0.0, 0.0, 0.0)
                    attribute.Set(Gf.Vec3d(*vector), frame.number)
                else:
                    attribute.Set(getattr(contact, kind) if contact else 0.0, frame.number)


SCHEMAS = ("PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI")
REST_POINTS = "restShapePoints"
"""Attribute, below `physics:`, of the points without stress"""
Types = Sdf.ValueTypeNames


def rest_points(shape: BalloonShape) -> NDArray[np.float64]:
    """Return a balloon's stress-free points, or those at the start if it is cut into panels, shape (point_count, 3)."""
    panels = shape.resting.vertex_count != shape.mesh.vertex_count
    return (shape.mesh if panels else shape.resting).points


def define_deformable(mesh_prim: UsdGeom.Mesh, model: Model, number: int) -> None:
    """Write a balloon's rest shape, mass, material, and initial points and velocities, before there are any frames."""
    prim, mesh = mesh_prim.GetPrim(), model.shapes[number].mesh
    for name in SCHEMAS:
        prim.AddAppliedSchema(name)
    UsdPhysics.CollisionAPI.Apply(prim)
    points = Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32))
    triangles = Vt.Vec3iArray.FromNumpy(np.ascontiguousarray(triangulate(mesh)[0], dtype=np.int32))
    mesh_prim.CreatePointsAttr(points)
    mesh_prim.CreateVelocitiesAttr(Vt.Vec3fArray.FromNumpy(_start_velocities(model, number)))
    rest = rest_points(model.shapes[number])
    _say(prim, REST_POINTS, Types.Point3fArray, Vt.Vec3fArray.FromNumpy(rest.astype(np.float32)))
    _say(prim, "restTriVertexIndices", Types.Int3Array, triangles)
    _say(prim, "restBendAnglesDefault", Types.Token, "restShape")
    if law_of(model.scene, number):
        _say_each(prim, "thicknesses", _thicknesses(model, number))
    else:
        _say_masses(prim, model, number)
    bind_substance(prim, model, number)


def _say_masses(prim: Usd.Prim, model: Model, number: int) -> None:
    """Write masses, which do not follow from a density with springs.

    They are the total, and each particle's where none is fixed.
    """
    mass = float(model.parameters["mass"].numpy()[0, number])
    _say(prim, "mass", Types.Float, mass)
    shares = model.shapes[number].mass_share
    if mass > 0.0 and (shares > 0.0).all():
        _say_each(prim, "masses", mass * shares)


def _thicknesses(model: Model, number: int) -> NDArray[np.float64]:
    """Return rest thicknesses [m]: of each point, or one where all are alike."""
    said = model.scene.balloon[number].material.weights
    weights = vertex_weights(model.shapes[number].mesh, said, "material.weights")
    thicknesses = float(model.parameters["thickness"].numpy()[0, number]) * weights
    return thicknesses if np.ptp(thicknesses) > 0.0 else thicknesses[:1]


def _start_velocities(model: Model, number: int) -> NDArray[np.float32]:
    """Return the initial velocities of a balloon's particles in the first world [m/s]: its own and its spin's.

    Zero where fixed.
    """
    names = ("initial_velocities", "initial_spins", "initial_centers")
    velocity, spin, center = (model.parameters[name].numpy()[0, number] for name in names)
    shape = model.shapes[number]
    velocities = velocity + np.cross(spin, shape.mesh.points - center)
    return np.where(shape.mass_share[:, None] > 0.0, velocities, 0.0).astype(np.float32)


def _say(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any) -> None:
    attribute = prim.CreateAttribute(f"physics:{name}", kind, custom=False, variability=Sdf.VariabilityUniform)
    attribute.Set(value)


def _say_each(prim: Usd.Prim, name: str, values: NDArray[np.float64]) -> None:
    """Write values of a geometry's points, or a single one for all of it, with the interpolation."""
    array = Vt.FloatArray.FromNumpy(values.astype(np.float32))
    prim.CreateAttribute(f"physics:{name}", Types.FloatArray, custom=False).Set(array)
    _say(prim, f"{name}:elementType", Types.Token, "constant" if len(values) == 1 else "point")


def define_gravity(stage: Usd.Stage, scene: Scene) -> None:
    """Define the gravity of the stage, as in UsdPhysics."""
    physics = UsdPhysics.Scene.Define(stage, HOME)
    down = -1.0 if scene.gravity >= 0.0 else 1.0
    physics.CreateGravityDirectionAttr(tuple(down * axis for axis in scene.up))
    physics.CreateGravityMagnitudeAttr(abs(scene.gravity))


MEASURES = ("volume", "area", "pressure", "stretch")
"""Attributes per frame under `userProperties:`, in m^3, m^2 and Pa; the last is the mean over the start"""
OF_GAS = ("moles", "thrust")
"""Attributes of balloons with gas: amount in mol, and thrust of the jet in N"""
PAINTED = {"roughness": 0.4, "clearcoat": 0.3}
"""Opaque finish of a mesh with looks of its own"""


def define_balloon(
    stage: Usd.Stage, path: Sdf.Path, shape: BalloonShape, number: int, balloon: Balloon
) -> UsdGeom.Mesh:
    """Define the mesh's topology and look; no points yet.

    The look is the balloon's color, else that of the mesh's file, else the palette's for its number.
    """
    mesh, prim = shape.mesh, UsdGeom.Mesh.Define(stage, path)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    # Who draws it refines it, or makes it smooth at least: simulated points are the control points of that surface.
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    if (mesh.face_vertex_counts == 3).any():
        prim.CreateTriangleSubdivisionRuleAttr(UsdGeom.Tokens.smooth)
    _crease(prim, replace(mesh, points=rest_points(shape)))
    prim.CreateDoubleSidedAttr(True)
    place_texture(prim, mesh)
    own, looks_like = balloon.color or palette_color(number), balloon.looks_like
    if looks_like == "foil":
        finish = {"roughness": 0.12, "metallic": 1.0}
    else:
        # A balloon of springs is inflated from the start; rubber is thick until it is.
        opacity = 0.92 if balloon.material.law == "springs" else 0.97
        finish = {"roughness": 0.2, "opacity": opacity, "clearcoat": 1.0, "ior": 1.0}  # the coat alone mirrors
    if looks := looks_of_file(mesh, balloon):
        if balloon.look is None and looks_like == "latex":
            finish = PAINTED
        paint_as_file(prim, mesh, looks, own, **finish)
        return prim
    material = paint(prim, own, **finish)
    if looks_like == "latex":
        define_latex_variant(material, own)
    if balloon.print is not None:
        print_on(material, balloon.print)
    return prim


def _crease(prim: UsdGeom.Mesh, mesh: PolygonMesh) -> None:
    """Keep edges sharp that are so at rest, as those of a box and the seam of foil, but no folds of a parcel."""
    edges = sharp_edges(mesh, SOFT_CREASE)
    if len(edges):
        prim.CreateCreaseIndicesAttr(Vt.IntArray.FromNumpy(edges.ravel()))
        prim.CreateCreaseLengthsAttr([2] * len(edges))
        prim.CreateCreaseSharpnessesAttr([UsdGeom.Mesh.SHARPNESS_INFINITE] * len(edges))


class BalloonPrim:
    """Balloon of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        kind = model.scene.balloon[number].inflation.kind
        self._has_pressure, self._has_gas = kind != "normal_force", kind == "gas"
        self.mesh = model.shapes[number].mesh
        self.prim = define_balloon(stage, path, model.shapes[number], number, model.scene.balloon[number])
        define_deformable(self.prim, model, number)
        self._may_burst = model.scene.balloon[number].material.strength is not None
        self._first_area = model.shapes[number].area
        self._measures = {
            name: self.prim.GetPrim().CreateAttribute(f"userProperties:{name}", Sdf.ValueTypeNames.Double, custom=True)
            for name in (*MEASURES, *(OF_GAS if self._has_gas else ()))
        }
        self._contacts = ContactChannels(self.prim.GetPrim(), model, number)

    def write(self, frame: Frame) -> None:
        points = Vt.Vec3fArray.FromNumpy(frame.points[self.number])
        self.prim.GetPointsAttr().Set(points, frame.number)
        if self._may_burst:
            corners = Vt.IntArray.FromNumpy(frame.corners(self.number))
            self.prim.GetFaceVertexIndicesAttr().Set(corners, frame.number)
        self.prim.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(self._seen(frame)), frame.number)
        for name, value in self._measure(frame).items():
            self._measures[name].Set(value, frame.number)
        self._contacts.write(frame)

    def _seen(self, frame: Frame) -> Vt.Vec3fArray:
        """Return the balloon's points but those that a tear cut off from all faces: they fly far, and are invisible."""
        points = frame.points[self.number]
        if frame.torn and frame.torn[self.number].any():
            points = points[beside_faces(self.mesh, frame.torn[self.number])]
        return Vt.Vec3fArray.FromNumpy(points)

    @property
    def points(self) -> tuple[Sdf.Path, Sdf.Path]:
        """Attributes of the points and of their velocities."""
        return self.prim.GetPointsAttr().GetPath(), self.prim.GetVelocitiesAttr().GetPath()

    def _measure(self, frame: Frame) -> dict[str, float]:
        volume, area = float(frame.volumes[self.number]), float(frame.areas[self.number])
        stretch = float(np.sqrt(area / self._first_area)) if self._first_area else 1.0
        measures = {"volume": volume, "area": area, "pressure": self._pressure(frame, area), "stretch": stretch}
        if self._has_gas:
            gas = float(frame.gas_amounts[self.number]), float(frame.thrusts[self.number])
            measures |= dict(zip(OF_GAS, gas, strict=True))
        return measures

    def _pressure(self, frame: Frame, area: float) -> float:
        """Return the gauge pressure [Pa]; for normal forces, their sum over the area."""
        if self._has_pressure:
            return float(frame.pressures[self.number])
        forces = frame.inflation_forces[self.number]
        inflation = float(np.sqrt(np.einsum("ij,ij->i", forces, forces)).sum(dtype=np.float64))
        return inflation / area if area > 0.0 else 0.0
