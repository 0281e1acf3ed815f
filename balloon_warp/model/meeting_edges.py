"""Edges of balloons that touch edges: sharp ones, and all of balloons that may fold anywhere or touch themselves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.folded import bends_freely, is_folded
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.sharp_edges import sharp_edges
from balloon_warp.scene import Balloon, Scene


def edges_meet(scene: Scene, shapes: Sequence[BalloonShape]) -> bool:
    """Return whether edges of balloons may touch others."""
    if not scene.touches:
        return False
    have = [len(edges) > 0 for edges in meeting_edges(scene, shapes)]
    return any(have) if scene.touches_itself else sum(have) > 1


def meeting_edges(scene: Scene, shapes: Sequence[BalloonShape]) -> list[NDArray[np.int64]]:
    """Return the ends of the edges of each balloon that touch edges, each of shape (E, 2)."""
    said = scene.touch.edges if scene.touch else "auto"
    if said is False:
        return [np.zeros((0, 2), dtype=np.int64) for _ in shapes]
    takes_all = said is True or scene.touches_itself
    every = [takes_all or _may_fold(each, shape) for each, shape in zip(scene.balloon, shapes, strict=True)]
    return [_all_edges(shape) if own else sharp_edges(shape.mesh) for shape, own in zip(shapes, every, strict=True)]


def edges_by_leaf(
    triangles: NDArray[np.int64], leaves: NDArray[np.int64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return edges in the order of the triangles that have them first, and the leaf of each, shape (E, 2) and (E,).

    Args:
        leaves: that of each triangle, ascending.
    """
    count = int(triangles.max(initial=0)) + 1
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2) @ [count, 1]
    keys, firsts = np.unique(sides, return_index=True)
    own = firsts[np.searchsorted(keys, np.sort(edges, axis=1) @ [count, 1])]
    order = np.argsort(own, kind="stable")
    return edges[order], leaves[own[order] // 3]


def _may_fold(balloon: Balloon, shape: BalloonShape) -> bool:
    """Return whether a balloon may fold anywhere: it bends freely, and is folded, flat or open at the start."""
    return bends_freely(balloon) and (not shape.closed or is_folded(shape.mesh))


def _all_edges(shape: BalloonShape) -> NDArray[np.int64]:
    """Return all edges of a mesh, as contact cuts its faces into triangles."""
    triangles = triangles_of(shape.mesh)
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
