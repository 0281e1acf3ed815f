"""Balloons that touch each other, and themselves, and spheres that are small beside their faces."""

from typing import Literal, Self

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Table, field_of, optional_field_of


class Touch(Table):
    """Contact between surfaces of balloons; without this table balloons touch as its defaults say."""

    balloons: bool = True
    """Balloons touch each other"""
    itself: bool | Literal["auto", "soft"] = "auto"
    """Parts of a balloon touch each other, with "soft" so softly that the step of a balloon alone is hardly shorter;
    "auto" is true where parts of a mesh face each other across a gap that inflation may close, and for foil, which
    bends freely and is flat or folded at the start, and "soft" where a closed mesh is so slender that it may bend into
    itself, or starts under water or with a pressure below the air's"""
    edges: bool | Literal["auto"] = "auto"
    """Edges of balloons touch edges, so that no fold crosses another; "auto" takes those that are sharp at the start,
    all edges of balloons that bend freely and are folded, flat or open then, and all where balloons touch themselves"""
    spheres: bool = True
    """Small spheres touch faces, not only particles, so that none passes through, however small and fast"""
    thickness: float | None = optional_field_of("touch_thickness")
    """Distance at which surfaces begin to push; a twentieth of their meshes' edges when missing [m]"""
    stiffness: float | None = optional_field_of("touch_stiffness")
    """Contact stiffness of each particle; a quarter of the sum of a particle's springs when missing [N/m]"""
    friction: float = field_of("touch_friction")
    """Coulomb friction coefficient between balloons that have none of their own [1]; 0.3 when missing"""

    @model_validator(mode="after")
    def _something_touches(self) -> Self:
        if not self.balloons and not self.itself and not self.spheres:
            raise ValueError(
                "balloons: expected true for balloons, itself or spheres (got none); touch = false turns all contact "
                "off"
            )
        return self
