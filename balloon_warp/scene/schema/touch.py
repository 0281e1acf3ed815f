"""Balloons that touch each other, and themselves, and spheres that are small beside their faces."""

from typing import Self

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Table, field_of, optional_field_of


class Touch(Table):
    """What happens where surfaces of balloons meet. Without this table they pass through each other."""

    balloons: bool = True
    """whether balloons touch each other"""
    itself: bool = False
    """whether parts of a balloon touch each other"""
    spheres: bool = True
    """whether spheres that are small beside faces touch these, and not only particles: then none comes through, however
    small it is and however fast"""
    thickness: float | None = optional_field_of("touch_thickness")
    """distance at which surfaces begin to push; a twentieth of an edge of their meshes when missing [m]"""
    stiffness: float | None = optional_field_of("touch_stiffness")
    """of each particle's contact; a quarter of all of a particle's springs when missing [N/m]"""
    friction: float = field_of("touch_friction")
    """Coulomb's coefficient of balloons that do not say their own, between balloons [1]; 0.3 when missing"""

    @model_validator(mode="after")
    def _something_touches(self) -> Self:
        if not self.balloons and not self.itself and not self.spheres:
            raise ValueError(
                "balloons: must be true, or `itself` or `spheres` must (got none); without [touch] nothing touches"
            )
        return self
