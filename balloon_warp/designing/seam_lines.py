"""Seams as lines: the edges between the same two panels, one after the other, on both sides."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.panels import Panels
from balloon_warp.mesh.components import component_labels

Values = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class SeamLine:
    """Seam, from end to end."""

    sides: Numbers
    """Vertices of the panels along both sides, shape (2, k)"""
    forward: tuple[bool, bool]
    """Whether the panel of a side is on the left of it"""

    def marks(self, flat: Values, spacing: float) -> tuple[Values, Values]:
        """Places that meet when it is sewn, evenly along it, and the ways out of the panels, shapes (2, c, 2).

        Args:
            flat: of the panels' vertices [m], shape (m, 2).
            spacing: about how far places are from each other [m].
        """
        lines = flat[self.sides]
        ways = np.diff(lines, axis=1)
        lengths = np.linalg.norm(ways, axis=2)
        along = np.append(0.0, np.cumsum(lengths.mean(axis=0)))
        count = max(1, round(along[-1] / spacing) - 1)
        where = along[-1] * np.arange(1, count + 1) / (count + 1)
        edge = np.clip(np.searchsorted(along, where, side="right") - 1, 0, len(along) - 2)
        part = (where - along[edge]) / np.maximum(along[edge + 1] - along[edge], 1e-30)
        places = lines[:, edge] + part[None, :, None] * ways[:, edge]
        sign = np.where(self.forward, 1.0, -1.0)[:, None, None]
        out = sign * np.stack([ways[:, edge, 1], -ways[:, edge, 0]], axis=2)
        return places, out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-30)


def seam_lines(panels: Panels) -> list[SeamLine]:
    """Return all seams, each from where it meets others, or ends, to the next such place."""
    ends = panels.sewn_to[panels.seams[:, 0]]  # of both sides the same
    sides = np.sort(panels.of_vertices[panels.seams[:, :, 0]], axis=1)
    degrees = np.bincount(ends.ravel(), minlength=panels.mesh.vertex_count)
    by_vertex: dict[int, list[int]] = {}
    for edge, pair in enumerate(ends.tolist()):
        for vertex in pair:
            by_vertex.setdefault(vertex, []).append(edge)
    joins = [
        edges for vertex, edges in by_vertex.items()
        if degrees[vertex] == 2 and (sides[edges[0]] == sides[edges[1]]).all()
    ]  # fmt: skip
    first, second = np.array(joins, dtype=np.int64).reshape(-1, 2).T
    labels = component_labels(len(ends), first, second)
    return [_line(panels, ends, np.flatnonzero(labels == label)) for label in np.unique(labels)]


def _line(panels: Panels, ends: Numbers, edges: Numbers) -> SeamLine:
    """Return the edges of a seam in order."""
    left = {int(edge) for edge in edges}
    count = np.bincount(ends[edges].ravel())
    odd = np.flatnonzero(count == 1)
    here = int(odd[0]) if len(odd) else int(ends[edges[0], 0])
    order: list[tuple[int, bool]] = []
    while left:
        edge = next(edge for edge in sorted(left) if here in ends[edge])
        turned = int(ends[edge, 1]) == here
        here = int(ends[edge, 0 if turned else 1])
        order.append((edge, turned))
        left.remove(edge)
    # Both sides as they are at the first edge; which of the two comes first may change from edge to edge.
    lines: list[list[int]] = [[], []]
    last: list[int | None] = [None, None]
    for edge, turned in order:
        pair = panels.seams[edge][:, ::-1] if turned else panels.seams[edge]
        swap = last[0] is not None and int(pair[0, 0]) != last[0]
        for side, (begin, end) in enumerate(pair[::-1].tolist() if swap else pair.tolist()):
            lines[side] += [begin, end] if last[side] is None else [end]
            last[side] = end
    edge, turned = order[0]
    ways = panels.forward[edge] ^ turned
    return SeamLine(np.array(lines), (bool(ways[0]), bool(ways[1])))
