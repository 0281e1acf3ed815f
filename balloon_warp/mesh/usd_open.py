"""Opening of USD stages, for all that read any."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pxr import Tf, Usd, UsdUtils

from balloon_warp.errors import InputError
from balloon_warp.files import file_behind, legible
from balloon_warp.mesh.usd_limits import Limits
from balloon_warp.mesh.usd_shapes import as_meshes

MOST_NAMED = 5
"""Largest number of things that a sentence names"""


class Opened(NamedTuple):
    """An open stage."""

    stage: Usd.Stage
    warnings: tuple[str, ...]
    """Sentences on USD's errors, such as missing files, and on instances that could not be taken"""


def open_stage(path: Path | str) -> Usd.Stage:
    """Return the stage of a file, as it is.

    Raises:
        InputError: it is none, or asks for too much.
    """
    if legible(str(path)) != str(path):
        raise InputError(f"{legible(str(path))}: the name is not UTF-8, which USD requires; expected another name")
    _quiet = UsdUtils.CoalescingDiagnosticDelegate()  # while it lives, USD prints nothing
    behind = file_behind(Path(path))
    limits = Limits(behind)
    try:
        stage = Usd.Stage.Open(str(behind))
    except Tf.ErrorException as error:
        raise InputError(f"{path}: cannot be read as a USD stage; expected one, such as `run` writes") from error
    del limits  # which kept the layers until USD had them
    return stage


def open_meshes(path: Path | str, *, rounds: bool = True) -> Opened:
    """Return the stage of a file in which shapes are meshes and instances are prims, as `as_meshes` makes them.

    Raises:
        InputError: it is none, or has too many instances.
    """
    stage = open_stage(path)
    untyped: Any = stage  # USD's types lack the method
    errors: list[object] = untyped.GetCompositionErrors()
    missing = _first([str(error).partition("\n")[0] for error in errors])
    _quiet = UsdUtils.CoalescingDiagnosticDelegate()
    return Opened(stage, (*missing, *as_meshes(stage, str(path), rounds=rounds)))


def _first(errors: list[str]) -> list[str]:
    """Return the first errors of a stage, as USD says them, a sentence each, and how many more there are."""
    more = [f"USD: {len(errors) - MOST_NAMED} more such errors."] if len(errors) > MOST_NAMED else []
    return [*(f"USD: {each}" for each in errors[:MOST_NAMED]), *more]


def listed(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
