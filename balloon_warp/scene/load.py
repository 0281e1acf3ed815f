"""Scene files: loading, overrides of values by dotted path, and writing.

A scene over time has the times of its spheres and strings, and its changes.
"""

import copy
import os
import shutil
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import ceil
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError, did_you_mean_file
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import LOADERS, MeshLike, is_mesh, load_mesh
from balloon_warp.scene.around import scene_table_around
from balloon_warp.scene.balloon import FIELDS_OF_KINDS, Balloon, material_named
from balloon_warp.scene.fields import PRESETS, complaint, first_line, meaning_of, toml_value
from balloon_warp.scene.reference import default_of
from balloon_warp.scene.scene import MESHED, WITHOUT_MESHES, Body, Obstacle, Scene, Sphere, String
from balloon_warp.system.api import checked
from balloon_warp.system.files import (
    check_writable,
    file_behind,
    legible,
    marked_scene,
    regular_content,
    replaces_any,
    require_ours,
    whole_file,
    whole_path,
)

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


Override = tuple[str, Any]
"""Dotted path, and the value to set there"""
LISTED = ("balloon", "sphere", "string", "obstacle", "body", "tube", "force")
"""Tables that form lists, of which a path may give an index"""


class OverrideError(InputError):
    """An override is at fault.

    Args:
        mistake: the sentence.
        number: which override, counted from 0.
    """

    def __init__(self, mistake: str, number: int):
        super().__init__(mistake)
        self.number = number


def parse_override(text: str) -> Override:
    """Split `PATH=VALUE`; the value is read as TOML, and as plain text where it is no TOML value.

    Raises:
        InputError: there is no `=` or no path.
    """
    path, equals, value = text.partition("=")
    path = path.strip()
    if not equals or not all(path.split(".")):
        raise InputError(f"--set {text}: expected PATH=VALUE, as in --set balloon.inflation.k_normal=3")
    return path, parse_value(value)


def parse_value(text: str) -> Any:
    """Read a value as TOML has it, or as plain text where it is no TOML value."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # also thousands of digits, or brackets
        return text.strip()


def apply_overrides(table: dict[str, Any], overrides: Iterable[Override]) -> None:
    """Set each value at its path in the scene's table, in place.

    A list without a number in the path means all of it.

    Where the kind of an inflation is set, the table's fields of other kinds go; set values stay, in any order.

    Raises:
        OverrideError: a path leads through a value that has no fields, or past the end of a list.
    """
    pairs = list(overrides)
    drop_other_kinds(table, pairs)
    drop_masses(table, pairs)
    for number, (path, value) in enumerate(pairs):
        try:
            _put(table, path.split("."), value, path)
        except InputError as mistake:
            raise OverrideError(str(mistake), number) from None


def _put(place: Any, names: list[str], value: Any, path: str) -> None:
    name, rest = names[0], names[1:]
    if isinstance(place, list):
        listed = ".".join(path.split(".")[: -len(names)])
        if not place:
            raise InputError(f"{path}: cannot be set, the scene has no {listed}")
        if not name.isdecimal():
            for item in place:
                _put(item, names, value, path)
            return
        if int(name) >= len(place):
            raise InputError(f"{path}: no {listed} {name}, the scene has {len(place)}, counted from 0")
        if rest:
            _put(place[int(name)], rest, value, path)
        else:
            place[int(name)] = value
    elif isinstance(place, dict):
        if rest:
            listed = len(names) == path.count(".") + 1 and name in LISTED
            if place.get(name) is False:
                del place[name]  # "touch = false": a field of it asks for the table
            _put(place.setdefault(name, [] if listed else _of_preset(place, name)), rest, value, path)
        else:
            place[name] = value
    else:
        raise InputError(f"{path}: cannot be set, since a plain value has no field {name!r}")


def _of_preset(table: dict[str, Any], name: str) -> Any:
    """Read the numbers that a material's preset has under a name, to change one; or make a table of its own."""
    numbers = PRESETS.get(str(table.get("preset")), {}).get(name)
    return list(numbers) if isinstance(numbers, tuple) else {}


