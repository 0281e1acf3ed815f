"""From a bundled name, a TOML file or a mesh file to a checked scene."""

import copy
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from balloon_warp.errors import InputError
from balloon_warp.scene.around import scene_table_around
from balloon_warp.scene.complaint import complaint
from balloon_warp.scene.overrides import Override, apply_overrides
from balloon_warp.scene.schema import Scene

LARGEST_FILE = 1 << 24
"""bytes of a scene file"""


def bundled_scenes() -> dict[str, Path]:
    """Names of the bundled scenes, and their files."""
    folder = Path(str(resources.files("balloon_warp.scenes")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def scene_name(source: str | Path) -> str:
    """What outputs of this scene are called: the bundled name, or the file's name without its suffix."""
    return Path(source).stem


def find_mesh(name: str, source: str | Path) -> Path:
    """A mesh file that a command names: in the current folder, or beside the scene's file."""
    path = Path(name)
    return path if path.exists() else bundled_scenes().get(str(source), Path(source)).parent / path


def load_scene(source: str | Path, overrides: Mapping[str, Any] | Iterable[Override] = ()) -> Scene:
    """Load a scene.

    Args:
        source: a bundled scene's name, a scene file (.toml), or a mesh file, which gets a scene around it.
        overrides: dotted paths and values, as a mapping or as pairs, applied in order before the scene is checked.

    Raises:
        InputError: there is no such scene, the file is not valid TOML, or a field is wrong.
    """
    bundled = bundled_scenes()
    path = bundled.get(str(source), Path(source))
    if path.suffix.lower() != ".toml" and not path.exists():
        raise InputError(
            f"{source}: no such scene or file; bundled scenes are {', '.join(bundled)}; or give a .toml scene or a mesh"
        )
    given = cast("Iterable[Override]", overrides.items() if isinstance(overrides, Mapping) else overrides)
    pairs = [(place, _mesh_beside(value) if place.endswith("mesh") else value) for place, value in given]
    if path.suffix.lower() == ".toml":
        table = _read_toml(path)
    else:
        bare: dict[str, Any] = {"balloon": [{"mesh": path.resolve()}]}
        placed = _overridden(bare, pairs, path)
        asked = (getattr(placed, name) if name in bare else None for name in ("up_axis", "gravity"))
        table = scene_table_around(path, placed.balloon[0], *asked)
    return _overridden(table, pairs, path)


def _overridden(table: dict[str, Any], overrides: Sequence[Override], path: Path) -> Scene:
    """The scene of a table with values put at some paths, in place.

    Raises:
        InputError: names the option whose value spoils a table that is right without it, else the file.
    """
    before = copy.deepcopy(table)
    apply_overrides(table, overrides)
    try:
        return check_scene(table, path)
    except InputError:
        for place, value in overrides:
            if _complaint(before):
                break
            apply_overrides(before, [(place, value)])
            if mistake := _complaint(before):
                raise InputError(f"--set {place}: {mistake}") from None
        raise


def _complaint(table: dict[str, Any]) -> str | None:
    try:
        Scene.model_validate(table)
    except ValidationError as error:
        return complaint(error, Scene)
    return None


def _mesh_beside(value: Any) -> Any:
    """A mesh that an override names is sought in the current folder first, then beside the scene's file."""
    return Path(value).resolve() if isinstance(value, str) and Path(value).is_file() else value


def check_scene(table: dict[str, Any], path: Path) -> Scene:
    """Validate a scene's table; mesh files are sought beside `path`.

    Raises:
        InputError: names the file and the first field that is wrong.
    """
    try:
        scene = Scene.model_validate(table)
    except ValidationError as error:
        raise InputError(f"{path}: {complaint(error, Scene)}") from None
    balloons = [
        balloon.model_copy(update={"mesh": path.parent / balloon.mesh}) if isinstance(balloon.mesh, Path) else balloon
        for balloon in scene.balloon
    ]
    return scene.model_copy(update={"balloon": balloons})


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        if path.exists() and not path.is_file():  # reading a pipe would wait forever
            raise InputError(f"{path}: is not a regular file")
        if path.exists() and path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: is {path.stat().st_size:,} bytes large; expected at most {LARGEST_FILE:,}")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a scene file: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply for a scene file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML: {error}") from None
