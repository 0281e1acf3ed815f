"""Quads around particles in order, as the neighbors that they share."""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.tables import SLICE, RingTable
from balloon_warp.model import Model
from balloon_warp.schedules.slices import slices_of
from balloon_warp.schedules.spring_ends import SpringEnds, neighbors_in_slots, spring_ends

Ring = tuple[NDArray[np.int64], NDArray[np.int64]]
"""The particles around each particle, along edges and across quads, in turns: e0 s0 e1 s1 ...; -1 where there are no
more. Each of shape (most, particle_count)"""
STRUCTURAL, SHEAR, FLEXION = range(3)
_FOUND: WeakKeyDictionary[Model, Ring | None] = WeakKeyDictionary()


def quad_rings(model: Model) -> Ring | None:
    """Return the rings of quads around particles, or None, found once for each model.

    Every particle must have one whose neighbors are those of its structural and of its shear springs: on closed
    surfaces of quads.
    """
    if model not in _FOUND:
        _FOUND[model] = _rings_of(model)
    return _FOUND[model]


def least_valence(ring: Ring) -> int:
    """Return the least number of quads around a particle."""
    return int((ring[STRUCTURAL] >= 0).sum(axis=0).min())


def _rings_of(model: Model) -> Ring | None:
    if (np.diff(model.face_offsets.numpy()) != 4).any():
        return None
    count = model.particle_count
    corners = np.asarray(model.face_particles.numpy(), dtype=np.int64).reshape(-1, 4)
    particle, after, opposite, before = np.concatenate([np.roll(corners, -turn, axis=1) for turn in range(4)]).T
    quads = np.bincount(particle, minlength=count)
    by_edge = np.argsort(count * particle + before, kind="stable")
    edges = (count * particle + before)[by_edge]
    wanted = count * particle + after
    place = np.minimum(np.searchsorted(edges, wanted), len(edges) - 1)
    if not quads.all() or (np.diff(edges) == 0).any() or (edges[place] != wanted).any():
        return None
    following = by_edge[place]
    _, first = np.unique(particle, return_index=True)
    along = np.full((quads.max(), count), -1)
    across = np.full_like(along, -1)
    quad = first
    for turn in range(len(along)):
        going = turn < quads
        if turn and (going & (quad == first)).any():
            return None  # two fans meet in a particle
        along[turn, going], across[turn, going] = before[quad[going]], opposite[quad[going]]
        quad = np.where(going, following[quad], quad)
    ends = spring_ends(model)
    same = _same(ends, along, STRUCTURAL) and _same(ends, across, SHEAR)
    return (along, across) if same else None


def _same(ends: SpringEnds, around: NDArray[np.int64], kind: int) -> bool:
    """Return whether neighbors are the particles' neighbors by springs of a kind."""
    count = around.shape[1]
    particle, neighbor = _entries(around)
    of_kind = ends.kind == kind
    return np.array_equal(np.sort(count * particle + neighbor), count * ends.particle[of_kind] + ends.neighbor[of_kind])


def _entries(around: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each particle and a neighbor of it, sorted by particle and in the order of its ring."""
    turns = around.T
    particle = np.repeat(np.arange(len(turns)), turns.shape[1]).reshape(turns.shape)
    return particle[turns >= 0], turns[turns >= 0]


def ring_table(model: Model, ends: SpringEnds, ring: Ring | None, springs_vary: bool, in_block: bool) -> Any:
    """Return the rings as kernels read them.

    Args:
        in_block: for a block, whose worlds have so few particles that 16 bits number them.
    """
    table = RingTable()
    if ring is None:
        return table
    along, across = ring
    flexion = neighbors_in_slots(ends, FLEXION)
    count = model.particle_count
    around, opposite = _entries(across)
    quads = np.bincount(around, minlength=count)
    turn = np.arange(len(around)) - np.repeat(np.cumsum(quads) - quads, quads)
    next_along = along[(turn + 1) % quads[around], around]
    bent, other = _pairs_of(flexion)
    pairs = np.bincount(bent, minlength=count)

    particle = np.concatenate([around, bent])
    neighbors = np.concatenate([np.stack([opposite, next_along], axis=1), other])
    kinds = np.repeat([[SHEAR, STRUCTURAL], [FLEXION, FLEXION]], [len(around), len(bent)], axis=0)
    in_order = np.argsort(particle, kind="stable")
    particle, neighbors, kinds = particle[in_order], neighbors[in_order], kinds[in_order]
    slices = slices_of(particle, quads + pairs, 1)

    key = count * (3 * ends.particle + ends.kind) + ends.neighbor
    spring = np.searchsorted(key, count * (3 * particle[:, None] + kinds) + neighbors)
    there = neighbors != particle[:, None]
    spring[~there] = 0
    others = np.repeat(slices.owners[:, None], 2, axis=1)
    others[slices.places] = neighbors
    lengths, scales = np.zeros((2, len(slices.owners), 2), dtype=np.float32)
    lengths[slices.places] = np.where(there, ends.rest_length[spring], 0.0)
    scales[slices.places] = np.where(there, ends.scale[spring], 0.0)
    first = slices.offsets[np.arange(count) // SLICE] + np.arange(count) % SLICE

    def array(values: NDArray, dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device=model.device)

    table.places = array(np.stack([first, quads, pairs, along[0]], axis=1), wp.vec4i)
    if in_block:
        table.packed_ends = array((others[:, 0] | others[:, 1] << 16).astype(np.uint32).view(np.int32), wp.int32)
    else:
        table.ends = array(others, wp.vec2i)
    table.lengths = array(lengths, wp.vec2)
    if springs_vary:
        table.scales = array(scales, wp.vec2)
    return table


def _pairs_of(neighbors: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the neighbors in slots two at a time: particles, and two neighbors of each, shape (pair_count, 2).

    -1 marks an empty slot; where there is one neighbor only, the second is the particle itself.
    """
    slots, count = neighbors.shape
    even = np.concatenate([neighbors, np.full((slots % 2, count), -1)])
    two = even.T.reshape(count, -1, 2)
    particle = np.broadcast_to(np.arange(count)[:, None], two.shape[:2])
    there = two[..., 0] >= 0
    return particle[there], np.where(two[there] < 0, particle[there][:, None], two[there])