def override_scene(scene: Scene, overrides: Iterable[Override], other_kinds: bool = False) -> Scene:
    """Return a scene with other values at some paths. A mesh file is taken as given, not sought beside a scene file.

    Args:
        other_kinds: whether a field of another kind of inflation asks for that kind, where the scene names none, as in
            a scene file; a running scene keeps its own.

    Raises:
        InputError: names the path or field that is wrong.
    """
    table = scene.model_dump(mode="json", exclude_none=True, exclude=WITHOUT_MESHES)
    for name in MESHED:
        for plain, meshed in zip(table[name], getattr(scene, name), strict=True):
            if meshed.mesh is not None:
                plain["mesh"] = meshed.mesh
    for plain, balloon in zip(table["balloon"], scene.balloon, strict=True):
        if other_kinds and not balloon.inflation.names_its_kind:
            plain["inflation"] = {k: v for k, v in plain["inflation"].items() if k in balloon.inflation.own_fields}
    table["atmosphere"] = {k: v for k, v in table["atmosphere"].items() if k not in scene.atmosphere.following}
    apply_overrides(table, overrides)
    try:
        return Scene.model_validate(table)
    except ValidationError as error:
        raise InputError(complaint(error, Scene)) from None


SceneLike = TypeAliasType("SceneLike", Scene | str | Path | MeshLike)
"""Scene, or an argument of `load_scene`: a bundled scene's name, a scene file, or a mesh (file or not)"""
Meshed = TypeVar("Meshed", Balloon, Obstacle, Body)
FILES = ("mesh", "print", "springs", "material.rest_mesh")
"""Fields of a balloon that name files; other tables have some of them"""
LARGEST_FILE = 1 << 24
"""Largest size of a scene file [bytes]"""


def bundled_scenes() -> dict[str, Path]:
    """Return the names of the bundled scenes, and their files."""
    package = Path(__file__).parents[1]
    inside, beside = package / "scenes", package.parent / "scenes"  # installed, and in a source tree
    folder = inside if inside.is_dir() else beside
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def scene_name(source: str | Path) -> str:
    """Return the name of this scene's outputs: the bundled name, or the file's name without its suffix."""
    return legible(Path(source).stem)


def find_mesh(name: str, source: str | Path) -> Path:
    """Find a mesh file that a command names: in the current folder, or beside the scene's file."""
    path = Path(name)
    return path if path.exists() else bundled_scenes().get(str(source), Path(source)).parent / path


def scene_of(source: SceneLike) -> Scene:
    """Return a scene itself, and load anything else by `load_scene`."""
    return source if isinstance(source, Scene) else load_scene(source)


@checked
def load_scene(source: SceneLike, overrides: Mapping[str, Any] | Iterable[Override] = ()) -> Scene:
    """Load a scene.

    Args:
        source: a bundled scene's name, a scene file (.toml), or a mesh: a file, a trimesh.Trimesh, or points and faces.
            A mesh gets a scene around it. A Scene is copied.
        overrides: Dotted paths and values, as a mapping or as pairs, applied in order before the scene is checked.

    Raises:
        InputError: there is no such scene, the file is not valid TOML, or a field is wrong.
        OverrideError: the same, by an override.
    """
    if not isinstance(source, str | Path):
        return _from_python(source, pairs_of(overrides))
    bundled = bundled_scenes()
    path = bundled.get(str(source), Path(source))
    if not os.path.exists(path):  # no error either where no file can have such a name
        hint = did_you_mean_file(path, (".toml", *LOADERS), bundled)
        if not hint and path.suffix:
            raise InputError(f"{source}: no such file" + (f" in {Path.cwd()}" if not path.is_absolute() else ""))
        names = f"; bundled scenes are {', '.join(bundled)}; or give a .toml scene or a mesh"
        raise InputError(f"{source}: no such scene or file{hint or names}")
    pairs = pairs_of(overrides)
    if path.suffix.lower() == ".toml":
        return _overridden(_read_toml(path), pairs, path)
    return _around(path, pairs, path)


def mesh_balloon(path: Path, overrides: Sequence[Override] = ()) -> Balloon:
    """Make a balloon of a mesh by itself, with values changed at paths of the scene that it gets; its mesh is not read.

    Raises:
        InputError: names the path or field that is wrong.
    """
    return _bare_scene(path, overrides, path).balloon[0]


def _from_python(source: Scene | MeshLike, overrides: Sequence[Override]) -> Scene:
    """Make a scene of a Python object: a scene, with its overrides made, or a mesh, with a scene around it.

    Raises:
        InputError: it is neither, or as `load_scene`.
    """
    if isinstance(source, Scene):
        return override_scene(source, overrides, other_kinds=True)
    if not is_mesh(source):
        kinds = "a Scene, the name of a bundled scene, a file, or a mesh"
        raise InputError(f"scene: must be {kinds} (got {type(source).__name__})")
    mesh = load_mesh(source)
    return _around(mesh, overrides, Path(mesh.name))


