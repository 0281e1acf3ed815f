"""A balloon as other simulators take it up: the surface deformable of the AOUSD physics group's proposal.

USD does not know these schemas yet, so they are applied by name: Newton reads them, and who does not know them passes
them over. Springs have no counterpart there, so what is said is the mass and the shape at rest.
"""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.scene import Scene

SCHEMAS = ("PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI")
Types = Sdf.ValueTypeNames


def define_deformable(mesh_prim: UsdGeom.Mesh, mesh: PolygonMesh, mass: float) -> None:
    """Say how a balloon rests, what it weighs [kg], and where its points are before there are any frames."""
    prim = mesh_prim.GetPrim()
    for name in SCHEMAS:
        prim.AddAppliedSchema(name)
    UsdPhysics.CollisionAPI.Apply(prim)
    points = Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32))
    triangles = Vt.Vec3iArray.FromNumpy(np.ascontiguousarray(triangulate(mesh)[0], dtype=np.int32))
    mesh_prim.CreatePointsAttr(points)
    for name, kind, value in (
        ("mass", Types.Float, mass),
        ("restShapePoints", Types.Point3fArray, points),
        ("restTriVertexIndices", Types.Int3Array, triangles),
        ("restBendAnglesDefault", Types.Token, "restShape"),
    ):
        prim.CreateAttribute(f"physics:{name}", kind, custom=False, variability=Sdf.VariabilityUniform).Set(value)


def define_gravity(stage: Usd.Stage, scene: Scene) -> None:
    """The acceleration that acts on all, as UsdPhysics has it."""
    physics = UsdPhysics.Scene.Define(stage, "/World/Physics")
    down = -1.0 if scene.gravity >= 0.0 else 1.0
    physics.CreateGravityDirectionAttr(tuple(down * axis for axis in scene.up))
    physics.CreateGravityMagnitudeAttr(abs(scene.gravity))
