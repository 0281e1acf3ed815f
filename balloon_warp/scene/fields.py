"""Field types of scene tables, their descriptions, and a wrong value in one sentence.

Materials and air that are known, with their sources; properties given for some particles.
"""

import inspect
import math
import re
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, SkipJsonSchema
from pydantic_core import ErrorDetails, PydanticCustomError, core_schema

from balloon_warp.errors import InputError, ask, closest, did_you_mean
from balloon_warp.kernels.laws import PARAMETERS, Parameter
from balloon_warp.kernels.laws.law import FAR, TINY
from balloon_warp.mesh import PolygonMesh
from balloon_warp.system.api import DOC, FieldHelp, Shown, ShownType, describe, docstrings, plain_docstring


def table_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table that a field of this type has, or has a list of, if any."""
    if isinstance(annotation, type) and not typing.get_args(annotation):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((found for part in typing.get_args(annotation) if (found := table_in(part))), None)


LISTS = ("balloon", "sphere", "string", "obstacle", "body", "tube", "force", "change")
"""Tables that may occur several times"""
ALSO_CALLED = {
    **dict.fromkeys(("fps", "frame_rate", "framerate"), "frames_per_second"),
    **dict.fromkeys(("duration", "seconds"), "frames"),
}
"""Fields by names that other programs have for them"""
MOST_ASKED = 4
"""Largest number of fields that a question names"""


def complaint(error: ValidationError, schema: type[BaseModel]) -> str:
    """Name the first wrong field, and its expected values.

    A value that fits no member of a union fails each of them: their expectations are joined by "or".
    """
    by_field: dict[str, list[ErrorDetails]] = {}
    for details in error.errors():
        if details["type"] == "callable_type":
            continue  # Python alone may give a function: there are other words for it
        by_field.setdefault(_field(details, schema), []).append(details)
    # Unknown fields come first: a missing field is often there by another name.
    unknown = (field for field, failures in by_field.items() if failures[0]["type"] == "extra_forbidden")
    field = next(unknown, next(iter(by_field)))
    deepest = max(len(details["loc"]) for details in by_field[field])  # of a union, the members it nearly fits
    failures = [details for details in by_field[field] if len(details["loc"]) == deepest]
    first = failures[0]
    match first["type"]:
        case "extra_forbidden":
            what = "table" if _is_table(first["input"]) else "field"
            return f"{field}: unknown {what}{_hint(first, schema)}"
        case "list_type" if isinstance(first["input"], dict) and field in LISTS:
            return f"{field}: is one table, [{field}]; expected a list of them, each beginning with [[{field}]]"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            message = first["msg"].removeprefix("Value error, ")
            return f"{field}.{message}" if field else message
    expected = " or ".join(dict.fromkeys(_expected(details) for details in failures))
    return f"{field}: must be {expected} (got {_shown(first['input'])})"


def _field(details: ErrorDetails, schema: type[BaseModel]) -> str:
    """Write the dotted path of the wrong field: Pydantic's location less the members of unions that it names too."""
    return ".".join(_walk(details, schema)[0])


def _walk(details: ErrorDetails, schema: type[BaseModel]) -> tuple[list[str], type[BaseModel]]:
    """Walk the steps of the path, to the last table on it that the schema knows."""
    steps: list[str] = []
    table, keys = schema, 0
    for place, step in enumerate(details["loc"]):
        unknown = details["type"] == "extra_forbidden" and place == len(details["loc"]) - 1
        if isinstance(step, int) or unknown or keys:
            steps.append(_shortened(str(step)))
            keys = max(keys - 1, 0)
        elif step in table.model_fields:
            steps.append(step)
            annotation = table.model_fields[step].annotation
            table, keys = table_in(annotation) or table, _key_count(annotation)
    return steps, table


def _is_table(value: object) -> bool:
    """Return whether a value is a table, or a list of tables."""
    return isinstance(value[0] if isinstance(value, list) and value else value, dict)