def pairs_of(overrides: Mapping[str, Any] | Iterable[Override]) -> list[Override]:
    """Return the paths and values as pairs.

    Raises:
        InputError: they are none.
    """
    given = cast("Iterable[Override]", overrides.items() if isinstance(overrides, Mapping) else overrides)
    try:
        return [(place, _mesh_beside(value) if place.endswith(FILES) else value) for place, value in given]
    except (TypeError, ValueError, AttributeError):
        raise InputError(
            f'overrides: must be dotted paths and values, as in {{"balloon.mass": 2.0}} (got {str(overrides)[:60]})'
        ) from None


def _around(mesh: Path | PolygonMesh, overrides: Sequence[Override], path: Path) -> Scene:
    """Make the scene around a mesh, which complaints call `path`."""
    bare = _bare_scene(mesh, overrides, path)
    asked = (getattr(bare, name) if name in bare.model_fields_set else None for name in ("up_axis", "gravity"))
    return _overridden(scene_table_around(mesh, bare.balloon[0], *asked), overrides, path)


def _bare_scene(mesh: Path | PolygonMesh, overrides: Sequence[Override], path: Path) -> Scene:
    bare: dict[str, Any] = {"balloon": [{"mesh": whole_path(mesh) if isinstance(mesh, Path) else mesh}]}
    return _overridden(bare, overrides, path)


def _overridden(table: dict[str, Any], overrides: Sequence[Override], path: Path) -> Scene:
    """Make the scene of a table with values put at some paths, in place.

    Raises:
        OverrideError: which override spoils a table that is right without it.
        InputError: names the file.
    """
    if any(callable(value) for _, value in overrides):  # which is told of the points of a mesh
        for balloon in table["balloon"]:
            if isinstance(balloon, dict) and isinstance(balloon.get("mesh"), str):
                balloon["mesh"] = whole_path(path.parent / balloon["mesh"])
    before = copy.deepcopy(table)
    apply_overrides(table, overrides)
    try:
        return check_scene(table, path)
    except InputError:
        if _complaint(before):
            raise
        raise _culprit(before, overrides) from None


def _culprit(table: dict[str, Any], overrides: Sequence[Override]) -> OverrideError:
    """Find the override at fault: the last without which all is well, or the first that spoils those before it."""
    numbers = range(len(overrides))
    for number in reversed(numbers):
        if not _complaint(table, [*overrides[:number], *overrides[number + 1 :]]):
            return OverrideError(_complaint(table, overrides) or "", number)
    complaints = (_complaint(table, overrides[: number + 1]) for number in numbers)
    return next(OverrideError(mistake, number) for number, mistake in enumerate(complaints) if mistake)


def _complaint(table: dict[str, Any], overrides: Sequence[Override] = ()) -> str | None:
    """Return the error of a table once values are set at some paths; None if it is valid."""
    overridden = copy.deepcopy(table)
    try:
        apply_overrides(overridden, overrides)
        Scene.model_validate(overridden)
    except ValidationError as error:
        return complaint(error, Scene)
    except InputError as mistake:
        return str(mistake)
    return None


def _mesh_beside(value: Any) -> Any:
    """Seek a file that an override names in the current folder first, then beside the scene's file."""
    return whole_path(Path(value)) if isinstance(value, str) and Path(value).is_file() else value


def check_scene(table: dict[str, Any], path: Path) -> Scene:
    """Validate a scene's table; mesh files are sought beside `path`.

    Raises:
        InputError: names the file and the first field that is wrong.
    """
    try:
        scene = Scene.model_validate(table)
    except ValidationError as error:
        raise InputError(f"{path}: {complaint(error, Scene)}") from None
    return scene.model_copy(
        update={
            "balloon": [_beside(balloon, path) for balloon in scene.balloon],
            "obstacle": [_beside(obstacle, path) for obstacle in scene.obstacle],
            "body": [_beside(body, path) for body in scene.body],
        }
    )


def _beside(meshed: Meshed, path: Path) -> Meshed:
    """Name a balloon's, obstacle's or body's files from where the scene's file is."""
    return with_files(meshed, {name: _found(file, path) for name, file in files_of(meshed).items()})


