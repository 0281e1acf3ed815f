"""Gradients by each spring, each face and each vertex of the shape at rest, against the reference."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gradient_losses import far, far_in_float64
from gradient_scenes import BALL, CASES, SPRINGS, scene

import balloon_warp as bw
from balloon_warp.kernels.laws.membrane import THICKNESS
from balloon_warp.lab.reference.tables import film_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.springs.build import Membrane, build_membrane

pytestmark = pytest.mark.full
RNG = np.random.default_rng(21)


def require_slope(found: np.ndarray, of: bw.Scene, way: np.ndarray, change: Any) -> None:
    """Require the central difference of the loss along a way, to 1e-4 of the norm of its parts.

    Args:
        change: Function of a balloon of the reference, and of how far its tables are changed."""
    more, less = (
        far_in_float64(of, change=lambda reference, h=h: change(reference.balloons[0], h)) for h in (1e-5, -1e-5)
    )
    assert abs((found * way).sum() - (more - less) / 2e-5) < 1e-4 * np.linalg.norm(found * way)


def remould(balloon: Any, membrane: Membrane, edges: np.ndarray) -> None:
    """Give a balloon's film other edges at rest, with the same thickness."""
    sizes = [np.linalg.norm(np.cross(each[:, 0], each[:, 1]), axis=1) for each in (membrane.edges, edges)]
    other = replace(membrane, edges=edges, areas=membrane.areas * sizes[1] / sizes[0])
    balloon.film = film_of(other, "mooney_rivlin")


def test_of_each_spring(device: str):
    """Gradients along random directions of all lengths, constants and rest points."""
    of = CASES["pressure"].scene
    each = ["rest_lengths", "spring_constants", "rest_points"]
    found = bw.gradient(of, of=SPRINGS, each=each, loss=far, device=device)
    shape = plan_model(of).shapes[0]
    np.testing.assert_array_equal(found.spring_pairs[0], shape.springs.pairs)
    lengths, points = shape.springs.rest_lengths, shape.mesh.points
    longer, stiffer, aside = (RNG.normal(size=size) for size in (lengths.shape, lengths.shape, points.shape))

    def lengthen(balloon: Any, h: float) -> None:
        balloon.springs.lengths = (lengths * (1.0 + h * longer))[:, None]

    def stiffen(balloon: Any, h: float) -> None:
        balloon.springs.constants = balloon.springs.constants + 10.0 * h * stiffer[:, None]

    def reshape(balloon: Any, h: float) -> None:
        balloon.springs.lengths = shape.springs.resting_at(points + 0.1 * h * aside).rest_lengths[:, None]

    require_slope(found.by_each["rest_lengths"][0], of, lengths * longer, lengthen)
    require_slope(found.by_each["spring_constants"][0], of, 10.0 * stiffer, stiffen)
    require_slope(found.by_each["rest_points"][0], of, 0.1 * aside, reshape)
    kinds = np.bincount(shape.springs.kind, found.by_each["spring_constants"][0])
    assert kinds == pytest.approx([found.gradients[path][0] for path in SPRINGS], rel=1e-5)


def test_of_each_face(tmp_path: Path, device: str):
    """Gradients of a ball that is stretched everywhere from the start, so that no triangle is at the law's kink."""
    write_obj(tmp_path / "small.obj", replace(BALL, points=0.9 * BALL.points))
    of = scene(frames=6, material={"kind": "mooney_rivlin", "rest_mesh": tmp_path / "small.obj"})
    found = bw.gradient(of, each=["thicknesses", "rest_points"], loss=far, device=device).by_each
    membrane = plan_model(of).shapes[0].membrane
    thicker, aside = 1e-4 * RNG.normal(size=BALL.face_count), 0.1 * RNG.normal(size=BALL.points.shape)

    def thicken(balloon: Any, h: float) -> None:
        balloon.film.areas = membrane.areas * (1.0 + h * thicker[membrane.faces] / THICKNESS.default)

    def reshape(balloon: Any, h: float) -> None:
        corners = (0.9 * BALL.points + h * aside)[membrane.corners]
        remould(balloon, membrane, corners[:, 1:] - corners[:, :1])

    require_slope(found["thicknesses"][0], of, thicker, thicken)
    require_slope(found["rest_points"][0], of, aside, reshape)


def test_of_panels_before_they_are_sewn(tmp_path: Path, device: str):
    """Each face is a panel of its own, whose vertices go their own ways."""
    points = 0.9 * BALL.points[BALL.face_vertex_indices]
    panels = replace(BALL, points=points, face_vertex_indices=np.arange(len(points), dtype=np.int32))
    write_obj(tmp_path / "panels.obj", panels)
    of = scene(frames=2, material={"kind": "mooney_rivlin", "rest_mesh": tmp_path / "panels.obj"})
    (found,) = bw.gradient(of, each=["rest_points"], loss=far, device=device).by_each["rest_points"]
    way = 0.1 * RNG.normal(size=points.shape)

    def recut(balloon: Any, h: float) -> None:
        corners = (points + h * way)[build_membrane(panels).corners]
        remould(balloon, plan_model(of).shapes[0].membrane, corners[:, 1:] - corners[:, :1])

    require_slope(found, of, way, recut)


def test_a_world_in_a_batch_has_the_derivatives_that_it_has_alone(device: str):
    of, each = CASES["pressure"].scene, ["rest_lengths", "spring_constants"]
    masses = np.array([0.05, 0.07])
    found = bw.gradient(of, each=each, loss=far, world_count=2, vary={"balloon.mass": masses}, device=device)
    alone = bw.gradient(of, each=each, loss=far, vary={"balloon.mass": masses[1:]}, device=device)
    for name in each:
        np.testing.assert_array_equal(found.by_each[name][0][1], alone.by_each[name][0])
        assert not np.array_equal(*found.by_each[name][0])
