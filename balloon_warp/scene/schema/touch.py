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
    stiffness: float | None = optional_field_of("touch_stiffness")
    friction: float = field_of("touch_friction")

    @model_validator(mode="after")
    def _something_touches(self) -> Self:
        if not self.balloons and not self.itself and not self.spheres:
            raise ValueError(
                "balloons: must be true, or `itself` or `spheres` must (got none); without [touch] nothing touches"
            )
        return self
