"""The airbag: a flat square cushion, and the same folded in half four times."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh

WIDTH = 1.0
"""Of the flat airbag [m]"""
PANEL_QUADS = 2
"""Quads across each of the four panels a side; one more lies between two panels, and wraps around what is in a fold"""
QUADS = 4 * PANEL_QUADS + 3
GAP = 0.002
"""Distance between layers [m]"""
FOLDS = ((0, 2), (1, 2), (0, 1), (1, 1))
"""Axis of each fold, and the panel behind which it is: in half across, in half along, and both again"""
PANEL = PANEL_QUADS * WIDTH / QUADS - 20 * GAP
"""Width of a folded panel [m]; the outermost layer reaches farther by what lies in its fold, and is not stretched"""


def airbag() -> PolygonMesh:
    """Return two square sheets 1 m wide, joined at their rims, folded four times: 32 layers, 2 mm apart.

    No layer touches another, and no face is larger than it is flat.
    """
    flat = airbag_flat()
    columns = np.rint(flat.points[:, [0, 2]] / WIDTH * QUADS + 0.5 * QUADS).astype(int)
    panels = np.minimum(columns // (PANEL_QUADS + 1), 3)
    within = (columns - panels * (PANEL_QUADS + 1)) / PANEL_QUADS
    places = PANEL * (panels + within)
    layers = np.sign(flat.points[:, 1]) * 0.5 + 0.5  # that of the seam is between both
    count = 2
    for axis, behind in FOLDS:
        places, layers, panels = _folded(places, layers, panels, axis, behind, count)
        count *= 2
    return replace(flat, points=np.column_stack([places[:, 0], GAP * layers, places[:, 1]]))


def _folded(
    places: NDArray[np.float64],
    layers: NDArray[np.float64],
    panels: NDArray[np.int_],
    axis: int,
    behind: int,
    count: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int_]]:
    """Fold what is behind a panel over the rest.

    Args:
        places: in the plane, shape (n, 2) [m].
        layers: from below, shape (n,).
        panels: along both axes, shape (n, 2).
        behind: number of panels before the crease.
        count: number of layers.
    """
    crease = behind * PANEL
    along = places[:, axis]
    over = panels[:, axis] >= behind
    mirrored = np.where(over, 2.0 * crease - along, along)
    near = np.clip(1.0 - (crease - mirrored) / PANEL, 0.0, 1.0)
    places, panels = places.copy(), panels.copy()
    places[:, axis] = mirrored + near * GAP * (count - 1 - layers)  # what is below wraps around what is above
    panels[over, axis] = 2 * behind - 1 - panels[over, axis]
    return places, np.where(over, 2 * count - 1 - layers, layers), panels


def airbag_flat() -> PolygonMesh:
    """Return the airbag flat, as it was sewn: its sheets are in one plane, a hair apart."""
    steps = QUADS + 1
    x, z = np.meshgrid(*[np.linspace(-0.5, 0.5, steps) * WIDTH] * 2, indexing="ij")
    rim = (np.maximum(np.abs(x), np.abs(z)) > 0.499 * WIDTH).ravel()
    top = np.arange(steps * steps)
    bottom = np.where(rim, top, len(top) + np.cumsum(~rim) - 1)
    flat = np.stack([x.ravel(), np.where(rim, 0.0, 0.5 * GAP), z.ravel()], axis=1)
    below = flat[~rim] * [1.0, -1.0, 1.0]
    quads = np.concatenate([_quads(top.reshape(steps, steps).T), _quads(bottom.reshape(steps, steps))])
    return PolygonMesh(
        points=np.concatenate([flat, below]),
        face_vertex_counts=np.full(len(quads), 4, dtype=np.int32),
        face_vertex_indices=quads.astype(np.int32).ravel(),
    )


def _quads(vertices: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return the quads of a grid of vertices, shape (quad_count, 4)."""
    grid = vertices[:-1, :-1], vertices[1:, :-1], vertices[1:, 1:], vertices[:-1, 1:]
    return np.stack(grid, axis=-1).reshape(-1, 4)
