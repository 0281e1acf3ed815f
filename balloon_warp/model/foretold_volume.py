"""Prediction of a balloon's volume under a pressure, on the host in float64."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import signed_volume, vertex_vector_areas
from balloon_warp.model.shape import BalloonShape

MOST_VERTICES = 12_000
"""Largest number of vertices of a balloon whose volume is predicted: with more, it would take longer than to begin"""
ROUNDS = 60
KEPT = 6
"""Number of iterations that the next one is extrapolated from"""
CLOSE = 2.0e-3
"""Change of the volume in `CALM` iterations at convergence, over the volume at the start"""
CALM = 4
ANCHOR = 1.0e-4
"""Regularization that makes the springs' Laplacian invertible, over its mean diagonal"""


def volume_under(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> float | None:
    """Find the volume within the faces that are pushed, in balance, over that at the start.

    None where there is none, or where it would take long.

    Each round solves for the places at which the springs, each at its rest length along the way that it has now, and
    the pressure's forces of now are in balance: as projective dynamics does (Bouaziz et al. 2014), with a step without
    end. Rounds are extrapolated from those before (Anderson 1965).

    Args:
        constants: of the kinds of springs [N/m], shape (3,).
        pressure: [Pa].
    """
    points, start = shape.mesh.points, signed_volume(shape.skin)
    if not start or not shape.encloses or len(points) > MOST_VERTICES:
        return None
    round_of = _rounds(shape, constants[shape.springs.kind] * shape.stiffness_scale, pressure)
    volumes: list[float] = []
    places: list[NDArray[np.float64]] = []
    moves: list[NDArray[np.float64]] = []
    for _ in range(ROUNDS):
        places, moves = [*places[-KEPT:], points.ravel()], [*moves[-KEPT:], round_of(points).ravel()]
        points = _extrapolated(places, moves).reshape(-1, 3)
        volumes.append(signed_volume(replace(shape.skin, points=points)) / start)
        if not np.isfinite(volumes[-1]):
            return None
        if len(volumes) > CALM and np.ptp(volumes[-CALM:]) < CLOSE:
            return volumes[-1]
    return None


def _rounds(shape: BalloonShape, constants: NDArray[np.float64], pressure: float) -> Any:
    """Make the function that gives how far each particle moves in a round, from the points of all [m]."""
    from scipy.sparse import coo_array, csc_matrix, diags_array
    from scipy.sparse.linalg import splu

    springs, mesh, count = shape.springs, shape.skin, shape.mesh.vertex_count
    rows, signs = np.arange(springs.count), np.ones(springs.count)
    ends = np.concatenate([springs.pairs[:, 0], springs.pairs[:, 1]])
    entries = np.concatenate([-signs, signs]), (np.concatenate([rows, rows]), ends)
    differences = coo_array(entries, shape=(springs.count, count)).tocsr()
    back = differences.T.tocsr()
    laplacian = back @ diags_array(constants) @ differences
    held = ANCHOR * laplacian.diagonal().mean() or 1.0
    free = shape.mass_share > 0.0
    solver = splu(
        csc_matrix(laplacian + diags_array(np.where(free, held, 1e9 * held / ANCHOR))),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )

    def moves(points: NDArray[np.float64]) -> NDArray[np.float64]:
        ways = differences @ points
        lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-30)
        pulls = back @ ((constants * (1.0 - springs.rest_lengths / lengths))[:, None] * ways)
        pushes = pressure * vertex_vector_areas(replace(mesh, points=points))
        return solver.solve(np.where(free[:, None], pushes - pulls, 0.0))

    return moves


def _extrapolated(places: list[NDArray[np.float64]], moves: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Extrapolate iterations to the place where their moves vanish; with one, return the last place, moved."""
    if len(moves) == 1:
        return places[0] + moves[0]
    between = np.diff(np.array(moves), axis=0)
    products = between @ between.T
    products += 1e-12 * np.trace(products) * np.eye(len(products))
    parts = np.linalg.lstsq(products, between @ moves[-1], rcond=None)[0]
    return places[-1] + moves[-1] - parts @ (np.diff(np.array(places), axis=0) + between)
