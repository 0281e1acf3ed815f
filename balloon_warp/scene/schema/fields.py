"""Field types of scene tables, and their descriptions."""

import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, SkipJsonSchema
from pydantic_core import PydanticCustomError, core_schema

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import PARAMETERS, Parameter
from balloon_warp.kernels.laws.law import FAR, TINY
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.complaint import complaint, table_in, toml_value
from balloon_warp.system.shown import DOC, FieldHelp, Shown, ShownType, describe, docstrings, plain_docstring

Tables = type[BaseModel]


def meaning_of(table: Tables, field: str) -> str:
    """Return a field's meaning on one line, with its unit; for a nested table, the first line of its docstring."""
    said = table.model_fields[field].description or docstrings(table).get(field)
    inner = table_in(table.model_fields[field].annotation)
    return " ".join((said or (first_line(inner) if inner else "")).split())


def first_line(table: Tables) -> str:
    """Return the first line of a table's docstring."""
    return inspect.cleandoc(plain_docstring(table)).partition("\n")[0]


def fields_of(table: Tables) -> Iterator[FieldHelp]:
    """Describe a table's fields for help()."""
    properties = table.model_json_schema(schema_generator=PlainSchema)["properties"]
    for field, info in table.model_fields.items():
        default = ", required" if info.is_required() else f" = {info.default!r}"
        inner, takes = table_in(info.annotation), taken(properties[field]).replace("`", "")
        if inner:
            takes = f"list of {inner.__name__}" if takes.startswith("list") else inner.__name__
        yield FieldHelp(f"{field}{default} ({takes})" if takes else f"{field}{default}", meaning_of(table, field))


class PlainSchema(GenerateJsonSchema):
    """Make a JSON schema without the types that fields accept from Python alone."""

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> JsonSchemaValue:
        return {"type": "null"}


def taken(schema: dict[str, Any], several: bool = False) -> str:
    """Describe in words the values that a field accepts, from its JSON schema.

    Args:
        several: whether it is one of several alike.
    """
    if schema.get("$ref", "").endswith(f"/{PolygonMesh.__name__}"):
        return ""
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(said for each in schema["anyOf"] if (said := taken(each, several))))
    if choices := schema.get("enum", [schema["const"]] if "const" in schema else None):
        return " or ".join(f"`{toml_value(choice)}`" for choice in choices)
    match schema.get("type", "object"):
        case "null":
            return ""
        case "array" if items := schema.get("prefixItems"):
            if all(item == items[0] for item in items):
                return f"{len(items)} {taken(items[0], several=True)}"
            return f"[{', '.join(map(taken, items))}]"
        case "array":
            return f"list of {taken(schema['items'], several=True)}"
        case "boolean":
            return "`true` or `false`"
        case "string":
            return "file" if schema.get("format") == "path" else "text"
        case "number" | "integer" as kind:
            return f"{'whole ' * (kind == 'integer')}number{'s' * several}{_bounds_of_schema(schema)}"
    return "tables" if several else "table"


def _bounds_of_schema(schema: dict[str, Any]) -> str:
    least, most = schema.get("minimum", -FAR), schema.get("maximum", FAR)
    if least > -FAR and most < FAR:
        return f" from {least:,g} to {most:,g}"
    if least == TINY:
        return " > 0"
    return f" ≥ {least:,g}" if least > -FAR else ""


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)
Real = Annotated[float, Field(gt=-FAR, lt=FAR)]
Positive = Annotated[float, Field(ge=TINY, lt=FAR)]
NonNegative = Annotated[float, Field(ge=0, lt=FAR)]
Vector = tuple[Real, Real, Real]
Keyframe = tuple[NonNegative, Real]
"""Time [s] and the value at that time"""
Keyframed = Real | Annotated[list[Keyframe], Field(min_length=1)]
"""Number, or keyframes [[time, value], ...]: linear between them, constant before the first and after the last; at
least a frame apart, or nearly linear from frame to frame"""
MOST_MISSED = 0.05
"""Largest fraction of a keyframed value that sampling at frames may miss"""
UnitInterval = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[int, Field(ge=0)]
"""Index from 0, as in lists of the scene and vertices of a file"""
ObjectName = Annotated[str, Field(pattern="[^/]")]
Prim = ObjectName | Annotated[list[ObjectName], Field(min_length=1)]
"""Names of objects of a mesh file, or paths of prims of a USD stage"""


def _color_of(given: Any) -> Any:
    """Return linear RGB of a color's name or hexadecimal digits, which are sRGB; all else as it is."""
    if not isinstance(given, str):
        return given
    from PIL import ImageColor  # a tenth of the time that a command takes to begin

    try:
        red, green, blue, *_ = (value / 255.0 for value in ImageColor.getrgb(given))
    except ValueError:
        expected = 'Input should be a color such as "red" or "#ff8000", or three numbers from 0 to 1'
        raise PydanticCustomError("color", expected) from None
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (red, green, blue))


