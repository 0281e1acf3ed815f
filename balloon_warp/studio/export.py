"""Export of a stage as a file of another kind, as arrays, or as a file for each frame.

A stage as an Alembic archive, as one .usdz package, as arrays in an HDF5 file, or as a series for ParaView.

A stage as arrays in an HDF5 file, which h5py, xarray, MATLAB and Julia read: for learning and for plots.

A group for each thing, by its name. A balloon's has `mesh_pos` (T, N, 3), `velocity` (T, N, 3), `edges` (E, 2), the
corners of its faces, and `volume`, `area` and `pressure` (T,). A rigid thing's has `pose` (T, 4, 4) and `points`.
Places are the stage's own, in its unit. Dimensions have labels, and there are no arrays beside the real ones.

A simulation's frames always go into a stage first: it survives a kill, resumes with `--resume`, and passes USD's
validators. An export is made from the stage, and so is the same from `run -o` and, later, from `convert`.
"""

import base64
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdUtils

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.mesh.crossings import Pictures
from balloon_warp.mesh.topology import edges_of, triangulate, vertex_normals
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.mesh.usd_stage import content_of
from balloon_warp.studio.parts import Animation, Part
from balloon_warp.studio.render.sampling import timing_of
from balloon_warp.system.api import checked
from balloon_warp.system.files import (
    LINE,
    PACKED,
    NamedArrays,
    check_writable,
    folder_beside,
    require_h5py,
    require_ours,
    sole_writer,
    whole_file,
)
from balloon_warp.usd import STAGE_SUFFIXES

SCRIPT = """
import sys
import bpy

stage, archive, first, last, rate = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=stage)
bpy.context.scene.render.fps = max(round(float(rate)), 1)
bpy.context.scene.render.fps_base = bpy.context.scene.render.fps / float(rate)
bpy.ops.wm.alembic_export(filepath=archive, start=int(first), end=int(last), as_background_job=False)
"""
"""Script for a process of its own: Blender brings a USD of its own, which conflicts with another"""


def require_blender() -> None:
    """Make sure that Blender's module is there.

    Raises:
        MissingExtraError: it is not.
    """
    if find_spec("bpy") is None:
        raise MissingExtraError(
            "an .abc needs Blender's Python module: pip install bpy; or write .usdc, and export Alembic from Blender"
        )


