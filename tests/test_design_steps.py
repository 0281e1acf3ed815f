"""Steps of designs: smooth, and such that moulds keep their gaps."""

from dataclasses import replace

import numpy as np
from meshes import quad_sphere

from balloon_warp.designing.descent import Reached, begin, descend
from balloon_warp.designing.gaps import Gaps
from balloon_warp.designing.job import Job
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.mould import MouldProblem, ThicknessProblem
from balloon_warp.designing.of_latex import STALLED, _descended, _film
from balloon_warp.designing.response import Response
from balloon_warp.designing.smooth_step import SmoothAim, Smoothing, smooth_step
from balloon_warp.designing.target import target_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.scene import Material

BALL = quad_sphere(3)
TRIANGLES = Ruler(BALL).triangles
EDGE = float(np.linalg.norm(np.diff(BALL.points[mesh_edges(BALL).ends], axis=1), axis=2).mean())


def squashed(height: float) -> PolygonMesh:
    return replace(BALL, points=BALL.points * [1.0, 1.0, height])


class Direct:
    """Response of particles that move as the design does."""

    def moves(self, change: np.ndarray) -> np.ndarray:
        return change

    def transposed(self, moves: np.ndarray) -> np.ndarray:
        return moves


def aim_of(error: np.ndarray, gaps: Gaps, damping: float) -> SmoothAim:
    smoothing = Smoothing(mesh_edges(BALL).ends, BALL.vertex_count)
    return SmoothAim(error, Ruler(BALL).squares, smoothing, np.full(error.size, EDGE), gaps, damping)


def test_gaps_change_as_their_derivatives_say():
    """The widths of a flat ball's gaps change with random moves by central differences' slopes within a millionth."""
    flat = squashed(0.05)
    moves = np.random.default_rng(0).standard_normal(flat.points.shape)
    gaps = Gaps.of(flat, flat, TRIANGLES, EDGE)
    step = 1e-6
    widths = [
        Gaps.of(replace(flat, points=flat.points + side * step * moves), flat, TRIANGLES, EDGE).widths
        for side in (1, -1)
    ]
    slopes = (widths[0] - widths[1]) / (2.0 * step)
    triangles = len(TRIANGLES)
    assert len(gaps.widths) > triangles  # sides that face each other, too
    found = gaps.widening @ moves.ravel()
    np.testing.assert_allclose(found[-triangles:], slopes[-triangles:], rtol=1e-6, atol=1e-6)
    assert (gaps.widths[:-triangles] < gaps.least[:-triangles]).mean() > 0.5


def test_a_step_does_not_close_a_gap():
    """A step that would flatten a flat ball to nothing leaves most of the least thickness, and without gaps none."""
    flat = squashed(0.3)
    error = flat.points * [0.0, 0.0, -1.0]
    gaps = Gaps.of(flat, flat, TRIANGLES, EDGE)
    change = smooth_step(Direct(), aim_of(error, gaps, 1e-6))  # pyright: ignore
    facing = slice(0, len(gaps.widths) - len(TRIANGLES))
    left = (gaps.widths + gaps.widening @ change)[facing]
    assert left.min() > 0.6 * gaps.least[facing].min()
    closed = smooth_step(Direct(), aim_of(error, replace(gaps, least=-np.ones(len(gaps.least))), 1e-6))  # pyright: ignore
    assert (gaps.widths + gaps.widening @ closed)[facing].min() < 0.05 * EDGE


def test_a_smooth_step_is_that_of_dense_least_squares(tmp_path):
    """The step leaves as much of the error as dense solutions, with the damping's unit known within a factor of 4."""
    target = target_of(replace(BALL, points=BALL.points * [1.0, 1.0, 1.3]), 0.2)
    job = Job(target, "latex", 1.5, "tension", 2e-4, tmp_path, 1, "cpu", False, print)
    problem = MouldProblem(job.ruler, _film(job, Material(preset="latex", thickness=2e-4)), 1.5)
    balance = problem.balance(problem.plain)
    points = balance.settle(target.points)
    assert points is not None
    response = Response.of(balance, points, problem.by_design(balance, points))
    mould = replace(target, points=problem.plain.reshape(-1, 3))
    aim = aim_of(target.points - points, Gaps.of(mould, mould, TRIANGLES, problem.edge), 1e-3)
    aim = replace(aim, weights=problem.ruler.squares, gaps=replace(aim.gaps, least=-np.ones(len(aim.gaps.least))))
    size = target.points.size
    easy = np.stack([aim.scales * aim.smoothing(row) for row in np.eye(size)], axis=1)
    dense = np.stack([response.moves(column) for column in easy.T], axis=1)
    squared = dense.T @ (aim.weights @ dense)
    largest, wanted = np.linalg.eigvalsh(squared)[-1], dense.T @ (aim.weights @ aim.error.ravel())
    exact = [
        dense @ np.linalg.solve(squared + damping * largest * np.eye(size), wanted) for damping in (0.25e-3, 1.0e-3)
    ]
    left = [aim.error.ravel() - moved for moved in (0.0, *exact, response.moves(smooth_step(response, aim)))]
    before, least, most, found = (np.sqrt(each @ (aim.weights @ each)) for each in left)
    assert most < 0.5 * before
    assert least - 0.01 * before < found < most + 0.01 * before


class Fussy:
    """Problem whose steps help only with a damping of 5 or more."""

    ruler = Ruler(BALL)
    topples = False

    def balance(self, design: np.ndarray) -> "Fussy":
        return Fussy()

    def allowed(self, design: np.ndarray) -> bool:
        return bool(design[0] >= 5.0)

    def settle(self, points: np.ndarray, strays) -> np.ndarray:
        return 0.5 * (points + BALL.points)

    def next_design(self, balance, design: np.ndarray, points: np.ndarray, damping: float):
        return np.array([damping]), damping


def test_the_damping_is_not_eased_at_once_after_a_step_that_failed():
    """Damping rises at a failure, stays at the next success, and falls only after the one that follows."""
    seen: list[float] = []
    first = Reached(np.zeros(1), 1.3 * BALL.points, Fussy.ruler.cost(1.3 * BALL.points))
    descend(Fussy(), first, 4, 0.0, 0.01, lambda reached: seen.append(reached.damping))  # pyright: ignore
    np.testing.assert_allclose(seen, [8.0, 8.0, 8.0 / 3.0, 64.0 / 3.0])


def test_a_stalled_mould_begins_anew_with_a_larger_one(tmp_path):
    """A waist at a stretch of 2 stalls where one half swells more, and from a larger mould comes much nearer.

    In 18 steps: after how many it stalls depends on how a processor rounds.
    """
    ball = quad_sphere(4)
    along = ball.points[:, 2] / np.linalg.norm(ball.points, axis=1)
    waist = ball.points * np.stack([1.0 - 0.35 * np.exp(-6.0 * along**2)] * 2 + [np.full(len(along), 1.5)], axis=1)
    said: list[str] = []
    target = target_of(replace(ball, points=waist), 0.3)
    job = Job(target, "latex", 2.0, "tension", 2e-4, tmp_path, 18, "cpu", False, said.append)
    problem = MouldProblem(job.ruler, _film(job, Material(preset="latex", thickness=2e-4)), 2.0)
    plain = begin(problem, problem.plain)
    assert plain is not None
    reached = _descended(job, ThicknessProblem(problem, 1.0), plain)
    assert "beginning anew with a larger mould, at a stretch of 1.8" in said
    assert reached.anew == 1
    assert reached.cost < 0.2 * STALLED
