"""How membranes tear: the tables, and the launches of each substep."""

from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.air import AIR
from balloon_warp.kernels.laws.body import GRAVITY
from balloon_warp.kernels.laws.tearing import PARAMETERS
from balloon_warp.kernels.schedules.launched_tears import (
    GasColumns,
    let_gas_out,
    note_bursts,
    run_tears,
    tear_faces,
    weigh_faces,
)
from balloon_warp.kernels.wear_tables import TearTable
from balloon_warp.launching import launch
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Room

BRANCHING_WAY = 0.25
"""of a balloon's diameter, that a tear runs between two branches"""
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def tear_arrays(model: Model, room: Room) -> dict[str, Any]:
    """What is found in a substep; empty where nothing tears."""
    worlds = model.world_count
    faces = (worlds, model.face_count if model.bursts else 0)
    return {
        "stresses": room.array((worlds, model.triangle_count if model.bursts else 0), wp.float32),
        "gone": room.array(faces, wp.int8),
        "marks": room.array(faces, wp.int8),
        "face_stresses": room.array(faces, wp.float32),
        "weakest": room.array((worlds, model.balloon_count if model.bursts else 0), wp.int64),
    }


def tear_table(model: Model) -> Any:
    """The faces, their triangles, and who is beside them."""
    table = TearTable()
    for name, memory in tear_arrays(model, Allocating(model.device)).items():
        setattr(table, name, memory)
    firsts = np.cumsum([0, *(shape.mesh.face_count for shape in model.shapes)])
    faces = np.concatenate([shape.membrane.faces + first for shape, first in zip(model.shapes, firsts, strict=False)])
    pairs = np.concatenate(
        [neighbors_of(shape.mesh) + first for shape, first in zip(model.shapes, firsts, strict=False)]
    )
    centers = np.concatenate([_centers(shape.mesh) for shape in model.shapes])
    distances = np.linalg.norm(centers[pairs[:, 0]] - centers[pairs[:, 1]], axis=1)

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    numbers = np.arange(model.face_count + 1)
    order = np.argsort(faces, kind="stable")
    table.triangle_offsets = array(np.searchsorted(faces[order], numbers), wp.int32)
    table.triangles = array(order, wp.int32)
    table.neighbor_offsets = array(np.searchsorted(pairs[:, 0], numbers), wp.int32)
    table.neighbors, table.distances = array(pairs[:, 1], wp.int32), array(distances, wp.float32)
    table.branching = array(np.concatenate([_branching(shape.mesh) for shape in model.shapes]), wp.int8)
    put_tear_parameters(table, model)
    return table


def tears_of_world(model: Model, tears: Any) -> Any:
    """A batch's table for one of its worlds."""
    table = TearTable()
    for name in TearTable.vars:
        memory = getattr(tears, name)
        setattr(table, name, memory[:1] if memory.ndim == 2 else memory)
    put_tear_parameters(table, model)
    return table


def put_tear_parameters(table: Any, model: Model) -> None:
    """Of balloons, as they are in the model's worlds."""
    for row in PARAMETERS:
        setattr(table, row.name, model.parameters[row.name])


def neighbors_of(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Pairs of faces that share an edge, each from both, sorted, shape (n, 2)."""
    counts = np.asarray(mesh.face_vertex_counts, dtype=np.int64)
    starts, total = np.cumsum(np.append(0, counts))[:-1], int(counts.sum())
    onward = np.arange(total) + 1
    onward[starts[counts > 0] + counts[counts > 0] - 1] = starts[counts > 0]
    ends = np.sort(np.stack([mesh.face_vertex_indices, mesh.face_vertex_indices[onward]], axis=1), axis=1)
    owners = np.repeat(np.arange(len(counts)), counts)
    order = np.lexsort([owners, ends[:, 1], ends[:, 0]])
    ends, owners = ends[order], owners[order]
    shared = (ends[1:] == ends[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    one, other = owners[:-1][shared], owners[1:][shared]
    return np.unique(np.concatenate([np.stack([one, other], axis=1), np.stack([other, one], axis=1)]), axis=0)


def _centers(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Of faces [m]."""
    corners = np.asarray(mesh.points, dtype=np.float64)[mesh.face_vertex_indices]
    offsets = np.cumsum(np.append(0, mesh.face_vertex_counts))
    return np.array([corners[begin:end].mean(axis=0) for begin, end in pairwise(offsets)])


def _branching(mesh: PolygonMesh) -> NDArray[np.bool_]:
    """The faces where a tear branches that does: so many that there is one along its way as often on any mesh, spread
    evenly by the golden ratio."""
    areas = np.linalg.norm(face_vector_areas(mesh), axis=1)
    way = BRANCHING_WAY * np.sqrt(areas.sum() / np.pi)
    return (np.arange(1, len(areas) + 1) * GOLDEN) % 1.0 < np.sqrt(areas) / way


class TearPieces:
    """Launches each piece for all worlds."""

    def __init__(self, model: Model, tables: Any):
        self.model, self.tables = model, tables
        places, split = model.columns.places, model.columns.balloon_width
        of_air = [places[row.name] - split for row in (*AIR, GRAVITY)]
        self._columns = GasColumns(*of_air, places["molar_mass"], places["gamma"])

    def weigh(self, state: State, time_in_frame: float) -> None:
        """What faces bear, and which are gone."""
        self._over(self.model.face_count, weigh_faces, time_in_frame, state.frame, state.torn, state.bursts)

    def tear(self, state: State, worlds: Any, time_in_frame: float, points: wp.array) -> None:
        """Tears begin and run on, and gas leaves."""
        m = self.model
        self._over(m.face_count, run_tears, state.bursts, state.torn)
        self._over(m.face_count, tear_faces, points, state.torn, state.hole_areas)
        self._over(m.balloon_count, let_gas_out, time_in_frame, self._columns, worlds, points, state.hole_areas)

    def note(self, worlds: Any) -> None:
        """As a frame ends."""
        shape = self.model.world_count, self.model.balloon_count
        launch(note_bursts, shape, inputs=[self.model.inflation_kind, worlds], device=self.model.device)

    def _over(self, count: int, kernel: Any, *arguments: Any) -> None:
        model = self.model
        launch(kernel, (model.world_count, count), inputs=[self.tables, *arguments], device=model.device)
