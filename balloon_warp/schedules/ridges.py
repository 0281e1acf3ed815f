"""Ridges of obstacles and bodies, and the faces of balloons that meet them, as kernels read them."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact_tables import RidgeTable
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.laws.ridges import Ridge
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.model.ridges import NO_RIDGES, Ridges, kept_distance
from balloon_warp.model.small_spheres import round_ridges
from balloon_warp.model.touch import edge_length

MARGIN = 0.15
"""Distance within which ridges are listed until the next search, over an edge"""
CENTER = Ridges(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), 0.0, np.ones(1, np.int32))
"""Ridge of a sphere, whose radius is the sphere's in a world"""


def ridge_table(model: Model, features: Features) -> Any:
    """Make the table of ridges; empty where faces do not meet any. Its trees live as long as the model does."""
    table, device = RidgeTable(), model.device
    if not features.ridges:
        return table
    solids = len(model.obstacles) + len(model.bodies)
    spheres = [CENTER if is_round else NO_RIDGES for is_round in round_ridges(model)]
    ridges = [*(model.ridges or [NO_RIDGES] * solids), *spheres]
    trees = [tree.id if tree else 0 for tree in model.ridge_trees] or [0] * solids
    firsts = np.cumsum([0, *(len(each.ends) for each in ridges)])
    table.ridges = wp.array([row for each in ridges for row in _rows(each)], dtype=Ridge, device=device)
    table.ends = wp.array(np.stack([firsts[:-1], firsts[1:]], axis=1), dtype=wp.vec2i, device=device)
    table.boxes = wp.array([_box_of(each) for each in ridges], dtype=wp.vec3, device=device)
    table.trees = wp.array([*trees, *(0 for _ in spheres)], dtype=wp.uint64, device=device)
    table.features = wp.array(_features_of(model), dtype=wp.vec4i, device=device)
    edge = min(edge_length(shape.mesh) for shape in model.shapes)
    table.kept, table.margin = kept_distance(model.shapes), MARGIN * edge
    return table


def ridge_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for ridges, but for lists that grow; empty where faces do not touch them."""
    worlds = model.world_count if features.ridges else 0
    spheres = model.sphere_count if features.round_ridges else 0
    return {
        "ridge_counts": room.array((worlds,), wp.int32),
        "ridge_budgets": room.array((worlds,), wp.float32),
        "ridge_radii": room.array((worlds, spheres), wp.float32),
    }


def sweep_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for sweeps over contacts, but for their list; empty where there are none."""
    worlds = model.world_count if features.lists_contacts else 0
    solids = model.body_count + (model.sphere_count if features.ridges else 0)
    tells = features.tells_contacts and features.edges_meet
    return {
        "catch_counts": room.array((worlds, 2), wp.int32),
        "contact_shares": room.array((worlds, model.particle_count), wp.int32),
        "contact_quanta": room.array((worlds, model.particle_count, 3), wp.int64),
        "layer_quanta": room.array((worlds, model.particle_count if tells else 0, 3), wp.int64),
        "contact_stops": room.array((worlds, 0), wp.vec2),
        "solid_shares": room.array((worlds, solids), wp.int32),
        "solid_quanta": room.array((worlds, solids, 6), wp.int64),
    }


def _rows(ridges: Ridges) -> list[Any]:
    rows = []
    for (begin, end), (inward, other), tips in zip(ridges.ends, ridges.inward, ridges.tips, strict=True):
        row = Ridge()
        row.begin, row.end = wp.vec3(begin), wp.vec3(end)
        row.inward, row.other_inward = wp.vec3(inward), wp.vec3(other)
        row.radius, row.tips = ridges.radius, int(tips)
        rows.append(row)
    return rows


def _box_of(ridges: Ridges) -> NDArray[np.float64]:
    """Return the box around a solid's ridges, shape (2, 3); an empty one where it has none."""
    points = np.asarray(ridges.ends, dtype=float).reshape(-1, 3)
    lower, upper = points.min(axis=0, initial=FAR), points.max(axis=0, initial=-FAR)
    return np.stack([lower - ridges.radius, upper + ridges.radius])


def _features_of(model: Model) -> NDArray[np.int32]:
    """Return the triangles and edges of all balloons."""
    offsets = model.particle_offsets
    rows = []
    for number, shape in enumerate(model.shapes):
        triangles = triangles_of(shape.mesh)
        edges = np.unique(
            np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)), axis=0
        )
        edges = edges[edges[:, 0] != edges[:, 1]]
        first, none = int(offsets[number]), np.full((len(edges), 1), -1)
        rows.append(np.column_stack([triangles + first, np.full(len(triangles), number)]))
        rows.append(np.column_stack([edges + first, none, np.full(len(edges), number)]))
    return np.concatenate(rows).astype(np.int32)