def _hint(details: ErrorDetails, schema: type[BaseModel]) -> str:
    """Find the known field that was probably meant, or all that are known there.

    It is of the same name elsewhere, near by if it is, or of a similar name there. A table is taken for another table
    only.
    """
    name, (steps, table) = str(details["loc"][-1]), _walk(details, schema)
    only_tables = _is_table(details["input"])
    if (meant := ALSO_CALLED.get(name, name.removesuffix("s"))) in table.model_fields:
        return ask([meant])

    def paths_of(is_meant: Callable[[str], bool]) -> list[str]:
        return [*_paths_of(schema, is_meant, only_tables)]

    paths = paths_of(lambda field: field == name)
    if near := [path for path in paths if path.split(".")[0] == steps[0]] or paths:
        return ask(near)
    alike = closest(name, dict.fromkeys(path.split(".")[-1] for path in paths_of(lambda field: True)))
    here = [field for field in alike if field in table.model_fields]
    anywhere = paths_of(lambda field: field in alike)
    if here or 0 < len(anywhere) <= MOST_ASKED:
        return ask(here or anywhere)
    return did_you_mean(name, table.model_fields) or f"; known here are {', '.join(table.model_fields)}"


def _paths_of(table: type[BaseModel], is_meant: Callable[[str], bool], only_tables: bool) -> Iterator[str]:
    """Find the paths of all fields of such a name, in a table and those within it."""
    for field, info in table.model_fields.items():
        inner = table_in(info.annotation)
        if is_meant(field) and (inner or not only_tables):
            yield field
        if inner:
            yield from (f"{field}.{path}" for path in _paths_of(inner, is_meant, only_tables))


def _key_count(annotation: object) -> int:
    """Return the number of nested keys in a field that the schema does not know."""
    arguments = typing.get_args(annotation)
    return 1 + _key_count(arguments[1]) if typing.get_origin(annotation) is dict else 0


def _expected(details: ErrorDetails) -> str:
    """Return the end of "must be ..." for a sentence of Pydantic."""
    message = details["msg"]
    if details.get("ctx", {}).get("ge") == TINY:
        return "greater than 0" if float(details["input"]) <= 0.0 else f"at least {TINY:g}"
    for opening, replacement in (
        ("Input should be a valid dictionary", "a table"),
        ("Input should be a valid tuple", "numbers in brackets"),
        ("Input should be an instance of PolygonMesh", "a PolygonMesh"),
        ("Input is not a valid path", "a path"),
        ("List should have at least 1 item", "a list of at least one item"),
    ):
        if message.startswith(opening):
            return replacement
    expected = re.split(", (?:unable|got) ", message.removeprefix("Input should be "), maxsplit=1)[0]
    return {"True": "true", "False": "false"}.get(expected, expected)


