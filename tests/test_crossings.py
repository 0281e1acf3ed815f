"""Surfaces that would cross themselves are found and held back."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from meshes import quad_sphere

from balloon_warp.designing.crossings import NearPairs, crossing_count
from balloon_warp.designing.uncrossed import uncrossed
from balloon_warp.mesh.topology import mesh_edges

BALL = quad_sphere(6)


def means():
    ends, count = mesh_edges(BALL).ends, BALL.vertex_count
    both = np.concatenate([ends, ends[:, ::-1], np.stack([np.arange(count)] * 2, axis=1)])
    beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
    return sparse.diags(1.0 / np.asarray(beside.sum(axis=1)).ravel()) @ beside


def through() -> np.ndarray:
    """Return moves that push the top of the ball through its bottom, and its sides a little."""
    points = BALL.points - BALL.points.mean(axis=0)
    size = np.abs(points).max()
    top = points[:, 1] > 0.8 * size
    return np.where(top[:, None], [0.0, -2.2 * size, 0.0], 0.01 * points)


def test_moves_are_held_back_only_where_the_surface_would_cross_itself():
    moves = through()
    assert crossing_count(replace(BALL, points=BALL.points + moves)) > 0
    held = uncrossed(BALL, moves, means())
    assert crossing_count(replace(BALL, points=BALL.points + held)) == 0
    same = np.all(held == moves, axis=1)
    assert 0.2 < same.mean() < 1.0  # the sides go on
    assert (np.linalg.norm(held, axis=1) <= np.linalg.norm(moves, axis=1) + 1e-12).all()


def test_moves_that_cross_nothing_stay_as_they_are():
    moves = 0.1 * BALL.points
    np.testing.assert_array_equal(uncrossed(BALL, moves, means()), moves)


def test_pairs_that_may_cross_are_those_that_do():
    moves = through()
    near = NearPairs.of(BALL, float(np.linalg.norm(moves, axis=1).max()))
    there = BALL.points + moves
    assert near.crossing(there).sum() == crossing_count(replace(BALL, points=there))
