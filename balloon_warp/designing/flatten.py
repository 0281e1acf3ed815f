"""Panels laid flat with the least strain, and seams as long on both sides.

A conformal map begins (Levy and others 2002, least squares); then Gauss and Newton's steps lessen the squared strain of
the film between the flat panel and the surface, where a difference between the sides of a seam counts far more.
"""

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from balloon_warp.designing.panels import Panels
from balloon_warp.errors import InputError

Values = NDArray[np.float64]
SEAM = 100.0
"""Weight of a seam's strain over that of the film"""
MOST_STEPS = 60
GAINED = 1.0e-6
"""Least relative gain in the sum of squares for another step"""


def flattened(panels: Panels, points: Values, flat: Values | None = None) -> Values:
    """Return the places of the panels' vertices in the plane, shape (m, 2).

    Args:
        points: of the sewn mesh [m], shape (n, 3).
        flat: to begin with.

    Raises:
        InputError: a panel would fold over.
    """
    frames = _frames(points[panels.sewn_to][panels.corners])
    here = _conformal(panels, frames) if flat is None else flat
    here = _relaxed(panels, frames, here)
    sides = here[panels.corners]
    folded = _cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]) <= 0.0
    if folded.any():
        panel = panels.of_faces[folded][0]
        raise InputError(
            f"panels: panel {panel + 1}, of {(panels.of_faces == panel).sum()} triangles, is too curved and folds over "
            "when flattened; expected more seams through it"
        )
    return here


def seam_lengths(panels: Panels, flat: Values) -> Values:
    """Return the lengths of both sides of each seam's edge [m], shape (s, 2)."""
    ends = flat[panels.seams]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def _frames(places: Values) -> Values:
    """Return the triangles in planes of their own, the first edge along x: edges as columns, shape (t, 2, 2)."""
    first, second = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    length = np.linalg.norm(first, axis=1)
    along = (first * second).sum(axis=1) / length
    across = np.linalg.norm(np.cross(first, second), axis=1) / length
    return np.stack([np.stack([length, along], 1), np.stack([np.zeros(len(length)), across], 1)], axis=1)


def _conformal(panels: Panels, frames: Values) -> Values:
    """Return each panel conformal, as large as it is."""
    inverse, areas = np.linalg.inv(frames), 0.5 * np.linalg.det(frames)
    # The slopes of linear functions in a triangle, by its corners' values: shape (t, 2, 3).
    slopes = np.einsum("tij,ki->tjk", inverse, np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]))
    slopes *= np.sqrt(areas)[:, None, None]
    count, rows = len(panels.sewn_to), np.arange(len(frames))
    triples = np.repeat(rows, 3), panels.corners.ravel()
    dx, dy = (sparse.csr_matrix((slopes[:, k].ravel(), triples), shape=(len(rows), count)) for k in range(2))
    both = sparse.csc_matrix(sparse.bmat([[dx, -dy], [dy, dx]]))
    pinned = np.concatenate([_far_apart(panels, panel) for panel in range(panels.count)])
    values = np.concatenate([np.tile([0.0, 1.0], panels.count), np.zeros(len(pinned))])
    held = np.concatenate([pinned, pinned + count])
    free = np.setdiff1d(np.arange(2 * count), held)
    normal = (both[:, free].T @ both[:, free]).tocsc()
    found = np.zeros(2 * count)
    found[held] = values
    found[free] = splu(normal).solve(-both[:, free].T @ (both[:, held] @ values))
    flat = found.reshape(2, count).T
    sides = flat[panels.corners]
    now = np.abs(0.5 * _cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]))
    ratio = np.bincount(panels.of_faces, areas) / np.bincount(panels.of_faces, now)
    return flat * np.sqrt(ratio)[panels.of_vertices][:, None]


def _far_apart(panels: Panels, panel: int) -> NDArray[np.int64]:
    """Return two vertices of a panel's border, as far from each other as can be."""
    border = panels.borders[panel]
    places = panels.mesh.points[panels.sewn_to[border]]
    first = int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())
    return border[[first, int(np.linalg.norm(places - places[first], axis=1).argmax())]]


