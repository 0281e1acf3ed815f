"""A stage as arrays in an HDF5 file, which h5py, xarray, MATLAB and Julia read: for learning and for plots.

A group for each thing, by its name. A balloon's has `mesh_pos` (T, N, 3), `velocity` (T, N, 3), `edges` (E, 2), the
corners of its faces, and `volume`, `area` and `pressure` (T,). A rigid thing's has `pose` (T, 4, 4) and `points`.
Places are the stage's own, in its unit. Dimensions have labels, and there are no arrays beside the real ones.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.files import whole_file
from balloon_warp.mesh.corners import edges_of
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.outputs.exports.parts import Animation, Part
from balloon_warp.outputs.hdf5_arrays import PACKED, NamedArrays, require_h5py

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
