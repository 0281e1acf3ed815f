"""Rigid things as other simulators take them up: colliders of `UsdPhysics`, bodies that move freely, and bodies that go
where time samples put them."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdPhysics, UsdShade

HOME = Sdf.Path("/World/Physics")
"""of what is there for simulators alone"""
SURFACE = ("friction", "restitution")
"""how the names of parameters end that `be_hit` asks for"""


def substance_of(prim: Usd.Prim) -> tuple[Usd.Prim, UsdPhysics.MaterialAPI]:
    """Define a material for the purpose of physics and bind it to a prim of the stage's /World."""
    path = HOME.AppendPath(prim.GetPath().MakeRelativePath(HOME.GetParentPath()))
    material = UsdShade.Material.Define(prim.GetStage(), path)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, UsdShade.Tokens.fallbackStrength, "physics")
    return material.GetPrim(), UsdPhysics.MaterialAPI.Apply(material.GetPrim())


def be_hit(prim: Usd.Prim, friction: float, restitution: float) -> None:
    """Have others collide with a prim. It stays where it is, unless it is a body."""
    UsdPhysics.CollisionAPI.Apply(prim)
    _, surface = substance_of(prim)
    surface.CreateStaticFrictionAttr(friction)
    surface.CreateDynamicFrictionAttr(friction)
    surface.CreateRestitutionAttr(restitution)


def be_moved(prim: Usd.Prim) -> None:
    """Have a prim go where its time samples say, whatever pushes it."""
    UsdPhysics.RigidBodyAPI.Apply(prim).CreateKinematicEnabledAttr(True)


def move_freely(prim: Usd.Prim, velocity: NDArray[np.floating], spin: NDArray[np.floating]) -> None:
    """Have a prim move freely.

    Args:
        velocity: at the start, along the prim's own axes, as UsdPhysics has them [m/s], shape (3,).
        spin: likewise [rad/s], shape (3,).
    """
    body = UsdPhysics.RigidBodyAPI.Apply(prim)
    body.CreateVelocityAttr(Gf.Vec3f(*velocity.tolist()))
    body.CreateAngularVelocityAttr(Gf.Vec3f(*np.degrees(spin).tolist()))
