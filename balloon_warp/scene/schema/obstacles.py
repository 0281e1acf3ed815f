"""What is in the way of balloons and goes where it is told, whatever pushes it."""

import itertools
from typing import Annotated, Self

from pydantic import Field, model_validator

from balloon_warp.scene.schema.fields import Color, NonNegative, UnitInterval, Vector
from balloon_warp.scene.schema.solid import Solid

Moved = tuple[NonNegative, Vector] | tuple[NonNegative, Vector, Vector]
"""a time [s], a shift from `position` [m], and a turn on top of `rotation` [degrees]"""


class Obstacle(Solid):
    """A rigid thing that balloons and spheres cannot enter: it stays, or moves as it is told, whatever pushes it."""

    motion: Annotated[list[Moved], Field(min_length=1)] | None = None
    """keyframes [[time, shift], ...] or [[time, shift, turn], ...]: shifts from `position` [m], turns on top of
    `rotation` about x, then y, then z [degrees]; linear between them, and still before the first and after the last.
    When missing, a mesh of a USD stage moves as the time samples there say"""
    friction: NonNegative = 0.5
    """Coulomb's coefficient [1]"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed, for spheres [1]"""
    thickness: NonNegative | None = None
    """how far from its surface balloons are held [m], half the thickness of a sheet; if missing 0, and for a sheet a
    thousandth of its size"""
    name: str = ""
    """what its prim is called in the stage; its shape when empty"""
    color: Color | None = None
    """linear RGB; when missing, what the mesh's file says, else gray"""

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [keyframe[0] for keyframe in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self
