"""Lids across holes in a surface; intended openings stay open."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, moebius, open_cube, quad_sphere
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.holes import Lid, border_loops, lid_across, with_lids
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import border_edges, genus, inconsistent_edges, mesh_edges
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Inflation, Scene

Mask = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
"""of the places of faces, shape (face_count, 3)"""


def without(mesh: PolygonMesh, gone: Mask) -> PolygonMesh:
    """Return the mesh of quads without the faces at some places."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    kept = quads[~gone(mesh.points[quads].mean(axis=1))]
    return replace(
        mesh, face_vertex_counts=np.full(len(kept), 4, dtype=np.int32), face_vertex_indices=kept.ravel().copy()
    )


def toward(*ways: tuple[float, float, float], angle: float) -> Mask:
    """Return a mask of places whose direction from the origin is within an angle [rad] of one of these."""
    axes = np.array(ways) / np.linalg.norm(ways, axis=1, keepdims=True)
    return lambda at: ((at / np.linalg.norm(at, axis=1, keepdims=True)) @ axes.T > np.cos(angle)).any(axis=1)


def tube(rings: int, around: int = 16, radius: float = 0.2) -> PolygonMesh:
    """Return a tube along z from 0 to 1, open at both ends."""
    turn = 2.0 * np.pi * np.arange(around) / around
    points = [(radius * np.cos(t), radius * np.sin(t), ring / rings) for ring in range(rings + 1) for t in turn]
    quads = []
    for ring in range(rings):
        for n in range(around):
            low, next_low = ring * around + n, ring * around + (n + 1) % around
            quads.append([low, next_low, next_low + around, low + around])
    return mesh_of(points, quads)


BALL = quad_sphere(16)
EYES = toward((0.4, 0.2, 0.9), (-0.4, 0.2, 0.9), angle=0.2)
NECK = toward((0.0, -1.0, 0.0), angle=0.5)
"""an opening of 6% of the surface"""


def whole(mesh: PolygonMesh) -> PolygonMesh:
    return prepared(mesh, "mesh", Treatment())


def test_eye_sockets_are_closed_and_hold_gas() -> None:
    mesh = whole(without(BALL, EYES))
    edges = mesh_edges(mesh)
    assert (len(border_edges(edges)), len(inconsistent_edges(edges)), genus(mesh, edges)) == (0, 0, 0)
    # What a flat lid of the radius sin(0.2) cuts off of the unit ball, pi h^2 (1 - h / 3), is a thousandth of it.
    cut = 2.0 * np.pi * (1.0 - np.cos(0.2)) ** 2
    assert signed_volume(BALL) - 3.0 * cut < signed_volume(mesh) < signed_volume(BALL)
    assert mesh.warnings[0].startswith(
        "2 holes in the surface are closed by faces numbered after the file's; the largest has 16"
    )
    np.testing.assert_array_equal(mesh.points, BALL.points)
    np.testing.assert_array_equal(
        mesh.face_vertex_indices[: 4 * 1500], without(BALL, EYES).face_vertex_indices[: 4 * 1500]
    )
    gas = Scene(balloon=[Balloon(mesh=without(BALL, EYES), inflation=Inflation(kind="gas"))])
    assert plan_model(gas).shapes[0].closed
    kept = gas.model_copy(update={"balloon": [gas.balloon[0].model_copy(update={"holes": "keep"})]})
    with pytest.raises(InputError, match="an open mesh cannot hold gas"):
        plan_model(kept)


def test_a_head_with_an_open_neck_keeps_that_alone() -> None:
    mesh = whole(without(BALL, lambda at: EYES(at) | NECK(at)))
    (loop,) = border_loops(mesh, mesh_edges(mesh))
    assert (mesh.points[loop, 1] < -0.8).all()


OPEN: dict[str, PolygonMesh] = {
    "a bowl": without(BALL, lambda at: at[:, 1] > 0.0),
    "a cup": without(BALL, lambda at: at[:, 1] > 0.7),
    "a cube without a side": open_cube(),
    "a sheet": grid(5, 5),
    "a strip with one side": moebius(9),
    "a sleeve": tube(12),
    "a long sleeve, whose ends are 1% of it each": tube(12, radius=0.04),
    "a hem of 9%": without(replace(BALL, points=BALL.points * [1.0, 1.2, 0.6]), toward((0, -1, 0), angle=0.6)),
}


@pytest.mark.parametrize("name", OPEN)
def test_what_is_meant_to_be_open_stays_so(name: str) -> None:
    mesh = whole(OPEN[name])
    assert mesh.face_count == OPEN[name].face_count
    assert len(border_edges(mesh_edges(mesh))) > 0


