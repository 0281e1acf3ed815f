"""Crossings of surfaces with themselves: exact contact counts where one goes through, not where one only touches."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import box, grid, joined, mesh_of, quad_sphere

from balloon_warp import bundled_scenes, load_mesh
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import crossings_of
from balloon_warp.mesh.topology import triangulate

BALL, SHEET = quad_sphere(4), grid(4, 4)
QUADS = BALL.face_vertex_indices.reshape(-1, 4).tolist()
RISING = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def pulled(x: float = 0.0, y: float = 0.0) -> PolygonMesh:
    """Return a ball whose top is pulled through its bottom, straight down or a little aside."""
    points, top = BALL.points.copy(), BALL.points[:, 2] > 0.6
    points[top] += [x, y, -2.6]
    return replace(BALL, points=points)


def cubes(*center: float, size: float = 1.0) -> PolygonMesh:
    """Return a cube, and another one at some center."""
    return joined(box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), box(center, (size, size, size)))


def needle(tip: float) -> PolygonMesh:
    """Return a flat box and a pyramid whose tip is at that height over it."""
    base = [(x, y, 2.0) for x, y in ((-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3))]
    pyramid = mesh_of([*base, (0.0, 0.0, tip)], [[0, 1, 2, 3], *([k, 4, (k + 1) % 4] for k in range(4))])
    return joined(box((0.0, 0.0, -0.5), (2.0, 2.0, 1.0)), pyramid)


def with_slivers() -> PolygonMesh:
    """Return a slab whose top is cut finer along one line, with triangles of no area between."""
    xs = np.linspace(0.0, 1.0, 9)
    points = [(x, 0.0, 0.0) for x in xs] + [(0.0, -1.0, 0.0), (1.0, -1.0, 0.0)] + [(x, 1.0, 0.0) for x in xs]
    fine = [[k, k + 1, 12 + k, 11 + k] for k in range(8)]
    slivers = [[0, k + 1, k] for k in range(1, 8)]
    return mesh_of(points, [[9, 10, 8, 0], *slivers, *fine])


CROSSING = {
    "edge on edge": pulled(),
    "edge on edge, of triangles": mesh_of(pulled().points, triangulate(pulled())[0].tolist()),
    "aside": pulled(0.1, 0.07),
    "in a plane of symmetry": pulled(0.0, 0.07),
    "corner on corner": cubes(0.5, 0.5, 0.5),
    "sides in one plane": cubes(0.5, 0.0, 0.0),
    "vertex in a side": cubes(0.25, 0.25, 0.25, size=0.5 + 1e-3),
    "edges in sides": cubes(0.5, 0.25, 0.0),
    "a cross": joined(box((0.0, 0.0, 0.0), (3.0, 1.0, 1.0)), box((0.0, 0.0, 0.0), (1.0, 3.0, 1.0))),
    "a needle": needle(-0.1),
    "vertices that coincide": joined(SHEET, replace(SHEET, points=SHEET.points[:, [0, 2, 1]] + [0, 2, -2])),
}
TOUCHING = {
    "a ball": BALL,
    "side on side": cubes(1.0, 0.0, 0.0),
    "side on a part of a side": cubes(0.75, 0.1, 0.0, size=0.5),
    "edge on edge": cubes(1.0, 1.0, 0.0),
    "corner on corner": cubes(1.0, 1.0, 1.0),
    "a needle": needle(0.0),
    "a repeated face": mesh_of(BALL.points, [*QUADS, QUADS[0]]),
    "a seam": joined(SHEET, replace(SHEET, points=SHEET.points + [4, 0, 0])),
    "a seam where it bends": joined(SHEET, replace(SHEET, points=SHEET.points @ RISING + [4, 0, 0])),
    "slivers": with_slivers(),
    "a squirrel": load_mesh(bundled_scenes()["squirrel_inflate"].with_name("squirrel.obj")),
}
MIRRORED, SWAPPED = np.diag([-1.0, 1.0, 1.0]), np.eye(3)[[2, 1, 0]]
TURNED = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def counts(mesh: PolygonMesh) -> list[int]:
    """Return the crossings of a mesh as it is, mirrored, with axes swapped, and turned, far off, with other numbers."""
    new = np.random.default_rng(1).permutation(mesh.vertex_count)
    turned = np.empty_like(mesh.points)
    turned[new] = 0.01 * mesh.points @ TURNED.T + [0.3, -2.0, 7.0]
    other = replace(mesh, points=turned, face_vertex_indices=new[mesh.face_vertex_indices].astype(np.int32))
    posed = [replace(mesh, points=mesh.points @ pose) for pose in (np.eye(3), MIRRORED, SWAPPED)]
    return [len(crossings_of(each).edges) for each in (*posed, other)]


@pytest.mark.parametrize("name", CROSSING)
def test_what_goes_through_itself_crosses_in_whatever_pose(name: str):
    assert min(counts(CROSSING[name])) > 0


@pytest.mark.parametrize("name", TOUCHING)
def test_what_only_touches_itself_does_not_cross_in_any_pose(name: str):
    assert max(counts(TOUCHING[name])) == 0
