"""Pins that a mesh gets by itself: at the borders of open parts, and never so that the rest of it falls."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, joined, open_cube, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.prepare import Parts
from balloon_warp.scene import load_scene
from balloon_warp.scene.pins import pinned_at_borders


def at(mesh: PolygonMesh, place: tuple[float, float, float], size: float = 1.0) -> PolygonMesh:
    return replace(mesh, points=mesh.points * size + np.array(place))


RIM = {1, 3, 5, 7}
"""of the open cube, whose other four vertices are not on its border"""


def pins(*parts: PolygonMesh, held: Parts = "held") -> set[int]:
    return set(pinned_at_borders(joined(*parts), held).tolist())


def test_one_open_part_is_held_at_its_border() -> None:
    assert pins(open_cube()) == RIM
    assert pins(cube()) == set()


def test_a_closed_body_is_not_held_at_the_border_of_a_detail() -> None:
    """A lash does not pin a closed head at its border; but a body that is mostly open pins the head."""
    assert pins(cube(), at(grid(1, 1), (0, 0, 1.1), 0.2)) == set()
    assert pins(open_cube(), at(cube(), (3, 0, 0), 0.2)) == RIM


def test_free_parts_are_held_only_if_all_of_them_are() -> None:
    """Pins are all or none: a car's open body would stay where it is while its wheels fall."""
    assert pins(open_cube(), at(cube(), (3, 0, 0), 0.2), held="free") == set()
    both = pins(open_cube(), at(open_cube(), (3, 0, 0), 0.2), held="free")
    assert both == RIM | {vertex + 8 for vertex in RIM}


def test_each_part_that_is_all_border_is_held_at_its_first_face() -> None:
    """Each strip of hair is pinned by itself: none swings from another."""
    strips = [at(grid(3, 1), (0, 2.0 * n, 0)) for n in range(3)]
    assert pins(*strips) == {8 * n + corner for n in range(3) for corner in (0, 1, 4, 5)}


@pytest.mark.parametrize("override", [(), (("balloon.holes", "keep"),)])
def test_a_mesh_by_itself_is_not_held_at_holes_that_are_closed(override: tuple, tmp_path: Path) -> None:
    ball = quad_sphere(12)
    counts, corners = ball.face_vertex_counts[1:], ball.face_vertex_indices[4:]
    pierced = replace(ball, face_vertex_counts=counts, face_vertex_indices=corners)
    write_obj(tmp_path / "ball.obj", pierced)
    fixed = load_scene(tmp_path / "ball.obj", override).balloon[0].fixed
    assert fixed == (sorted(ball.face_vertex_indices[:4].tolist()) if override else [])
