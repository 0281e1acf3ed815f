"""The tables `law.NAME` of a scene, its balloons and spheres: the values of parameters that stand there."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.scene import Scene

HOLDERS = ("balloon", "sphere")
"""Tables of a scene that have tables of laws and phases"""
Tables = dict[str, dict[str, Any]]
Rows = Mapping[str, Mapping[str, Parameter]]
"""Rows of parameters, by their laws' names and their own"""


def with_law_tables(scene: Scene, rows: Sequence[Parameter]) -> Scene:
    """Return the scene with these tables made sure of, and filled with the defaults of missing values.

    Raises:
        InputError: names the path and the expected value.
    """
    fields = {of: _by_law(row for row in rows if row.of == of) for of in ("world", *HOLDERS)}
    law = _filled("law", scene.law, fields["world"])
    filled = {
        of: [
            each.model_copy(update={"law": _filled(f"{of}.{number}.law", each.law, fields[of])})
            for number, each in enumerate(getattr(scene, of))
        ]
        for of in HOLDERS
    }
    return scene.model_copy(update={"law": law, **filled}) if any(fields.values()) else scene


def _by_law(rows: Iterable[Parameter]) -> Rows:
    fields: dict[str, dict[str, Parameter]] = {}
    for row in rows:
        if row.path.startswith("law."):
            _, law, field = row.path.split(".")
            fields.setdefault(law, {})[field] = row
    return fields


def _filled(path: str, tables: Tables, rows: Rows) -> Tables:
    for law, values in tables.items():
        if law not in rows:
            known = f"known here are {', '.join(rows)}" if rows else "no given law has parameters here"
            raise InputError(f"{path}.{law}: unknown law; {known}")
        for field, value in values.items():
            if field not in rows[law]:
                raise InputError(f"{path}.{law}.{field}: unknown field; known here are {', '.join(rows[law])}")
            _require_value(f"{path}.{law}.{field}", value, rows[law][field])
    defaults = {law: {field: _default(row) for field, row in fields.items()} for law, fields in rows.items()}
    return {law: {**fields, **tables.get(law, {})} for law, fields in defaults.items()}


def _default(row: Parameter) -> Any:
    return row.default if row.size == 1 else (row.default,) * row.size


def _require_value(path: str, value: Any, row: Parameter) -> None:
    if np.size(value) != row.size:
        expected = "a number" if row.size == 1 else f"{row.size} numbers"
        raise InputError(f"{path}: must be {expected} (got {value})")
    if np.min(value) < row.least:
        raise InputError(f"{path}: must be at least {row.least:g} (got {value})")
    if np.max(value) > row.most:
        raise InputError(f"{path}: must be at most {row.most:g} (got {value})")
