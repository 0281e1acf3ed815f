"""Rigid bodies that move freely."""

from typing import Literal, Self

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Color, NonNegative, Positive, UnitInterval, Vector
from balloon_warp.scene.schema.solid import Solid


class Body(Solid):
    """A free rigid body, with mass and inertia: balloons press on it and carry it.

    It falls, turns and meets spheres, obstacles, the ground and other bodies."""

    shape: Literal["box", "capsule", "mesh"] = "box"  # pyright: ignore[reportIncompatibleVariableOverride]
    """when left out, the one that has the fields that are given. A "capsule" stands along the up axis; a "mesh" that is
    not closed is a sheet, and needs a thickness"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """of its center of mass at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """at the start, about its center of mass, along the axes of the scene [rad/s]"""
    mass: Positive | None = None
    """[kg]; what `density` says when missing, or 1 kg"""
    density: Positive | None = None
    """of its material, which fills it, or of a sheet's [kg/m^3]; instead of `mass`"""
    friction: NonNegative = 0.5
    """Coulomb's coefficient; where two things meet, the geometric mean of both counts, if a balloon has one of its own
    [1]"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed; where two things meet, the geometric mean of both counts [1]"""
    thickness: NonNegative | None = None
    """how far from its surface others are held [m], half the thickness of a sheet; 0 when missing"""
    name: str = ""
    """what its prim is called in the stage; its shape when empty"""
    color: Color | None = None
    """linear RGB; when missing, what the mesh's file says, else one of the palette"""

    @model_validator(mode="after")
    def _weighs_something(self) -> Self:
        if self.mass is not None and self.density is not None:
            raise ValueError(f"density: must be left out where mass is given (got {self.density:g} and {self.mass:g})")
        return self