def _shown(value: object) -> str:
    return _shortened(repr(value))


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def toml_value(value: Any) -> str:
    """Write a truth value, number, text, list or table. Every number has all its digits."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping) and not value:
        return "{}"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(name)} = {toml_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _key(name: str) -> str:
    """Return a TOML key, bare where it is a word; dots would split it."""
    return name if name.isascii() and name.isidentifier() else _quoted(name)


def _quoted(text: str) -> str:
    escapes = {'"': '\\"', "\\": "\\\\"}
    escaped = (escapes.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text)
    return '"' + "".join(escaped) + '"'


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


EARTH_RADIUS = 6356766.0
"""Radius by which gravity falls with height [m]"""
STANDARD_GRAVITY = 9.80665
MOLAR_MASS, GAS_CONSTANT = 0.0289644, 8.31432
"""Molar mass of dry air [kg/mol], and the gas constant [J/(mol K)], as that standard has them"""
LOWEST, HIGHEST = -5000.0, 80000.0
"""Altitudes between which it is used [m]"""
LAYERS = (
    (0.0, 0.0065),
    (11000.0, 0.0),
    (20000.0, -0.001),
    (32000.0, -0.0028),
    (47000.0, 0.0),
    (51000.0, 0.0028),
    (71000.0, 0.002),
)
"""Geopotential heights at which layers begin [m], and their lapse rates [K/m]; the first goes on below"""


def standard_air(altitude: float) -> dict[str, float]:
    """Return `pressure` [Pa], `temperature` [K] and `lapse` rate [K/m] at an altitude above sea [m]."""
    shrinks = EARTH_RADIUS / (EARTH_RADIUS + altitude)
    height = altitude * shrinks  # geopotential: with the work against gravity that falls
    pressure, temperature = 101325.0, 288.15
    for number, (begin, lapse) in enumerate(LAYERS):
        top = LAYERS[number + 1][0] if number + 1 < len(LAYERS) else math.inf
        rise = min(height, top) - begin
        warmer = temperature - lapse * rise
        by_weight = STANDARD_GRAVITY * MOLAR_MASS / GAS_CONSTANT
        if lapse:
            pressure *= (warmer / temperature) ** (by_weight / lapse)
        else:
            pressure *= math.exp(-by_weight * rise / temperature)
        temperature = warmer
        if height <= top:
            return {"pressure": pressure, "temperature": temperature, "lapse": lapse * shrinks**2}
    raise AssertionError(altitude)


LATEX: Mapping[str, Any] = {
    "kind": "mooney_rivlin",
    "shear_modulus": 3.3e5,
    "mooney_ratio": 0.1,
    "thickness": 2.0e-4,
    "density": 940.0,
}
FILM_STRETCH = 1.1
"""Largest stretch of a film without tearing"""
STRAIN_BOUND = 0.003
"""Mean strain at the largest planned pressure that film may have instead of its own, see FOIL.md"""
PRESETS: Mapping[str, Mapping[str, Any]] = {
    "latex": LATEX,
    "latex_thick": {**LATEX, "thickness": 5.0e-4},
    "natural_rubber_treloar": {
        "kind": "ogden",
        "ogden_moduli": (6.3e5, 1.2e3, -1.0e4),
        "ogden_exponents": (1.3, 5.0, -2.0),
        "thickness": 2.0e-4,
        "density": 910.0,
    },
    "foil": {
        "kind": "neo_hookean",
        "shear_modulus": 1.5e9,
        "thickness": 1.2e-5,
        "density": 1390.0,
        "most_stretch": FILM_STRETCH,
        "strain_bound": STRAIN_BOUND,
    },
    "nylon": {
        "kind": "neo_hookean",
        "shear_modulus": 8.0e8,
        "thickness": 1.5e-5,
        "density": 1150.0,
        "most_stretch": FILM_STRETCH,
        "strain_bound": STRAIN_BOUND,
    },
}
"""Materials that are known, with the sources of values, and the estimates.

- latex: Mueller and Strehlow 2004, Rubber and Rubber Balloons, for a toy balloon: 2 C1 = 3 bar, 2 C2 = 0.3 bar. Skin
  and density are estimates, usual ones of toy balloons and of vulcanized rubber; the skin of latex_thick is one of
  large balloons.
- natural_rubber_treloar: Ogden 1972, Large Deformation Isotropic Elasticity, fitted to Treloar's measurements of 1944,
  in Pa as texts have it since. The skin is an estimate, and the density that of natural rubber with nothing in it (906
  to 930 in books); Treloar's had sulfur.
- foil: polyester film of 12 um. Density by DuPont's sheet H-37232-3; Young's modulus, 4.5 GPa, is an estimate between
  the 4.8 to 5.0 GPa there, of 23 um, and the 3.8 GPa of the sheet of Mylar LBT, of 12 um.
- nylon: film of 15 um; 2.4 GPa and the density are estimates, for data sheets differ with moisture.

The shear modulus of an incompressible film is a third of Young's modulus. Polyester's Poisson's ratio is 0.38 (the same
sheet), so that stretched both ways alike it has E / (1 - 0.38), and here 2 E, a quarter more. The metal and the layer
that seals are left out; with them sellers of balloons give 20 to 50 um.
"""


def pins_of(given: Any) -> Any:
    """Make a list of a single name, and numbers of a mask; other values stay as they are."""
    if isinstance(given, str):
        return [given]
    is_mask = isinstance(given, list) and bool(given) and all(isinstance(pin, bool) for pin in given)
    return np.flatnonzero(given).tolist() if is_mask else given


def pinned_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[int]:
    """Find the points of a mesh that a rule holds for, by their numbers.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not say yes or no of each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype != bool:
        raise InputError(
            f"the function must return a boolean for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return np.flatnonzero(said).tolist()


def weighed_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[float]:
    """Ask a rule about each point of a mesh.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not give a number for each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype.kind not in "biuf":
        raise InputError(
            f"the function must return a number for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return said.astype(float).tolist()
