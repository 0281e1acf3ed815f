"""Quads around particles in order, as the neighbors that they share."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import Model
from balloon_warp.schedules.tables import SpringEnds

Ring = tuple[NDArray[np.int64], NDArray[np.int64]]
"""The particles around each particle, along edges and across quads, in turns: e0 s0 e1 s1 ...; -1 where there are no
more. Each of shape (most, particle_count)"""


def quad_rings(model: Model, ends: SpringEnds) -> Ring | None:
    """The rings, if every particle has one whose neighbors are those of its structural and of its shear springs: on
    closed surfaces of quads."""
    offsets = model.face_offsets.numpy()
    if (np.diff(offsets) != 4).any():
        return None
    corners = model.face_particles.numpy().reshape(-1, 4)
    quads_from: list[dict[int, tuple[int, int]]] = [{} for _ in range(model.particle_count)]
    for turn in range(4):
        for particle, after, opposite, before in np.roll(corners, -turn, axis=1).tolist():
            if before in quads_from[particle]:
                return None
            quads_from[particle][before] = opposite, after
    most = int(ends.by_kind[:, :2].max())
    along = np.full((most, model.particle_count), -1)
    across = np.full((most, model.particle_count), -1)
    for particle, quads in enumerate(quads_from):
        edges, diagonals = _walk(quads)
        if not _same(ends, particle, 0, edges) or not _same(ends, particle, 1, diagonals):
            return None
        along[: len(edges), particle], across[: len(diagonals), particle] = edges, diagonals
    return along, across


def _walk(quads: dict[int, tuple[int, int]]) -> tuple[list[int], list[int]]:
    """From quad to quad around a particle, as long as there is a next."""
    edges: list[int] = []
    diagonals: list[int] = []
    edge = next(iter(quads), -1)
    while edge in quads and edge not in edges:
        edges.append(edge)
        opposite, edge = quads[edge]
        diagonals.append(opposite)
    return edges, diagonals


def _same(ends: SpringEnds, particle: int, kind: int, neighbors: list[int]) -> bool:
    """Whether these are a particle's neighbors by springs of a kind."""
    begin, end = np.searchsorted(ends.particle, [particle, particle + 1])
    of_kind = ends.kind[begin:end] == kind
    return sorted(neighbors) == sorted(ends.neighbor[begin:end][of_kind].tolist())
