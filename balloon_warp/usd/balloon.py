"""Balloon in the stage: a polygon mesh, its velocities, forces and contacts, and a deformable for other simulators.

Velocities as a stage has them: of the points in it, so that motion blur follows the visible motion.

A simulated velocity is that of one substep. It trembles with vibrations that no frame shows, but motion blur would.

A balloon as other simulators take it up: the surface deformable of the AOUSD physics group's proposal.

USD does not know these schemas yet, so they are applied by name: Newton reads them, and who does not know them passes
them over. Lengths are meters and masses kilograms, as the stage says.

Balloon in the stage: a polygon mesh of fixed topology.

Where it may burst, the corners of its faces are written in each frame: those of a torn face are all at one of its
vertices, so that the number of faces stays.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from balloon_warp.frame import Frame, things_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.orientation import SOFT_CREASE, sharp_edges
from balloon_warp.mesh.topology import beside_faces, total_area, triangulate
from balloon_warp.model import Model
from balloon_warp.model.materials import law_of
from balloon_warp.model.shape import BalloonShape, vertex_weights
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.scene.around import FORCE_COLOR, looks_of_file, palette_color
from balloon_warp.usd.lines import define_lines, write_lines
from balloon_warp.usd.material import (
    HOME,
    bind_substance,
    define_latex_variant,
    paint,
    paint_as_file,
    place_texture,
    prim_names,
    print_on,
)


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