def test_a_neck_a_fifth_of_the_hem_stays_and_a_button_hole_does_not() -> None:
    hem, neck, pin = toward((0, -1, 0), angle=0.7), toward((0, 1, 0), angle=0.4), toward((0, 0, 1), angle=0.09)
    shirt = without(BALL, lambda at: hem(at) | neck(at) | pin(at))
    loops = border_loops(shirt, mesh_edges(shirt))
    assert len(loops) == 3
    assert len(border_loops(whole(shirt), mesh_edges(whole(shirt)))) == 2


def test_holes_of_details_are_closed_whatever_part_of_them_they_are() -> None:
    """Half an eyeball in a closed head gets a lid; a sheet does not, as the lid would lie on it."""
    eye = without(replace(quad_sphere(4), points=0.1 * quad_sphere(4).points), lambda at: at[:, 2] < 0.0)
    lash = replace(grid(3, 1), points=0.05 * grid(3, 1).points + (0, 0, 2))
    assert len(border_edges(mesh_edges(whole(joined(BALL, eye))))) == 0
    assert len(border_edges(mesh_edges(whole(joined(BALL, lash))))) == 8


def test_holes_that_touch_are_closed_each() -> None:
    """Two missing quads that share a corner get a lid each: one loop around both would cross itself."""
    quads = BALL.face_vertex_indices.reshape(-1, 4)
    first = 5 * 16 + 5
    shared = int((np.isin(quads, quads[first]).sum(axis=1) == 1).argmax())
    centers = BALL.points[quads].mean(axis=1)
    gone = without(BALL, lambda at: np.linalg.norm(at[:, None] - centers[[first, shared]], axis=2).min(axis=1) < 1e-9)
    assert sorted(len(loop) for loop in border_loops(gone, mesh_edges(gone))) == [4, 4]
    mesh = whole(gone)
    assert mesh.face_count == BALL.face_count
    assert signed_volume(mesh) == pytest.approx(signed_volume(BALL), rel=1e-12)


@pytest.mark.parametrize("count", range(3, 12))
def test_a_lid_covers_its_loop_once(count: int) -> None:
    """A lid of a regular polygon has its area, half n sin(2 pi / n), and each rung on two faces."""
    turn = 2.0 * np.pi * np.arange(count) / count
    points = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    lid = Lid(np.arange(count))
    np.testing.assert_allclose(
        lid.vector_areas(points).sum(axis=0), [0.0, 0.0, 0.5 * count * np.sin(2.0 * np.pi / count)], atol=1e-12
    )
    mesh = mesh_of(points, [face.tolist() for face in lid.faces])
    edges = mesh_edges(mesh)
    assert len(border_edges(edges)) == count
    assert len(lid.rungs) == edges.count - count
    assert mesh.face_vertex_counts.max() <= 4


@pytest.mark.parametrize("taken", [{(0, 3)}, {(1, 4)}, {(0, 3), (2, 5)}, {(0, 3), (1, 4), (2, 5)}])
def test_a_rung_is_no_edge_that_is_there_already(taken: set[tuple[int, int]]) -> None:
    """A rung across a hexagon avoids existing edges where possible: three faces would share the edge."""
    turn = np.pi * np.arange(6) / 3
    points = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    (rung,) = lid_across(np.arange(6), points, taken).rungs
    assert tuple(sorted(rung)) in ({(0, 3), (1, 4), (2, 5)} - taken or taken)


def test_lids_have_texture_coordinates_of_their_vertices() -> None:
    places = (BALL.points @ [[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]).astype(np.float32)
    textured = without(replace(BALL), EYES)
    textured = replace(textured, texture_coordinates=places[textured.face_vertex_indices])
    mesh = whole(textured)
    np.testing.assert_array_equal(mesh.texture_coordinates, places[mesh.face_vertex_indices])


def test_an_inward_mesh_with_a_hole_is_turned_outward() -> None:
    mesh = without(BALL, EYES)
    inward = replace(mesh, face_vertex_indices=mesh.face_vertex_indices[::-1].copy())
    assert signed_volume(whole(inward)) == pytest.approx(signed_volume(whole(mesh)), rel=1e-3)


def test_a_sound_mesh_is_left_alone() -> None:
    assert whole(cube()).face_count == 6


@pytest.mark.filterwarnings("error")
def test_a_surface_without_area_has_no_holes() -> None:
    """A surface without area has no holes, and no division by zero."""
    flat = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    assert with_lids(flat) is flat
