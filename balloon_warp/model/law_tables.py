"""The tables `law.NAME` of a scene and of its balloons: what they say of the parameters of laws of one's own."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.scene import Scene


def require_law_tables(scene: Scene, rows: Sequence[Parameter]) -> None:
    """Make sure that these tables have nothing but parameters of laws, within their bounds.

    Raises:
        InputError: names the path and what was expected.
    """
    _require_fit("law", scene.law, [row for row in rows if row.of == "world"])
    for number, balloon in enumerate(scene.balloon):
        _require_fit(f"balloon.{number}.law", balloon.law, [row for row in rows if row.of == "balloon"])


def _require_fit(path: str, tables: dict[str, dict[str, Any]], rows: Sequence[Parameter]) -> None:
    fields: dict[str, dict[str, Parameter]] = {}
    for row in rows:
        if row.path.startswith("law."):
            _, law, field = row.path.split(".")
            fields.setdefault(law, {})[field] = row
    for law, values in tables.items():
        if law not in fields:
            known = f"known here are {', '.join(fields)}" if fields else "no law was given that has any here"
            raise InputError(f"{path}.{law}: there are no parameters of such a law; {known}")
        for field, value in values.items():
            if field not in fields[law]:
                raise InputError(f"{path}.{law}.{field}: unknown field; known here are {', '.join(fields[law])}")
            _require_value(f"{path}.{law}.{field}", value, fields[law][field])


def _require_value(path: str, value: Any, row: Parameter) -> None:
    if np.size(value) != row.size:
        expected = "a number" if row.size == 1 else f"{row.size} numbers"
        raise InputError(f"{path}: must be {expected} (got {value})")
    if np.min(value) < row.least:
        raise InputError(f"{path}: must be at least {row.least:g} (got {value})")
    if np.max(value) > row.most:
        raise InputError(f"{path}: must be at most {row.most:g} (got {value})")
