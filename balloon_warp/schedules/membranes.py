"""Tables of membranes and of their tears."""

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.membrane import MEMBRANES, SOFTENING_PARAMETERS, TEARING_PARAMETERS
from balloon_warp.kernels.loops.membranes import PLACE_BYTES, VECTOR_BYTES, MembraneFaceLayout
from balloon_warp.kernels.tables import MembraneFaceTable, MembraneTable, TearTable, WearTable
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, face_vector_areas, next_corners, total_area
from balloon_warp.model import Model
from balloon_warp.model.state import Allocating, Room
from balloon_warp.schedules.slices import slices_of
from balloon_warp.springs.build import Membrane

BRANCHING_WAY = 0.25
"""Distance between two branchings of a tear, over a balloon's diameter"""
MOST_TORN = 0.085
"""Largest fraction of the skin that tears, a face wide, are to take away"""
TEARS_BY_BRANCHINGS = (0.0, 1.5, 2.7, 4.5)
"""Length of all tears over a sphere's circumference, where they never branch, where they branch at their start only,
and once or twice after"""


def tear_arrays(model: Model, room: Room) -> dict[str, Any]:
    """Return the arrays of a substep's tears; empty where nothing tears."""
    worlds = model.world_count
    faces = (worlds, model.face_count if model.bursts else 0)
    return {
        "stresses": room.array((worlds, model.triangle_count if model.bursts else 0), wp.float32),
        "gone": room.array(faces, wp.int8),
        "ahead": room.array(faces, wp.float32),
        "face_stresses": room.array(faces, wp.float32),
        "weakest": room.array((worlds, model.balloon_count if model.bursts else 0), wp.int64),
        "areas": room.array((worlds, model.balloon_count if model.bursts else 0, 2), wp.int64),
    }


def tear_table(model: Model) -> Any:
    """Return the faces, their triangles, and their neighbors."""
    table = TearTable()
    for name, memory in tear_arrays(model, Allocating(model.device)).items():
        setattr(table, name, memory)
    firsts = np.cumsum([0, *(shape.mesh.face_count for shape in model.shapes)])
    faces = np.concatenate([shape.membrane.faces + first for shape, first in zip(model.shapes, firsts, strict=False)])
    meshes = [shape.mesh for shape in model.shapes]
    beside = [neighbors_of(mesh) for mesh in meshes]
    pairs = np.concatenate([each.faces + first for each, first in zip(beside, firsts, strict=False)])
    edges = np.concatenate([each.edges + first for each, first in zip(beside, model.particle_offsets, strict=False)])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    numbers = np.arange(model.face_count + 1)
    order = np.argsort(faces, kind="stable")
    table.triangle_offsets = array(np.searchsorted(faces[order], numbers), wp.int32)
    table.triangles = array(order, wp.int32)
    table.neighbor_offsets = array(np.searchsorted(pairs[:, 0], numbers), wp.int32)
    table.neighbors, table.edges = array(pairs[:, 1], wp.int32), array(edges, wp.vec2i)
    table.rests = array(np.concatenate([_rests(mesh) for mesh in meshes]), wp.vec3)
    table.centers = array(np.concatenate([_centers(mesh) for mesh in meshes]), wp.vec3)
    table.normals = array(np.concatenate([_normals(mesh) for mesh in meshes]), wp.vec3)
    table.ways = array([BRANCHING_WAY * diameter_of(mesh) for mesh in meshes], wp.float32)
    table.branchings = array([branchings_of(mesh) for mesh in meshes], wp.int32)
    put_tear_parameters(table, model)
    return table


def tears_of_world(model: Model, tears: Any) -> Any:
    """Return a batch's table for one of its worlds."""
    table = TearTable()
    for name in TearTable.vars:
        memory = getattr(tears, name)
        setattr(table, name, memory[:1] if memory.ndim > 1 else memory)
    put_tear_parameters(table, model)
    return table


def put_tear_parameters(table: Any, model: Model) -> None:
    """Store the tear parameters of the balloons in the model's worlds."""
    for row in TEARING_PARAMETERS:
        setattr(table, row.name, model.parameters[row.name])


class Neighbors(NamedTuple):
    """Pairs of faces that share an edge, each from both, sorted."""

    faces: NDArray[np.int64]
    """Two faces of each edge, shape (n, 2)"""
    edges: NDArray[np.int64]
    """Vertices of each edge, shape (n, 2)"""


