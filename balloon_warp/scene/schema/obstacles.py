"""Obstacles: solids that stay or move as the scene says, whatever pushes them."""

import itertools
from typing import Annotated, Self

from pydantic import Field, model_validator

from balloon_warp.scene.schema.fields import Color, NonNegative, UnitInterval, Vector
from balloon_warp.scene.schema.solid import Solid

Moved = tuple[NonNegative, Vector] | tuple[NonNegative, Vector, Vector]
"""Time [s], shift from `position` [m], and rotation on top of `rotation` [degrees]"""


class Obstacle(Solid):
    """Rigid obstacle that balloons and spheres cannot enter: fixed, or moved as the scene says, whatever pushes it."""

    motion: Annotated[list[Moved], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...] or [[time, shift, turn], ...]: shifts from `position` [m], turns on top of
    `rotation` about x, then y, then z [degrees]; linear between them, and constant before the first and after the last.
    When missing, a mesh of a USD stage moves by its time samples"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution for spheres [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which balloons are held, half the thickness of a sheet [m]; 0 when missing, and a
    thousandth of its size for a sheet"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else gray"""

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [keyframe[0] for keyframe in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self
