"""Tables within tables of the schema."""

import typing
from typing import Any

from pydantic import BaseModel


def table_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table that a field of this type has, or has a list of, if any."""
    if isinstance(annotation, type) and not typing.get_args(annotation):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((found for part in typing.get_args(annotation) if (found := table_in(part))), None)
