"""A stage as arrays in an HDF5 file, which h5py, xarray, MATLAB and Julia read: for learning and for plots.

A group for each thing, by its name. A balloon's has `mesh_pos` (T, N, 3), `velocity` (T, N, 3), `edges` (E, 2), the
corners of its faces, and `volume`, `area` and `pressure` (T,). A rigid thing's has `pose` (T, 4, 4) and `points`.
Places are the stage's own, in its unit. Dimensions are named as netCDF 4 does it, so that xarray knows them.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError
from balloon_warp.files import whole_file
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import next_corners
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.outputs.exports.parts import Animation, Part

NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable. "
"""Name by which netCDF 4 marks a dimension that has a length and no values"""
PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
MEASURES = {"volume": "m^3", "area": "m^2", "pressure": "Pa"}
"""Measures of our stages' balloons, and their units"""


def require_h5py() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("h5py")
    except ImportError:
        raise MissingExtraError("an .h5 needs h5py: pip install 'balloon-warp[data]'") from None


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
        self.group, self.animation = group, animation
        self._dimensions: dict[str, Any] = {}

    def fill(self, part: Part) -> None:
        frames = self.animation.frames
        self._add("time", np.array([self.animation.seconds(frame) for frame in frames]), ["time"], "s")
        mesh, count = part.mesh, part.mesh.vertex_count
        unit = "m" if self.animation.meters_per_unit == 1.0 else f"{self.animation.meters_per_unit:g} m"
        if part.soft:
            places = self._room("mesh_pos", (len(frames), count, 3), ["time", "particle", "axis"], unit)
            for row, frame in enumerate(frames):
                places[row] = part.points(frame)
            self._add_velocities(part, f"{unit}/s")
            self._add_measures(part)
        else:
            poses = np.array([part.matrix(frame) for frame in frames])
            self._add("pose", poses, ["time", "row", "column"], "1")
            self._add("points", mesh.points, ["particle", "axis"], unit)
        self._add("edges", edges_of(mesh), ["edge", "end"], "1")
        self._add("triangles", triangulate(mesh)[0], ["triangle", "triangle_corner"], "1")
        self._add("face_vertex_counts", mesh.face_vertex_counts, ["face"], "1")
        self._add("face_vertex_indices", mesh.face_vertex_indices, ["face_corner"], "1")

    def _add_velocities(self, part: Part, unit: str) -> None:
        frames = self.animation.frames
        if part.velocities(frames[0]) is not None:
            shape = len(frames), part.mesh.vertex_count, 3
            room = self._room("velocity", shape, ["time", "particle", "axis"], unit)
            for row, frame in enumerate(frames):
                room[row] = part.velocities(frame)

    def _add_measures(self, part: Part) -> None:
        for name, unit in MEASURES.items():
            attribute = part.prim.GetAttribute(f"userProperties:{name}")
            if attribute and attribute.GetNumTimeSamples():
                values = np.array([attribute.Get(frame) for frame in self.animation.frames], np.float64)
                self._add(name, values, ["time"], unit)

    def _add(self, name: str, values: NDArray, dimensions: list[str], unit: str) -> None:
        values = values.astype(np.float32 if values.ndim > 1 and values.dtype == np.float64 else values.dtype)
        if name in dimensions:  # the values of a dimension
            data = self._dimensions[name] = self.group.create_dataset(name, data=values)
            data.make_scale(name)
        else:
            data = self.group.create_dataset(name, data=values)
            self._name(data, dimensions)
        data.attrs["units"] = unit

    def _room(self, name: str, shape: tuple[int, ...], dimensions: list[str], unit: str) -> Any:
        """Create a dataset for float32 numbers that are written frame by frame."""
        data = self.group.create_dataset(name, shape, np.float32, chunks=(1, *shape[1:]), **PACKED)
        data.attrs["units"] = unit
        self._name(data, dimensions)
        return data

    def _name(self, data: Any, dimensions: list[str]) -> None:
        for place, (name, length) in enumerate(zip(dimensions, data.shape, strict=True)):
            if name not in self._dimensions:
                scale = self.group.create_dataset(name, (length,), np.float32)
                scale.make_scale(f"{NO_VARIABLE}{length:10d}")
                self._dimensions[name] = scale
            data.dims[place].attach_scale(self._dimensions[name])


def edges_of(mesh: PolygonMesh) -> NDArray[np.int32]:
    """Return each pair of vertices that is a side of a face, once, lower first, shape (edge_count, 2)."""
    corners = mesh.face_vertex_indices
    sides = np.stack([corners, corners[next_corners(mesh)]], axis=1)
    return np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)
