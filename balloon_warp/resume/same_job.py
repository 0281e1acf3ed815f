"""Comparison of a job that was begun with the one that is asked for."""

import json
from collections.abc import Iterator, Mapping
from typing import Any


def as_json(job: Mapping[str, Any]) -> dict[str, Any]:
    """Return a job as it is when it was written and read again."""
    return json.loads(json.dumps(job))


def differences(there: Any, here: Any, path: str = "") -> Iterator[str]:
    """Iterate over the differences of two jobs, each as a phrase."""
    if isinstance(there, dict) and isinstance(here, dict):
        for name in sorted(there.keys() | here.keys()):
            below = f"{path}.{name}" if path else name
            if name not in there or name not in here:
                yield f"{below} is {'here' if name in here else 'there'} only"
            else:
                yield from differences(there[name], here[name], below)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for number, pair in enumerate(zip(there, here, strict=True)):
            yield from differences(*pair, f"{path}.{number}")
    elif there != here:
        yield f"{path} is {_shown(there)} there and {_shown(here)} here"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