def neighbors_of(mesh: PolygonMesh) -> Neighbors:
    """Return the neighbors of each face."""
    counts = np.asarray(mesh.face_vertex_counts, dtype=np.int64)
    begins = np.asarray(mesh.face_vertex_indices, dtype=np.int64)
    ends = np.sort(np.stack([begins, begins[next_corners(mesh)]], axis=1), axis=1)
    owners = np.repeat(np.arange(len(counts)), counts)
    order = np.lexsort([owners, ends[:, 1], ends[:, 0]])
    ends, owners = ends[order], owners[order]
    shared = (ends[1:] == ends[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    one, other = owners[:-1][shared], owners[1:][shared]
    pairs = np.concatenate([np.stack([one, other], axis=1), np.stack([other, one], axis=1)])
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    return Neighbors(pairs, np.tile(ends[:-1][shared], (2, 1))[first])


def _rests(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the vertices about their middle, which keeps float32's digits [m]."""
    return np.asarray(mesh.points - mesh.points.mean(axis=0), dtype=np.float64)


def _centers(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the centers of faces [m]."""
    corners = _rests(mesh)[mesh.face_vertex_indices]
    offsets = np.cumsum(np.append(0, mesh.face_vertex_counts))
    return np.array([corners[begin:end].mean(axis=0) for begin, end in pairwise(offsets)])


def _normals(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the unit normals of faces."""
    vectors = face_vector_areas(mesh)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)


def diameter_of(mesh: PolygonMesh) -> float:
    """Return the diameter of the sphere of equal area [m]."""
    return float(np.sqrt(total_area(mesh) / np.pi))


def share_of_tear(mesh: PolygonMesh) -> float:
    """Return the part of the surface that a tear once around a balloon takes away.

    A line meets a face as often as the face has perimeter, 1 / pi of it times the line's length over all area
    (Cauchy, Crofton).
    """
    corners = np.asarray(mesh.points, dtype=np.float64)[mesh.face_vertex_indices]
    lengths = np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1)
    perimeters = np.bincount(corner_faces(mesh), lengths, mesh.face_count)
    areas = np.linalg.norm(face_vector_areas(mesh), axis=1)
    return float(diameter_of(mesh) * (perimeters @ areas) / max(areas.sum() ** 2, np.finfo(float).tiny))


def branchings_of(mesh: PolygonMesh) -> int:
    """Return the number of branchings of a tear for which its gaps, a face wide, leave nine tenths of the skin."""
    return int(np.searchsorted(TEARS_BY_BRANCHINGS, MOST_TORN / share_of_tear(mesh), side="right")) - 1


def membrane_laws(model: Model) -> tuple[Law, ...]:
    """Return the membrane laws of the model's balloons, each once."""
    kinds = {balloon.material.law for balloon in model.scene.balloon}
    return tuple(law for name, law in MEMBRANES.items() if name in kinds)


def membrane_table(model: Model) -> Any:
    """Return the triangles, each once and from each of its corners."""
    table = MembraneTable()
    table.corners, table.corner_rests = model.membrane_corners, model.membrane_rests
    if not model.triangle_count:
        return table
    names = [law.name for law in membrane_laws(model)]
    of_balloons = [balloon.material.law for balloon in model.scene.balloon]
    table.materials = _array(model, [names.index(law) if law in names else 0 for law in of_balloons], wp.int32)
    around = corner_triangles(model)
    counts = np.bincount(around.particles, minlength=model.particle_count)
    slices = slices_of(around.particles, counts, 1)
    others = np.repeat(slices.owners[:, None], 2, axis=1)
    others[slices.places] = around.others
    rests = np.zeros((len(others), 4))
    rests[slices.places] = around.rests
    table.slice_offsets = _array(model, slices.offsets, wp.int32)
    table.counts = _array(model, counts, wp.int32)
    table.others, table.rests = _array(model, others, wp.vec2i), _array(model, rests, wp.vec4)
    if model.softens or model.bursts:
        numbers = np.zeros(len(others))
        numbers[slices.places] = around.numbers
        table.wear.numbers = _array(model, numbers, wp.int32)
        table.wear.left = left_array(model, Allocating(model.device))
        put_wear_parameters(table.wear, model)
    if model.bursts:
        table.wear.tears = tear_table(model)
    return table


def left_array(model: Model, room: Room) -> Any:
    """Return the memory for the remaining fraction of triangles' tensions, where rubber softens or tears."""
    wears = model.softens or model.bursts
    return room.array((model.world_count, model.triangle_count if wears else 0), wp.float32)


def membranes_of_world(model: Model, membranes: Any) -> Any:
    """Return a batch's table for one of its worlds."""
    if not model.softens and not model.bursts:
        return membranes
    table, wear = MembraneTable(), WearTable()
    for name in MembraneTable.vars:
        setattr(table, name, getattr(membranes, name))
    wear.numbers, wear.left = membranes.wear.numbers, membranes.wear.left[:1]
    put_wear_parameters(wear, model)
    if model.bursts:
        wear.tears = tears_of_world(model, membranes.wear.tears)
    table.wear = wear
    return table


def put_wear_parameters(wear: Any, model: Model) -> None:
    """Store the wear parameters of the balloons in the model's worlds."""
    for row in SOFTENING_PARAMETERS:
        setattr(wear, row.name, model.parameters[row.name])


class CornerTriangles(NamedTuple):
    """The triangles from each of their corners, sorted by particle."""

    particles: NDArray[np.int64]
    """Particle of the corner itself, shape (n,)"""
    others: NDArray[np.int64]
    """Other two corners, shape (n, 2)"""
    rests: NDArray[np.float64]
    """Rest metrics with the particle as the first corner, see `MembraneTable`, shape (n, 4)"""
    numbers: NDArray[np.int64]
    """Numbers of the triangles, shape (n,)"""


def corner_triangles(model: Model) -> CornerTriangles:
    """Return the triangles at the corners of all balloons."""
    shapes = [shape.membrane for shape in model.shapes]
    triangles = Membrane(
        np.asarray(model.membrane_corners.numpy(), dtype=np.int64),
        np.concatenate([membrane.areas for membrane in shapes]),
        np.concatenate([membrane.edges for membrane in shapes]),
    )
    turned = [triangles.turned(turns) for turns in range(3)]
    corners = np.concatenate([each.corners for each in turned])
    rests = np.concatenate([each.rests for each in turned])
    order = np.argsort(corners[:, 0], kind="stable")
    return CornerTriangles(corners[order, 0], corners[order, 1:], rests[order], order % triangles.count)


class MembraneQuads(NamedTuple):
    """The triangles of membranes by fours, those of a quad, and by ones: of each balloon first those, then these."""

    corners: NDArray[np.int64]
    """Corners; of a triangle the first, the second, the first again, and the third; shape (n, 4)"""
    rests: NDArray[np.float64]
    """Rest metric of the triangle at each corner, from there to the next and the last, see `MembraneTable`; a triangle
    has one at its first, shape (n, 4, 4)"""
    triangles: NDArray[np.int64]
    """4 or 1, shape (n,)"""
    numbers: NDArray[np.int64]
    """Number of the triangle at each corner, -1 where there is none, shape (n, 4)"""
    balloons: NDArray[np.int64]
    """Balloon of each quad, shape (n,)"""


def membrane_quads(model: Model) -> MembraneQuads:
    """Return the membrane quads of all balloons."""
    corners, rests, triangles, places, balloons, begin = [], [], [], [], [], 0
    numbers = np.asarray(model.membrane_corners.numpy(), dtype=np.int64).reshape(-1, 3)
    for balloon, membrane in enumerate(shape.membrane for shape in model.shapes):
        here = replace(membrane, corners=numbers[begin : begin + membrane.count])
        rows = here.quad_rows
        others = np.setdiff1d(np.arange(here.count), rows.ravel())
        alone = here.part(others)
        # (a, b, d), (a, b, c), (b, c, d) and (a, c, d), each turned until it begins with the corner it lies at
        at_corners = [here.part(rows[:, row]).turned(turns) for row, turns in ((1, 0), (0, 1), (3, 1), (2, 2))]
        corners += [np.stack([each.corners[:, 0] for each in at_corners], axis=1), alone.corners[:, [0, 1, 0, 2]]]
        rests += [np.stack([each.rests for each in at_corners], axis=1), _at_first(alone.rests)]
        places += [begin + rows[:, [1, 0, 3, 2]], np.pad(begin + others[:, None], ((0, 0), (0, 3)), constant_values=-1)]
        triangles += [4] * len(rows) + [1] * alone.count
        balloons += [balloon] * (len(rows) + alone.count)
        begin += membrane.count
    return MembraneQuads(
        np.concatenate(corners),
        np.concatenate(rests),
        np.array(triangles, dtype=np.int64),
        np.concatenate(places),
        np.array(balloons, dtype=np.int64),
    )


def _at_first(rests: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rest metrics of lone triangles, at their first corner, shape (n, 4, 4)."""
    padded = np.zeros((len(rests), 4, 4))
    padded[:, 0] = rests
    return padded


def _array(model: Model, values: Any, dtype: Any) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device=model.device)


MOST_FACES = 12
"""Largest number of faces at a particle: with more at some, most particles would wait for the few"""


def membrane_face_layout(model: Model, features: Features) -> MembraneFaceLayout | None:
    """Return the layout of membrane faces; None without one.

    There is none without membranes, with too many faces at a particle, or with springs that need a loop around a
    particle anyway.
    """
    if not features.membranes or features.rings:
        return None
    quads = membrane_quads(model)
    most = int(np.bincount(_particles_and_places(quads, 0)[0]).max())
    if most > MOST_FACES:
        return None
    triangles = int(quads.triangles.max())
    mixed = bool(quads.triangles.min() < triangles)
    corners = np.diff(model.face_offsets.numpy())
    all_there = len(quads.corners) == model.face_count and (corners == (4 if triangles == 4 else 3)).all()
    return MembraneFaceLayout(most, triangles, mixed, bool(features.measures_areas and all_there and not mixed))


def membrane_face_entries(model: Model, membrane_face: MembraneFaceLayout) -> int:
    """Return the number of entries that faces write, with the zero that pads."""
    return 4 * (membrane_face.room or len(membrane_quads(model).corners)) + 1


def membrane_face_table(model: Model, membrane_face: MembraneFaceLayout | None) -> Any:
    """Return the table of membrane faces for a layout; empty without one."""
    table = MembraneFaceTable()
    if membrane_face is None:
        return table
    quads, in_tile = membrane_quads(model), membrane_face.tile > 0
    particles, places = _particles_and_places(quads, membrane_face.room)
    counts = np.bincount(particles, minlength=model.particle_count)
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    fours, nothing = -(-membrane_face.slots // 4), membrane_face_entries(model, membrane_face) - 1
    in_slots = np.full((4 * fours, model.particle_count), nothing)
    in_slots[slot, particles] = places
    of_slots = in_slots.reshape(fours, 4, -1).swapaxes(1, 2)
    rests = quads.rests.transpose(1, 0, 2).reshape(-1, 4)
    table.corners = wp.array((VECTOR_BYTES if in_tile else 1) * quads.corners, dtype=wp.vec4i, device=model.device)
    table.rests = wp.array(rests, dtype=wp.vec4, device=model.device)
    if membrane_face.quads:
        table.sums = wp.array(sums_of(quads).reshape(-1, 4), dtype=wp.vec4, device=model.device)
    table.balloons = wp.array(quads.balloons, dtype=wp.int32, device=model.device)
    if model.softens:
        table.numbers = wp.array(np.maximum(quads.numbers, 0), dtype=wp.vec4i, device=model.device)
    unit = PLACE_BYTES if in_tile else 1
    table.places = wp.array(unit * of_slots.reshape(-1, 4), dtype=wp.vec4i, device=model.device)
    return table


def sums_of(quads: MembraneQuads) -> np.ndarray:
    """Return the rest sums of quads, see `Sums`, with a k of 1, shape (3, n, 4).

    A triangle's shape at rest are the cotangents of the angles opposite its edges, and the root of its det G.
    """
    g11, g12, g22, _ = np.moveaxis(quads.rests, -1, 0)  # each of the triangles at all corners
    last = np.sqrt(g11 * g22 - g12 * g12)
    by_first, by_second, by_third = (g11 + g12) / last, (g22 + g12) / last, -g12 / last
    along = by_first + np.roll(by_second, -1, axis=1)
    across = by_third + np.roll(by_third, 2, axis=1)
    # the square of a diagonal is at most twice those of both edges beside it
    more = 2.0 * np.maximum(by_third, 0.0)
    first, second = np.maximum(by_first, 0.0) + more, np.maximum(by_second, 0.0) + more
    of_ab = np.stack([first[:, 0], second[:, 1], first[:, 2], second[:, 3]]).max(axis=0)
    of_bc = np.stack([second[:, 0], first[:, 1], second[:, 2], first[:, 3]]).max(axis=0)
    last_row = np.stack([across[:, 1], across[:, 0], of_ab, of_bc], axis=1)
    return np.stack([along, last**-1.5, last_row])


def _particles_and_places(quads: MembraneQuads, room: int) -> tuple[np.ndarray, np.ndarray]:
    """Return particle and place of each face at each particle, sorted by particle.

    Args:
        room: Number of faces that there are places for, if more than there are.
    """
    count = len(quads.corners)
    there = np.ones((4, count), dtype=bool)
    there[2] = quads.triangles == 4
    corner, face = np.nonzero(there)
    particles = quads.corners[face, corner]
    order = np.argsort(particles, kind="stable")
    return particles[order], ((room or count) * corner + face)[order]
