"""Change of a scene's inflation or material to another kind, without the fields of the old kind."""

from collections.abc import Iterable
from typing import Any

from balloon_warp.scene.schema.balloon import FIELDS_OF_KINDS, material_named

KIND_OF_FIELD = {field: kind for kind, fields in FIELDS_OF_KINDS.items() for field in fields}


def drop_other_kinds(table: dict[str, Any], overrides: Iterable[tuple[str, Any]]) -> None:
    """Make room, in place, for the kinds of inflation that overrides ask for.

    They ask by `balloon.inflation.kind`; or, where neither they nor the table name a kind, by a field that one kind
    alone has. Fields of other kinds are dropped from the table; overrides come later, and stay.

    Args:
        table: a scene's, before anything is put into it.
        overrides: dotted paths and values.
    """
    pairs = list(overrides)
    balloons = table.get("balloon")
    for number, balloon in enumerate(balloons if isinstance(balloons, list) else []):
        inflation = balloon.get("inflation") if isinstance(balloon, dict) else None
        if not isinstance(inflation, dict):
            continue
        fields = _set_fields(number, pairs)
        if "stretch" in fields and "pressure" not in fields:
            inflation.pop("pressure", None)  # which would count instead
        if kind := _asked_kind(fields, named="kind" in inflation):
            for field in KIND_OF_FIELD:
                if KIND_OF_FIELD[field] != kind:
                    inflation.pop(field, None)
            inflation["kind"] = kind


def drop_masses(table: dict[str, Any], overrides: Iterable[tuple[str, Any]]) -> None:
    """Leave out, in place, the masses of balloons that overrides make of rubber or film, whose own follow from that."""
    pairs = list(overrides)
    balloons = table.get("balloon")
    for number, balloon in enumerate(balloons if isinstance(balloons, list) else []):
        material = _set_fields(number, pairs, "material")
        if isinstance(balloon, dict) and ("preset" in material or material.get("kind", "springs") != "springs"):
            balloon.pop("mass", None)


def _set_fields(number: int, overrides: Iterable[tuple[str, Any]], field: str = "inflation") -> dict[str, Any]:
    """Find the values that overrides set in the inflation, or another field, of a balloon; a name is a material's."""
    fields: dict[str, Any] = {}
    for path, value in overrides:
        for whole in (f"balloon.{field}", f"balloon.{number}.{field}"):
            if path == whole:
                table = material_named(value) if isinstance(value, str) else value
                fields = dict(table) if isinstance(table, dict) else {}
            elif path.startswith(f"{whole}."):
                fields[path.removeprefix(f"{whole}.").split(".")[0]] = value
    return fields


def _asked_kind(fields: dict[str, Any], named: bool) -> str | None:
    """Find the kind that the fields set ask for; none where they ask for none, or for several.

    Args:
        named: whether the table names a kind already.
    """
    if "kind" in fields:
        return next((kind for kind in FIELDS_OF_KINDS if kind == fields["kind"]), None)
    kinds = {KIND_OF_FIELD[field] for field in fields if field in KIND_OF_FIELD}
    return kinds.pop() if len(kinds) == 1 and not named else None
