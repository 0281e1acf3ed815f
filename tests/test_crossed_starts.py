"""Layers that start crossed: found, and named in a sentence before a run."""

from typing import Any

import numpy as np
import pytest
from meshes import grid, joined, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.piercing import find_piercings
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.plan import plan_model
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, Touch

pytestmark = pytest.mark.physics

LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


def sheet(tilt: float, height: float = 0.0) -> PolygonMesh:
    """Return a sheet of 4 by 4 quads about the origin, which rises along x, lifted by a height [m]."""
    flat = grid(4, 4)
    along, beside = (flat.points[:, :2] / 4.0 - 0.5).T
    points = np.stack([along, tilt * along + height, beside], axis=1)
    return PolygonMesh(points, flat.face_vertex_counts, flat.face_vertex_indices)


def told(*meshes: PolygonMesh, **touch: Any) -> list[str]:
    """Return the warnings on touching of balloons of limp sheets."""
    balloons = [
        Balloon(mesh=each, stiffness=LIMP, inflation=Inflation(kind="pressure", pressure=0.0)) for each in meshes
    ]
    warnings = plan_model(Scene(balloon=balloons, touch=Touch(**touch), substeps=50)).warnings
    return [each for each in warnings if each.startswith("touch:")]


def test_edges_through_triangles_are_those_of_a_plain_count() -> None:
    """Random triangles of very different sizes, in double precision, one pair at a time."""
    random = np.random.default_rng(1)
    centers, sizes = random.uniform(-1.0, 1.0, (60, 1, 3)), random.uniform(0.05, 1.5, (60, 1, 1))
    points = (centers + sizes * random.normal(size=(60, 3, 3))).reshape(-1, 3)
    triangles = np.arange(180).reshape(-1, 3)
    expected = set()
    for number, corners in enumerate(points[triangles]):
        for begin, end in triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2):
            if begin // 3 != number:
                along = points[end] - points[begin]
                matrix = np.stack([corners[1] - corners[0], corners[2] - corners[0], -along], axis=1)
                u, v, part = np.linalg.solve(matrix, points[begin] - corners[0])
                if min(u, v, 1.0 - u - v, part, 1.0 - part) > 0.0:
                    expected.add((min(begin, end), max(begin, end), number))
    found = find_piercings(points, triangles)
    got = {(*map(int, edge), int(number)) for edge, number in zip(found.edges, found.triangles, strict=True)}
    assert len(expected) > 50
    assert got == expected


def test_sheets_that_start_crossed_are_named() -> None:
    """A tilted sheet goes through a flat one along x = -0.15 m: nearest are particles at x = -0.25 m, 20 mm below."""
    flat, tilted = sheet(0.0), sheet(0.2, 0.03)
    (of_two,) = told(flat, tilted)
    (of_one,) = told(joined(flat, tilted), itself=True)
    for words in (" cross at the start", "touch.balloons = false"):
        assert words in of_two
    for words in ("crosses itself at the start", "touch.itself = false"):
        assert words in of_one
    for sentence in (of_two, of_one):
        assert "deepest by 0.02 m at (-0.15, 0, " in sentence


def aside(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh moved by a part of its size, so that it crosses itself where it was."""
    return PolygonMesh(mesh.points + [0.3, 0.2, 0.1], mesh.face_vertex_counts, mesh.face_vertex_indices)


@pytest.mark.parametrize("meshes", [(sheet(0.0), sheet(0.2, height=0.2)), (quad_sphere(2), aside(quad_sphere(2)))])
def test_what_is_apart_or_is_pushed_apart_is_not_named(meshes: tuple[PolygonMesh, ...]) -> None:
    """Closed balloons that overlap at the start are pushed apart."""
    assert told(*meshes) == []


def test_nothing_is_looked_for_where_nothing_touches() -> None:
    assert told(joined(sheet(0.0), sheet(0.2, 0.03)), itself=False) == []


def test_coincident_corners_are_one() -> None:
    """Two sheets that meet at a seam do not cross there."""
    flat, up = sheet(0.0), sheet(0.3)
    beside = PolygonMesh(up.points + [1.0, 0.15, 0.0], up.face_vertex_counts, up.face_vertex_indices)
    both = joined(flat, beside)
    assert len(find_piercings(both.points, triangles_of(both)).triangles) == 0