def write_alembic(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the archive; arguments as `export_stage` has them.

    Raises:
        MissingExtraError: Blender's module is not installed.
        InputError: Blender failed.
    """
    require_blender()
    frames, rate = animation.frames, animation.frames_per_second
    with whole_file(output) as temporary:
        words = [animation.path, temporary, frames[0], frames[-1], rate]
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, *map(str, words)], capture_output=True, text=True, check=False
        )
        if done.returncode or not temporary.is_file():
            reason = (done.stderr.strip() or done.stdout.strip() or f"exit status {done.returncode}").splitlines()[-1]
            raise InputError(f"{output}: Blender could not write it: {reason}")
    on_frame(1, 1)


def write_usdz(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the package; arguments as `export_stage` has them."""
    with folder_beside(output) as folder, whole_file(output) as temporary:
        flat = folder / f"{output.stem}.usdc"  # a package begins with a binary layer, under this name
        _as_it_is(animation).Export(str(flat), addSourceFileComment=False)  # which names our folder
        if not UsdUtils.CreateNewUsdzPackage(str(flat), str(temporary)):
            raise InputError(f"{output}: USD could not make a package of {animation.path}; is the disk full?")
    on_frame(1, 1)


def write_stage(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the stage in one file of another kind of USD, with its images beside it."""
    flat, pictures = _as_it_is(animation).Flatten(addSourceFileComment=False), Pictures(animation.path)

    def beside(path: str) -> str:
        data = content_of(path)
        picture = pictures.of_bytes(path, data) if data else None
        if picture is None:
            return path
        picture.write_beside(output)
        return picture.path

    UsdUtils.ModifyAssetPaths(flat, beside)
    with whole_file(output) as temporary:
        flat.Export(str(temporary))
    on_frame(1, 1)


def _as_it_is(animation: Animation) -> Usd.Stage:
    """Return the stage with its shapes and instances as they are, where others of its kind read them."""
    return timing_of(open_stage(animation.path), animation.path).stage


MEASURES = {"volume": "m^3", "area": "m^2", "pressure": "Pa"}
"""Measures of our stages' balloons, and their units"""


def write_hdf5(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the file; arguments as `export_stage` has them."""
    h5py = require_h5py()
    with whole_file(output) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["frames_per_second"] = animation.frames_per_second
        file.attrs["first_frame"] = animation.frames[0]
        file.attrs["up_axis"] = animation.up_axis
        file.attrs["meters_per_unit"] = animation.meters_per_unit
        for done, part in enumerate(animation.parts, start=1):
            _Group(file.create_group(part.name), animation).fill(part)
            on_frame(done, len(animation.parts))


class _Group:
    """Group of a part in the file."""

    def __init__(self, group: Any, animation: Animation):
        self.arrays, self.animation = NamedArrays(group), animation

    def fill(self, part: Part) -> None:
        frames, add = self.animation.frames, self.arrays.add
        add("time", np.array([self.animation.seconds(frame) for frame in frames]), ("time",), "s")
        mesh, count = part.mesh, part.mesh.vertex_count
        unit = "m" if self.animation.meters_per_unit == 1.0 else f"{self.animation.meters_per_unit:g} m"
        if part.soft:
            places = self._room("mesh_pos", count, unit)
            for row, frame in enumerate(frames):
                places[row] = part.points(frame)
            self._add_velocities(part, f"{unit}/s")
            self._add_measures(part)
        else:
            poses = np.array([part.matrix(frame) for frame in frames], dtype=np.float32)
            add("pose", poses, ("time", "row", "column"), "1")
            add("points", mesh.points.astype(np.float32), ("particle", "axis"), unit)
        add("edges", edges_of(mesh), ("edge", "end"), "1")
        add("triangles", triangulate(mesh)[0], ("triangle", "triangle_corner"), "1")
        add("face_vertex_counts", mesh.face_vertex_counts, ("face",), "1")
        add("face_vertex_indices", mesh.face_vertex_indices, ("face_corner",), "1")

    def _add_velocities(self, part: Part, unit: str) -> None:
        frames = self.animation.frames
        if part.velocities(frames[0]) is not None:
            room = self._room("velocity", part.mesh.vertex_count, unit)
            for row, frame in enumerate(frames):
                room[row] = part.velocities(frame)

    def _add_measures(self, part: Part) -> None:
        for name, unit in MEASURES.items():
            attribute = part.prim.GetAttribute(f"userProperties:{name}")
            if attribute and attribute.GetNumTimeSamples():
                values = np.array([attribute.Get(frame) for frame in self.animation.frames], np.float64)
                self.arrays.add(name, values, ("time",), unit)

    def _room(self, name: str, count: int, unit: str) -> Any:
        """Create an array for particles, which is written frame by frame."""
        shape, dimensions = (len(self.animation.frames), count, 3), ("time", "particle", "axis")
        return self.arrays.room(name, shape, dimensions, unit, np.float32, chunks=(1, count, 3), **PACKED)


POLYGON, TRIANGLE, QUAD = 7, 5, 9
"""Cell types, as VTK numbers them"""
_KINDS = {np.dtype(np.float32): "Float32", np.dtype(np.int64): "Int64", np.dtype(np.uint8): "UInt8"}


def grid_path(output: Path, frame: int) -> Path:
    """Return the file of a frame's grid."""
    return output.with_name(f"{output.stem}.{frame:04d}.vtu")


def write_series(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the grids, OUTPUT.0000.vtu and so on, and then the list of them; arguments as `export_stage` has them."""
    listed = []
    for done, frame in enumerate(animation.frames, start=1):
        path = grid_path(output, frame)
        with whole_file(path) as temporary:
            temporary.write_text(_grid(animation, frame), encoding="ascii")
        place = f'timestep="{animation.seconds(frame):.9g}" part="0" file={quoteattr(path.name)}'
        listed.append(f"<DataSet {place}/>\n")
        on_frame(done, len(animation.frames))
    with whole_file(output) as temporary:
        content = "".join(["<Collection>\n", *listed, "</Collection>\n"])
        temporary.write_text(_file("Collection", content), encoding="utf-8")


def _file(kind: str, content: str) -> str:
    return (
        f'<?xml version="1.0"?>\n<!-- {LINE} -->\n'
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"{content}</VTKFile>\n"
    )


def _grid(animation: Animation, frame: int) -> str:
    """Return all that is seen, in meters with Y up: velocities at points, the part's number and pressure in cells."""
    parts = [(number, part) for number, part in enumerate(animation.parts) if part.seen(frame)]
    counts = np.concatenate([part.mesh.face_vertex_counts for _, part in parts])
    befores = np.cumsum([0, *(part.mesh.vertex_count for _, part in parts[:-1])])
    shown = zip(befores.tolist(), parts, strict=True)
    corners = np.concatenate([part.mesh.face_vertex_indices.astype(np.int64) + before for before, (_, part) in shown])
    points = np.concatenate([animation.y_up_meters(part.points(frame)) for _, part in parts])
    velocities = np.concatenate([animation.y_up_meters(_velocities(part, frame)) for _, part in parts])
    kinds = np.select([counts == 3, counts == 4], [TRIANGLE, QUAD], POLYGON)
    return _file(
        "UnstructuredGrid",
        f'<UnstructuredGrid>\n<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(counts)}">\n'
        f"<Points>\n{_array('points', points.astype(np.float32))}</Points>\n"
        f"<Cells>\n{_array('connectivity', corners)}{_array('offsets', np.cumsum(counts, dtype=np.int64))}"
        f"{_array('types', kinds.astype(np.uint8))}</Cells>\n"
        f"<PointData>\n{_array('velocity', velocities.astype(np.float32))}</PointData>\n"
        f"<CellData>\n{_array('part', _of_faces(parts, lambda number, part: number).astype(np.int64))}"
        f"{_array('pressure', _of_faces(parts, lambda number, part: _pressure(part, frame)).astype(np.float32))}"
        "</CellData>\n</Piece>\n</UnstructuredGrid>\n",
    )


def _of_faces(parts: Sequence[tuple[int, Part]], value: Callable[[int, Part], float]) -> NDArray[np.float64]:
    """Return a number of each part, at each of its faces."""
    return np.concatenate([np.full(part.mesh.face_count, float(value(number, part))) for number, part in parts])


def _velocities(part: Part, frame: int) -> NDArray[np.float64]:
    """Return 0 where nothing says them."""
    said = part.velocities(frame)
    return np.zeros((part.mesh.vertex_count, 3)) if said is None else said


def _pressure(part: Part, frame: int) -> float:
    attribute = part.prim.GetAttribute("userProperties:pressure")
    return float(attribute.Get(frame) or 0.0) if attribute else 0.0


def _array(name: str, values: NDArray) -> str:
    """Return an array as base64 behind its number of bytes."""
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    data = np.ascontiguousarray(values).tobytes()
    text = base64.b64encode(np.uint64(len(data)).tobytes() + data).decode()
    return f'<DataArray type="{_KINDS[values.dtype]}" Name="{name}"{columns} format="binary">{text}</DataArray>\n'


SEQUENCE_SUFFIXES = (".obj", ".ply")
"""Files of which each frame has one"""


def frame_path(pattern: Path, frame: int) -> Path:
    """Return the file of a frame: its number, with as many digits as the name has `#` at least, in their place.

    Raises:
        InputError: the name has no place for the number.
    """
    if not re.search("#+", pattern.name):
        raise InputError(
            f"{pattern}: is one file for all frames; expected #### in the name for the frame number, such as "
            f"{pattern.stem}.####{pattern.suffix}"
        )
    name = re.sub("#+", lambda found: f"{frame:0{len(found[0])}d}", pattern.name, count=1)
    return pattern.with_name(name)


def write_sequence(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write a file for each frame, each of which appears whole or not at all; arguments as `export_stage` has them."""
    text = _obj if output.suffix.lower() == ".obj" else partial(_ply, in_triangles=_has_many_kinds(animation.parts))
    for done, frame in enumerate(animation.frames, start=1):
        parts = [part for part in animation.parts if part.seen(frame)]
        points = [animation.y_up_meters(part.points(frame)) for part in parts]
        with whole_file(frame_path(output, frame)) as path:
            path.write_bytes(text(parts, points))
        on_frame(done, len(animation.frames))
    if others := _of_no_frame(output, animation):
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        on_note(f"{others[0].name}{more}: from an earlier sequence of that name; kept")


def _of_no_frame(pattern: Path, animation: Animation) -> list[Path]:
    """Return the files of the same name that are of another, longer sequence."""
    before, after = re.split("#+", pattern.name, maxsplit=1)
    form = f"{re.escape(before)}([0-9]+){re.escape(after)}"
    found = ((path, re.fullmatch(form, path.name)) for path in sorted(pattern.parent.iterdir()))
    return [path for path, match in found if match and int(match[1]) not in animation.frames]


def _obj(parts: Sequence[Part], points: Sequence[NDArray[np.float64]]) -> bytes:
    """Return Text: an object for each part, smooth, with texture coordinates where it has them."""
    text, before, coordinates_before = [f"# {LINE}: meters, Y up\n"], 1, 1
    for part, places in zip(parts, points, strict=True):
        mesh = part.mesh
        text.append(f"o {part.name}\n" + "v %.9g %.9g %.9g\n" * len(places) % tuple(places.ravel().tolist()))
        corners = (mesh.face_vertex_indices + before).astype(str)
        if mesh.texture_coordinates is not None:
            unique, number = np.unique(mesh.texture_coordinates, axis=0, return_inverse=True)
            text.append("vt %.9g %.9g\n" * len(unique) % tuple(unique.ravel().tolist()))
            corners = np.char.add(np.char.add(corners, "/"), (number.ravel() + coordinates_before).astype(str))
            coordinates_before += len(unique)
        faces = np.split(corners, np.cumsum(mesh.face_vertex_counts)[:-1])
        text.append("s 1\n" + "".join(f"f {' '.join(face)}\n" for face in faces))
        before += len(places)
    return "".join(text).encode()


def _has_many_kinds(parts: Sequence[Part]) -> bool:
    """Return whether faces differ in their number of corners."""
    return len(np.unique(np.concatenate([part.mesh.face_vertex_counts for part in parts]))) > 1


def _ply(parts: Sequence[Part], points: Sequence[NDArray[np.float64]], in_triangles: bool) -> bytes:
    """Return Binary: all parts in one mesh, with normals and colors at its vertices.

    Args:
        in_triangles: whether faces are cut up: many programs read lists of one length alone.
    """
    vertex = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
    vertices, faces, before, face_count = [], [], 0, 0
    for part, places in zip(parts, points, strict=True):
        mesh = replace(part.mesh, points=places)
        counts, indices = mesh.face_vertex_counts, mesh.face_vertex_indices
        if in_triangles:
            indices = triangulate(mesh)[0].ravel()
            counts = np.full(len(indices) // 3, 3)
        rows = np.zeros(len(places), vertex)
        rows["place"], rows["normal"] = places, vertex_normals(mesh)
        rows["color"] = _srgb(part.color)
        starts = np.cumsum(counts) - counts
        vertices.append(rows.tobytes())
        faces.append(np.insert(indices + before, starts, counts).astype("<i4").tobytes())
        before, face_count = before + len(places), face_count + len(counts)
    header = "".join(
        [
            f"ply\nformat binary_little_endian 1.0\ncomment {LINE}: meters, Y up\n",
            f"element vertex {before}\n",
            *(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")),
            *(f"property uchar {name}\n" for name in ("red", "green", "blue")),
            f"element face {face_count}\nproperty list int int vertex_indices\nend_header\n",
        ]
    )
    return b"".join([header.encode("ascii"), *vertices, *faces])


def _srgb(color: Sequence[float]) -> NDArray[np.uint8]:
    """Return sRGB in 8 bits from linear RGB."""
    linear = np.clip(color, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * encoded).astype(np.uint8)


HDF5_SUFFIXES = (".h5", ".hdf5")
WRITERS = {
    **dict.fromkeys(STAGE_SUFFIXES, "export.write_stage"),
    ".usdz": "export.write_usdz",
    ".glb": "parts.write_glb",
    ".obj": "export.write_sequence",
    ".ply": "export.write_sequence",
    ".abc": "export.write_alembic",
    **dict.fromkeys(HDF5_SUFFIXES, "export.write_hdf5"),
    ".pvd": "export.write_series",
}
"""Writers by suffix, loaded when first needed: functions of the output path, the stage's `Animation`, and listeners to
notes and to progress"""
EXPORT_SUFFIXES = tuple(WRITERS)


def check_export(output: Path) -> None:
    """Make sure, before any work is done, that a file of this kind can be written there.

    Raises:
        InputError: it cannot.
        MissingExtraError: the package that writes it is not installed.
    """
    suffix = output.suffix.lower()
    check_writable(output, EXPORT_SUFFIXES)
    if suffix in SEQUENCE_SUFFIXES:
        check_writable(frame_path(output, 0), EXPORT_SUFFIXES)
    elif suffix == ".abc":
        require_blender()
    elif suffix in HDF5_SUFFIXES:
        from balloon_warp.system.files import require_h5py

        require_h5py()


def files_of_frames(output: Path, frames: Iterable[int]) -> list[Path]:
    """Return the files of single frames that belong to an output; none of most kinds."""
    suffix = output.suffix.lower()
    if suffix in SEQUENCE_SUFFIXES:
        path_of = frame_path
    elif suffix == ".pvd":
        path_of = grid_path
    else:
        return []
    return [path_of(output, frame) for frame in frames]


@checked
def export_stage(
    stage: str | Path,
    output: str | Path,
    *,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_frame: Callable[[int, int], None] = lambda done, count: None,
) -> None:
    """Convert a stage to a file of another kind.

    That is .usdc, .usda, .usd, .usdz, .glb, .abc, .h5, .pvd, or one .obj or .ply for each frame, where the name has
    #### for its number. Files appear whole or not at all.

    Args:
        stage: Any file that USD opens.
        output: File to write.
        on_note: Called with sentences, such as the size of a file to come, or the missing files of the stage.
        on_frame: Called with the amount done, and the whole.

    Raises:
        InputError: the stage cannot be read, the output cannot be written, or the file of a frame is not ours.
        MissingExtraError: the package that writes it is not installed.
    """
    stage, output = Path(stage), Path(output)
    check_export(output)
    if stage.exists() and output.exists() and stage.samefile(output):
        raise InputError(f"{output}: is the input stage; expected another name, with -o")
    from balloon_warp.studio.parts import Animation  # loads USD: only once the output is known to be good

    module, function = WRITERS[output.suffix.lower()].split(".")
    write = getattr(import_module(f"balloon_warp.studio.{module}"), function)
    animation = Animation(stage, on_note)
    for path in files_of_frames(output, animation.frames):
        require_ours(path)
    with sole_writer(output):
        write(output, animation, on_note, on_frame)
