"""Meshes that come near themselves, and balloons of them."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, grid, hook, quad_sphere

from balloon_warp import PolygonMesh, Simulator, bundled_scenes, load_scene
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.nearness import nears_itself
from balloon_warp.mesh.sides import wrong_sides


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_what_faces_itself_across_a_small_gap_is_near(scale: float):
    """A tube of radius 0.25 m grows by some 0.03 m outward at a stretch of 1.1, and three times as much at 1.3; each
    end of a hook does."""
    for mesh, stretch, near in [
        (hook(0.05), 0.1, True),
        (hook(0.2), 0.1, False),  # the gap is wider than the ends grow
        (hook(0.2), 0.5, True),
        (quad_sphere(6), 0.1, False),
        (cube(), 0.1, False),
        (grid(4, 4), 0.1, False),  # has no inside
    ]:
        turned = mesh.points[:, [2, 0, 1]] * scale + 5.0 * scale
        assert nears_itself(replace(mesh, points=turned), stretch) == near


def test_a_groove_and_a_thin_wall_are_not_near_themselves():
    """The sides of a groove face each other, but one is soon at the other. The two sides of a wall look away from each
    other."""
    groove = quad_sphere(8)
    across = np.abs(groove.points[:, 0])
    dented = groove.points.copy()
    dented[:, 1] -= np.where((dented[:, 1] > 0.0) & (across < 0.15), 0.5 * (0.15 - across), 0.0)
    assert not nears_itself(replace(groove, points=dented), 0.1)
    assert not nears_itself(replace(groove, points=groove.points * np.array([1.0, 0.02, 1.0])), 0.1)


def enclosed_part(mesh: PolygonMesh, points: np.ndarray) -> float:
    sides = wrong_sides(replace(mesh, points=points.astype(np.float64)))
    return float(sides.areas[sides.enclosed].sum() / sides.areas.sum())


def test_a_mesh_by_itself_touches_itself_where_it_is_near():
    """The strands of a knot grow and sag into each other without."""
    mesh, enclosed = load_mesh(bundled_scenes()["knot"].parent / "knot.obj"), dict[bool, float]()
    for touching in (True, False):
        scene = load_scene(mesh)
        assert scene.touches_itself
        if not touching:
            scene = scene.model_copy(update={"touch": None})
        simulator = Simulator(scene, "cpu")
        for _ in range(110):  # the pressure is there after 1.5 s
            simulator.advance()
        enclosed[touching] = enclosed_part(mesh, simulator.read_frame().points[0])
    assert enclosed[False] > 0.03
    assert enclosed[True] < 0.1 * enclosed[False]
    assert load_scene(quad_sphere(4)).touch is None
