"""Rigid bodies that move freely."""

from typing import Literal, Self

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Color, NonNegative, Positive, UnitInterval, Vector
from balloon_warp.scene.schema.solid import Solid


class Body(Solid):
    """Free rigid body, with mass and inertia: balloons press on it and carry it.

    It falls, turns and meets spheres, obstacles, the ground and other bodies.
    """

    shape: Literal["box", "capsule", "mesh"] = "box"  # pyright: ignore[reportIncompatibleVariableOverride]
    """Shape; when left out, it follows from the fields that are given. A "capsule" stands along the up axis; a "mesh"
    that is not closed is a sheet, and needs a thickness"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the center of mass at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start about the center of mass, along the axes of the scene [rad/s]"""
    mass: Positive | None = None
    """Mass [kg]; when missing, it follows from `density`, or is 1 kg"""
    density: Positive | None = None
    """Density of the material that fills the body, or of a sheet's material [kg/m^3]; instead of `mass`"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient; a contact takes the geometric mean of both, if a balloon has one of its own [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution; a contact takes the geometric mean of both [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which others are held, half the thickness of a sheet [m]; 0 when missing"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else a color of
    the palette"""

    @model_validator(mode="after")
    def _weighs_something(self) -> Self:
        if self.mass is not None and self.density is not None:
            raise ValueError(f"density: must be left out where mass is given (got {self.density:g} and {self.mass:g})")
        return self