def files_of(meshed: Balloon | Obstacle | Body) -> dict[str, Path]:
    """Find the files that it names, by the paths of the fields that do."""
    found = {}
    for name in FILES:
        table, _, field = name.rpartition(".")
        file = getattr(getattr(meshed, table, None) if table else meshed, field, None)
        if isinstance(file, Path):
            found[name] = file
    return found


def files_of_scene(scene: Scene) -> dict[Path, str]:
    """Return the files that a scene names, each with its role, as "the scene's mesh"."""
    tables = [each for name in MESHED for each in getattr(scene, name)]
    named = [(path, file) for each in tables for path, file in files_of(each).items()]
    return {file: f"the scene's {path.rpartition('.')[2]}" for path, file in named}


def with_files(meshed: Meshed, files: Mapping[str, Path]) -> Meshed:
    """Return the same that names other files."""
    update: dict[str, Any] = {name: file for name, file in files.items() if "." not in name}
    for name, file in files.items():
        table, _, field = name.rpartition(".")
        if table:
            update[table] = getattr(meshed, table).model_copy(update={field: file})
    return meshed.model_copy(update=update)


def _found(file: Path, path: Path) -> Path:
    """Return the path of a file that a scene file names: beside it, or, if it is a link, beside its target."""
    places = [path.parent / file, file_behind(path).parent / file]
    return next((place for place in places if place.exists()), places[0])


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(
            regular_content(path, LARGEST_FILE).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        )
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read as a scene file: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply for a scene file") from None
    except tomllib.TOMLDecodeError as error:
        hint = "; text needs quotes" if "Invalid value" in str(error) else ""
        raise InputError(f"{path}: is not valid TOML: {error}{hint}") from None
    except InputError:
        raise
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{path}: is not valid TOML: {_without_advice(error)}") from None


def _without_advice(error: ValueError) -> str:
    """Return the error, without advice on changing Python."""
    return str(error).partition(";")[0]


def frame_at(scene: Scene, seconds: float) -> int:
    """Find the first frame that is not before a time; times that rounding puts a little after a frame belong to it."""
    return ceil(seconds * scene.frames_per_second - 1e-6)


def is_there(scene: Scene, lasting: Sphere | String, frame: int) -> bool:
    """Return whether a sphere or string of the scene has appeared by a frame, and has not ended."""
    ended = lasting.end is not None and frame >= frame_at(scene, lasting.end)
    return frame >= frame_at(scene, lasting.start) and not ended


def scenes_over_time(scene: Scene) -> Iterator[tuple[int, Scene]]:
    """Find the frames at which something changes, appears or ends, in order, and the scene from then on.

    Raises:
        InputError: names the change, and the path or field that is wrong.
    """
    changes = [(frame_at(scene, change.time), number) for number, change in enumerate(scene.change)]
    frames = {frame for frame, _ in changes}
    for lasting in (*scene.sphere, *scene.string):
        frames |= {frame_at(scene, time) for time in (lasting.start, lasting.end) if time}
    now = scene.model_copy(update={"change": []})
    for frame in sorted(frames):
        for number in [number for at, number in changes if at == frame]:
            try:
                now = override_scene(now, scene.change[number].set.items())
            except InputError as mistake:
                raise InputError(f"change.{number}.set: {mistake}") from None
        yield frame, now


HEADER = """\
# A scene: balloon-warp run THIS_FILE simulates it. SI units. A field that is left out has its default.
# python -m balloon_warp.scene.reference lists every field.
"""
LONGEST_COMMENT = 100
"""Largest number of characters of a comment beside a value; a longer one stands above it"""


