"""Coarse meshes in pictures: no gray shards at their outlines, and sharp where they are sharp at the start."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from exported import BALL
from meshes import cube, mesh_of, quad_sphere
from pxr import Usd, UsdGeom

from balloon_warp import Scene, animate
from balloon_warp.kernels.pictures.shapes import LEAST_SEEN, turned_to_viewer
from balloon_warp.mesh.folds import CREASE, SOFT_CREASE, sharp_edges
from balloon_warp.outputs.render.stage_reader import RenderStage
from balloon_warp.scene import Balloon


@wp.kernel
def turn(
    smooth: wp.array[wp.vec3],
    facing: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    # out
    turned: wp.array[wp.vec3],
):
    """Turn one normal per thread."""
    place = wp.tid()
    turned[place] = turned_to_viewer(smooth[place], facing[place], direction[place])


def test_a_smooth_normal_is_never_much_more_at_a_slant_than_its_face():
    """A bent normal stays visible for any smooth normal, face and ray, and turns no more than it must."""
    draw = np.random.default_rng(5)
    smooth, facing, direction = (_unit(draw.normal(size=(4000, 3))) for _ in range(3))
    facing *= -np.sign(np.einsum("ij,ij->i", facing, direction))[:, None]
    smooth *= np.sign(np.einsum("ij,ij->i", smooth, facing))[:, None]
    arrays = [wp.array(each, dtype=wp.vec3, device="cpu") for each in (smooth, facing, direction)]
    out = wp.zeros(len(smooth), dtype=wp.vec3, device="cpu")
    wp.launch(turn, len(smooth), [*arrays, out], device="cpu")
    turned, least = out.numpy(), -float(LEAST_SEEN) * np.einsum("ij,ij->i", facing, direction)
    before, after = (-np.einsum("ij,ij->i", normals, direction) for normals in (smooth, turned))
    assert np.linalg.norm(turned, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert (after >= least - 1e-5).all()
    assert np.allclose(turned[before > least], smooth[before > least], atol=1e-6)
    assert np.allclose(after[before < least], least[before < least], atol=1e-5)
    assert (before < least).mean() > 0.2
    planes = np.cross(smooth, direction)  # it turns in the plane of the ray
    assert np.abs(np.einsum("ij,ij->i", planes, turned)).max() < 1e-5


@pytest.mark.parametrize("bend", [30.0, 59.0, 61.0, 120.0])
def test_an_edge_is_sharp_beyond_its_angle(bend: float):
    """A common edge of two squares, from border to border, is a crease beyond its angle."""
    x, y = np.cos(np.radians(bend)), np.sin(np.radians(bend))
    points = [(0, 0, -1), (0, 0, 1), (-1, 0, -1), (-1, 0, 1), (x, y, -1), (x, y, 1)]
    card = mesh_of(points, [[0, 2, 3, 1], [0, 1, 5, 4]])
    assert len(sharp_edges(card, SOFT_CREASE)) == (bend > SOFT_CREASE)
    assert len(sharp_edges(card, CREASE)) == (bend > CREASE)


def test_a_bump_is_no_crease():
    """A bump is no crease: sharp edges about a point pushed out of a fine ball lead nowhere."""
    ball = quad_sphere(8)
    assert len(sharp_edges(ball, SOFT_CREASE)) == 0
    ball.points[0] *= 1.3
    assert len(sharp_edges(ball, SOFT_CREASE)) == 0


def test_a_box_that_is_inflated_keeps_its_edges(tmp_path: Path):
    """An inflated box keeps its twelve edges, as creases in the stage and split vertices in the picture."""
    boxes = [Balloon(mesh=cube(), name="box"), Balloon(mesh=BALL, name="ball", position=(4, 0, 0))]
    animate(Scene(balloon=boxes, frames=3, gravity=0.0), tmp_path / "out.usdc", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    box, ball = (UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}")) for name in ("box", "ball"))
    edges = np.sort(np.array(box.GetCreaseIndicesAttr().Get()).reshape(-1, 2), axis=1)
    assert len(np.unique(edges, axis=0)) == len(edges) == 12
    assert list(box.GetCreaseLengthsAttr().Get()) == [2] * len(edges)
    assert set(box.GetCreaseSharpnessesAttr().Get()) == {UsdGeom.Mesh.SHARPNESS_INFINITE}
    assert not ball.GetCreaseIndicesAttr().HasAuthoredValue()
    drawn = RenderStage(tmp_path / "out.usdc")
    drawn.read_prims(3)
    sides = [len(mesh.surface._source) - mesh.point_count for mesh in drawn.meshes]
    assert sides[0] == 3 * 8 - 8
    assert sides[1] == 0


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
