"""What the fields of a scene are made of: tables, numbers within bounds, values that change with time."""

import typing
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from balloon_warp.kernels.laws import PARAMETERS, Parameter
from balloon_warp.kernels.laws.law import FAR, TINY

Real = Annotated[float, Field(gt=-FAR, lt=FAR)]
Positive = Annotated[float, Field(ge=TINY, lt=FAR)]
NonNegative = Annotated[float, Field(ge=0, lt=FAR)]
Vector = tuple[Real, Real, Real]
Keyframe = tuple[NonNegative, Real]
"""a time [s] and the value at that time"""
Keyframed = Real | Annotated[list[Keyframe], Field(min_length=1)]
"""a number, or keyframes [[time, value], ...]: linear between them, constant before the first and after the last;
at least a frame apart"""
UnitInterval = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[int, Field(ge=0)]
"""from 0, as in lists of the scene and vertices of a file"""
Color = tuple[UnitInterval, UnitInterval, UnitInterval]
"""linear RGB"""
LawTables = dict[str, dict[str, Real | Vector]]
"""parameters of laws of one's own, by the law's name and the parameter's"""


def field_of(name: str) -> Any:
    """The field of a law's parameter: default, bounds, unit and meaning are those of its row."""
    row = PARAMETERS[name]
    return Field((row.default,) * 3 if row.size == 3 else row.default, **_bounds(row), description=_description(row))


def optional_field_of(name: str) -> Any:
    """The same, of one that may be left out: None stands for the default of its row."""
    row = PARAMETERS[name]
    return Field(None, **_bounds(row), description=_description(row))


def _bounds(row: Parameter) -> dict[str, Any]:
    """As Pydantic has them; a vector's are those of its parts."""
    if row.size == 3:
        return {}
    return {"gt" if row.least == -FAR else "ge": row.least, "lt" if row.most == FAR else "le": row.most}


def _description(row: Parameter) -> str:
    return f"{row.meaning} [{row.unit}]".strip()


class Table(BaseModel):
    """A table of the scene file: no unknown fields, no NaN, no infinity."""

    model_config = ConfigDict(
        extra="forbid", allow_inf_nan=False, frozen=True, arbitrary_types_allowed=True, use_attribute_docstrings=True
    )


def table_in(annotation: Any) -> type[BaseModel] | None:
    """The table that a field of this type has, or has a list of, if any."""
    if isinstance(annotation, type) and not typing.get_args(annotation):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((found for part in typing.get_args(annotation) if (found := table_in(part))), None)