def write_scene(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as a file that runs wherever it is taken with the files beside it; return the files written.

    Meshes and prints of bundled scenes are copied beside it. Others are named from where it is.

    Raises:
        InputError: a file cannot be written, a scene is there that somebody edited, or another mesh is where one is to
            be copied to.
    """
    check_writable(path, (".toml",))
    require_ours(path)
    files = dict.fromkeys(Path(os.path.abspath(file)) for file in files_of_scene(scene))
    copies = {mesh: path.parent / mesh.name for mesh in files if _is_bundled(mesh)}
    missing = {mesh: target for mesh, target in copies.items() if not _is_copied(mesh, target)}
    moved = {
        name: [
            with_files(each, {field: copies.get(file, file) for field, file in _files_of(each).items()})
            for each in getattr(scene, name)
        ]
        for name in MESHED
    }
    for mesh, target in missing.items():
        with whole_file(target) as temporary:
            shutil.copyfile(mesh, temporary)
    with whole_file(path) as temporary:
        text = scene_toml(scene.model_copy(update=moved), path.parent)
        temporary.write_text(marked_scene(text), encoding="utf-8")
    return [path, *missing.values()]


def scene_toml(scene: Scene, folder: Path) -> str:
    """Write the scene as a TOML file in `folder` would say it, with each field's meaning, but without defaults.

    Mesh files are named from the folder, those of bundled scenes by their whole path. Every number has all its digits.
    """
    table = scene.model_dump(mode="json", exclude_defaults=True, exclude=WITHOUT_MESHES)
    if "atmosphere" in table:
        table["atmosphere"] = {k: v for k, v in table["atmosphere"].items() if k not in scene.atmosphere.following}
    for name in MESHED:
        for number, each in enumerate(getattr(scene, name)):
            files = {field: _named_from(file, folder) for field, file in _files_of(each).items()}
            table[name][number] = _with_files_named(table[name][number], files)
    return HEADER + "\n".join(_lines(scene, table)) + "\n"


def _with_files_named(table: dict[str, Any], files: dict[str, str]) -> dict[str, Any]:
    """Return the table with its files, and those of nested tables, first."""
    own = {field: file for field, file in files.items() if "." not in field}
    table = own | {field: value for field, value in table.items() if field not in own}
    for path in files.keys() - own.keys():
        within, _, field = path.partition(".")
        table[within] = {field: files[path]} | {k: v for k, v in table[within].items() if k != field}
    return table


def _files_of(meshed: Balloon | Body | Obstacle) -> dict[str, Path]:
    """Return the files of a table's mesh and print, by the fields that name them."""
    named = {"mesh": meshed.mesh} | files_of(meshed)
    return {field: Path(os.path.abspath(str(file))) for field, file in named.items() if file is not None}


def _is_bundled(mesh: Path) -> bool:
    return mesh.parent in {scene.parent for scene in bundled_scenes().values()}


def _is_copied(mesh: Path, copy: Path) -> bool:
    """Return whether a copy exists already.

    Raises:
        InputError: something else is.
    """
    if not os.path.lexists(copy):
        return False
    if copy.is_file() and copy.read_bytes() == mesh.read_bytes():
        return True
    if replaces_any():
        return False
    raise InputError(
        f"{copy}: already exists and differs from the scene's file of that name; expected another folder, or --force"
    )


def _named_from(mesh: Path, folder: Path) -> str:
    """Name a mesh as a file in a folder does, so that both can be moved together."""
    if not _is_bundled(mesh) or mesh.parent == Path(os.path.abspath(folder)):
        with suppress(ValueError):  # another drive
            return Path(os.path.relpath(os.path.realpath(mesh.parent), os.path.realpath(folder)), mesh.name).as_posix()
    return str(mesh)


def _lines(said: BaseModel, dump: dict[str, Any], path: str = "") -> list[str]:
    """Write the lines of a table: its values, and then the tables within it.

    Args:
        said: the table.
        dump: its written part.
        path: of the table in the scene, with a dot at its end.
    """
    values: dict[str, str] = {}
    within: list[str] = []
    for field, value in dump.items():
        held = getattr(said, field)
        parts = held if isinstance(held, list) else [held]
        if parts and all(isinstance(part, BaseModel) for part in parts):
            heading = f"[[{path}{field}]]" if isinstance(held, list) else f"[{path}{field}]"
            for part, inner in zip(parts, value if isinstance(held, list) else [value], strict=True):
                within += ["", f"{heading}  # {first_line(type(part))}", *_lines(part, inner, f"{path}{field}.")]
        else:
            values[field] = f"{field} = {toml_value(value)}"
    width = max((len(line) for line in values.values() if len(line) < LONGEST_COMMENT // 2), default=0)
    lines = []
    for field, line in values.items():
        default = default_of(type(said), field)
        comment = "; ".join(filter(None, (meaning_of(type(said), field), default and f"default {default}")))
        if len(comment) > LONGEST_COMMENT:
            lines += [f"# {part}" for part in textwrap.wrap(comment, LONGEST_COMMENT)]
            comment = ""
        lines.append(f"{line:{width}}  # {comment}" if comment else line)
    return lines + within