def _relaxed(panels: Panels, frames: Values, flat: Values) -> Values:
    """Return the flat places with the least strain (Levenberg and Marquardt)."""
    damping, (residual, slopes) = 1.0e-3, _strains(panels, frames, flat)
    before = float(residual @ residual)
    for _ in range(MOST_STEPS):
        normal, gradient = slopes.T @ slopes, slopes.T @ residual
        unit = float(normal.diagonal().mean())
        found = None
        while damping < 1.0e6:
            step = splu((normal + damping * unit * sparse.identity(len(gradient))).tocsc()).solve(-gradient)
            there = flat + step.reshape(-1, 2)
            residual, slopes = _strains(panels, frames, there)
            if float(residual @ residual) < before:
                found = there
                break
            damping *= 10.0
        if found is None:
            return flat
        flat, damping, after = found, max(damping / 10.0, 1.0e-10), float(residual @ residual)
        if after > (1.0 - GAINED) * before:
            return flat
        before = after
    return flat


def _strains(panels: Panels, frames: Values, flat: Values) -> tuple[Values, Any]:
    """Return the residuals, and their derivatives by the flat places.

    They are Green's strains of triangles, weighted by the roots of their areas, and the differences of the squared
    lengths of both sides of seams.
    """
    edges, corners = flat[panels.corners], panels.corners
    edges = (edges[:, 1:] - edges[:, :1]).transpose(0, 2, 1)  # as columns
    inverse, root = np.linalg.inv(frames), np.sqrt(0.5 * np.linalg.det(frames))
    turn = edges @ inverse
    squared = np.einsum("tki,tkj->tij", turn, turn)
    weight = np.array([0.5, 0.5, np.sqrt(0.5)])
    parts = np.stack([squared[:, 0, 0] - 1.0, squared[:, 1, 1] - 1.0, squared[:, 0, 1]], axis=1)
    films = parts * weight * root[:, None]
    # By corners: the slope of the map is linear in their places.
    by_corner = np.einsum("tij,ki->tkj", inverse, np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]))
    slopes = np.stack([
        2.0 * by_corner[:, :, 0, None] * turn[:, None, :, 0],
        2.0 * by_corner[:, :, 1, None] * turn[:, None, :, 1],
        by_corner[:, :, 0, None] * turn[:, None, :, 1] + by_corner[:, :, 1, None] * turn[:, None, :, 0],
    ], axis=1) * (weight * root[:, None])[:, :, None, None]  # fmt: skip
    count = len(corners)
    rows = np.broadcast_to((3 * np.arange(count)[:, None] + np.arange(3))[:, :, None, None], slopes.shape)
    columns = np.broadcast_to((2 * corners[:, :, None] + np.arange(2))[:, None], slopes.shape)
    of_seams, seam_values, seam_rows, seam_columns = _seam_strains(panels, flat)
    matrix = sparse.csr_matrix(
        (
            np.concatenate([slopes.ravel(), seam_values]),
            (np.concatenate([rows.ravel(), 3 * count + seam_rows]), np.concatenate([columns.ravel(), seam_columns])),
        ),
        shape=(3 * count + len(of_seams), 2 * len(flat)),
    )
    return np.concatenate([films.ravel(), of_seams]), matrix


def _seam_strains(panels: Panels, flat: Values) -> tuple[Values, Values, Any, Any]:
    """Return the differences between both sides of each seam's edge, and derivatives: values, rows and columns."""
    ends = flat[panels.seams]
    ways = ends[:, :, 1] - ends[:, :, 0]
    sewn = panels.mesh.points[panels.sewn_to[panels.seams[:, 0]]]
    length = np.linalg.norm(sewn[:, 1] - sewn[:, 0], axis=1)
    weight = SEAM / (2.0 * length)
    squares = (ways**2).sum(axis=2)
    signs = np.array([1.0, -1.0])[:, None] * np.array([-1.0, 1.0])  # of sides and ends
    values = 2.0 * weight[:, None, None, None] * signs[:, :, None] * ways[:, :, None, :]
    rows = np.broadcast_to(np.arange(len(ways))[:, None, None, None], values.shape)
    columns = np.broadcast_to(2 * panels.seams[..., None] + np.arange(2), values.shape)
    return weight * (squares[:, 0] - squares[:, 1]), values.ravel(), rows.ravel(), columns.ravel()


def _cross(a: Values, b: Values) -> Values:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