Color = Annotated[
    tuple[UnitInterval, UnitInterval, UnitInterval],
    BeforeValidator(_color_of, json_schema_input_type=tuple[UnitInterval, UnitInterval, UnitInterval] | str),
]
"""Linear RGB, or the name or hexadecimal digits of a color of the web"""
Rule = SkipJsonSchema[Callable[[Any], Any]]
"""Function of a mesh's points, which only Python can give"""
LawTables = dict[str, dict[str, Real | Vector]]
"""Parameters of user-defined laws, by the law's name and the parameter's"""


def field_of(name: str) -> Any:
    """Make the field of a law's parameter, with default, bounds, unit and meaning from its row."""
    row = PARAMETERS[name]
    return Field((row.default,) * 3 if row.size == 3 else row.default, **_bounds(row), description=_description(row))


def optional_field_of(name: str) -> Any:
    """Make the optional field of a law's parameter: None stands for the default of its row."""
    row = PARAMETERS[name]
    return Field(None, **_bounds(row), description=_description(row))


def _bounds(row: Parameter) -> dict[str, Any]:
    """Return the bounds of a parameter's row as Pydantic keywords; bounds of a vector apply to its components."""
    if row.size == 3:
        return {}
    return {"gt" if row.least == -FAR else "ge": row.least, "lt" if row.most == FAR else "le": row.most}


def _description(row: Parameter) -> str:
    return f"{row.meaning} [{row.unit}]".strip()


def missed_between_frames(keyframes: Sequence[Keyframe], frame_seconds: float) -> float:
    """Return the fraction of a keyframed value that linear interpolation from frame to frame misses.

    The fraction is relative to the whole until the frame after the last keyframe: for a pump, the amount of gas that it
    delivers.
    """
    times, values = np.array(keyframes).T
    frames = frame_seconds * np.arange(math.floor(times[0] / frame_seconds), math.ceil(times[-1] / frame_seconds) + 1)
    every = np.union1d(frames, times)
    true, taken = np.interp(every, times, values), np.interp(every, frames, np.interp(frames, times, values))
    missed, whole = (0.5 * np.sum((v[1:] + v[:-1]) * np.diff(every)) for v in (true - taken, np.abs(true)))
    return float(abs(missed) / whole) if whole else 0.0


class TableType(ShownType, ModelMetaclass):
    # The type of tables.
    __doc__ = DOC  # type: ignore


class Table(Shown, BaseModel, metaclass=TableType):
    """A table of the scene file: no unknown fields, no NaN, no infinity.

    Raises:
        InputError: made in Python, it has a field that is wrong, which is named as in a scene file.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, arbitrary_types_allowed=True)

    _internal: ClassVar[tuple[str, ...]] = ("model_config",)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Describe the table's fields in help(), and name them with their defaults in its signature."""
        empty, of_name = inspect.Parameter.empty, inspect.Parameter.KEYWORD_ONLY
        describe(
            cls,
            fields_of,
            (
                inspect.Parameter(name, of_name, default=empty if field.is_required() else field.get_default())
                for name, field in cls.model_fields.items()
            ),
        )

    if not TYPE_CHECKING:  # where each table's own fields are the arguments

        def __init__(self, *given: Any, **fields: Any):
            name, first = type(self).__name__, next(iter(type(self).model_fields))
            if given:
                raise InputError(f"{name}: takes fields by their names, as in {name}({first}=...)")
            try:
                super().__init__(**fields)
            except ValidationError as error:
                place = "" if name == "Scene" else f"{name.lower()}."
                raise InputError(f"{place}{complaint(error, type(self))}") from None

        # a table within another is made without it, so that the whole path is known
        __init__.__pydantic_base_init__ = True

        def __setattr__(self, name: str, value: Any) -> None:
            other = "load_scene(scene, {PATH: VALUE}) makes another scene"
            raise InputError(f"{name}: a {type(self).__name__} does not change; {other}")

    @model_validator(mode="before")
    @classmethod
    def _without_numpy(cls, given: Any) -> Any:
        """Convert NumPy arrays and numbers to lists and plain numbers."""
        if not isinstance(given, dict):
            return given
        return {
            name: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
            for name, value in given.items()
        }

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Show only fields that differ from their defaults."""
        for name, field in type(self).model_fields.items():
            if (value := getattr(self, name)) != field.get_default():
                yield name, str(value) if isinstance(value, Path) else value

    def __str__(self) -> str:
        return repr(self)
