"""What the fields of a scene are made of: tables, numbers within bounds, values that change with time."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError


def _not_tiny(value: float) -> float:
    """What is divided by must not vanish in float32, nor its square."""
    if value < 1e-12:
        raise PydanticCustomError("tiny", "Input should be at least 1e-12")
    return value


Real = Annotated[float, Field(gt=-1e12, lt=1e12)]
Positive = Annotated[float, Field(gt=0, lt=1e12), AfterValidator(_not_tiny)]
NonNegative = Annotated[float, Field(ge=0, lt=1e12)]
Vector = tuple[Real, Real, Real]
Keyframe = tuple[NonNegative, Real]
"""a time [s] and the value at that time"""
Keyframed = Real | Annotated[list[Keyframe], Field(min_length=1)]
"""a number, or keyframes [[time, value], ...]: linear between them, constant before the first and after the last;
at least a frame apart"""
LawTables = dict[str, dict[str, Real | Vector]]
"""parameters of laws, by the law's name and the parameter's"""
UnitInterval = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[int, Field(ge=0)]
"""from 0, as in lists of the scene and vertices of a file"""
Color = tuple[UnitInterval, UnitInterval, UnitInterval]
"""linear RGB"""


class Table(BaseModel):
    """A table of the scene file: no unknown fields, no NaN, no infinity."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, arbitrary_types_allowed=True)
