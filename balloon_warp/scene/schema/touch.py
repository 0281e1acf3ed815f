"""Balloons that touch each other, and themselves."""

from typing import Self

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Table, field_of, optional_field_of


class Touch(Table):
    """What happens where surfaces of balloons meet. Without this table they pass through each other."""

    balloons: bool = True
    """whether balloons touch each other"""
    itself: bool = False
    """whether parts of a balloon touch each other"""
    thickness: float | None = optional_field_of("touch_thickness")
    stiffness: float | None = optional_field_of("touch_stiffness")
    friction: float = field_of("touch_friction")

    @model_validator(mode="after")
    def _something_touches(self) -> Self:
        if not self.balloons and not self.itself:
            raise ValueError("balloons: must be true, or `itself` must (got neither); without [touch] nothing touches")
        return self
