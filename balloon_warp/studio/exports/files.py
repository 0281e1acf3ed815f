"""A stage as an Alembic archive, as one .usdz package, as arrays in an HDF5 file, or as a series for ParaView.

A stage as arrays in an HDF5 file, or as a series for ParaView.

A stage as arrays in an HDF5 file, which h5py, xarray, MATLAB and Julia read: for learning and for plots.

A group for each thing, by its name. A balloon's has `mesh_pos` (T, N, 3), `velocity` (T, N, 3), `edges` (E, 2), the
corners of its faces, and `volume`, `area` and `pressure` (T,). A rigid thing's has `pose` (T, 4, 4) and `points`.
Places are the stage's own, in its unit. Dimensions have labels, and there are no arrays beside the real ones.
"""

import base64
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdUtils

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.mesh.crossings import Pictures
from balloon_warp.mesh.topology import edges_of, triangulate
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.mesh.usd_stage import content_of
from balloon_warp.studio.exports.parts import Animation, Part
from balloon_warp.studio.render.timing import timing_of
from balloon_warp.system.arrays import PACKED, NamedArrays, require_h5py
from balloon_warp.system.files import LINE, folder_beside, whole_file

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
