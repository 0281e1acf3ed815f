"""A balloon as other simulators take it up: the surface deformable of the AOUSD physics group's proposal.

USD does not know these schemas yet, so they are applied by name: Newton reads them, and who does not know them passes
them over. Lengths are meters and masses kilograms, as the stage says.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, Vt

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.model.materials import law_of
from balloon_warp.model.model import Model
from balloon_warp.model.shape import BalloonShape, vertex_weights
from balloon_warp.outputs.usd.rigid import HOME
from balloon_warp.outputs.usd.substance import bind_substance
from balloon_warp.scene import Scene

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
