"""Rigid things for other simulators: colliders of `UsdPhysics`, free bodies, and kinematic bodies.

Kinematic bodies move by their time samples.
"""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdPhysics, UsdShade

HOME = Sdf.Path("/World/Physics")
"""Path of prims for simulators alone"""
SURFACE = ("friction", "restitution")
"""Suffixes of the parameters that `be_hit` takes"""


def substance_of(prim: Usd.Prim) -> tuple[Usd.Prim, UsdPhysics.MaterialAPI]:
    """Define a material for the purpose of physics and bind it to a prim of the stage's /World."""
    path = HOME.AppendPath(prim.GetPath().MakeRelativePath(HOME.GetParentPath()))
    material = UsdShade.Material.Define(prim.GetStage(), path)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, UsdShade.Tokens.fallbackStrength, "physics")
    return material.GetPrim(), UsdPhysics.MaterialAPI.Apply(material.GetPrim())


def be_hit(prim: Usd.Prim, friction: float, restitution: float) -> None:
    """Make a prim a collider; it stays where it is, unless it is a body."""
    UsdPhysics.CollisionAPI.Apply(prim)
    _, surface = substance_of(prim)
    surface.CreateStaticFrictionAttr(friction)
    surface.CreateDynamicFrictionAttr(friction)
    surface.CreateRestitutionAttr(restitution)


def be_moved(prim: Usd.Prim) -> None:
    """Make a prim kinematic: it moves by its time samples, whatever pushes it."""
    UsdPhysics.RigidBodyAPI.Apply(prim).CreateKinematicEnabledAttr(True)


def move_freely(prim: Usd.Prim, velocity: NDArray[np.floating], spin: NDArray[np.floating]) -> None:
    """Make a prim a free body.

    Args:
        velocity: Velocity at the start, along the prim's own axes, as in UsdPhysics [m/s], shape (3,).
        spin: Angular velocity likewise [rad/s], shape (3,).
    """
    body = UsdPhysics.RigidBodyAPI.Apply(prim)
    body.CreateVelocityAttr(Gf.Vec3f(*velocity.tolist()))
    body.CreateAngularVelocityAttr(Gf.Vec3f(*np.degrees(spin).tolist()))
