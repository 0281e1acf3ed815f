"""Repair of a mesh: duplicate corners and faces removed, consistent winding, outward."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import grid, joined, mesh_of, moebius, quad_sphere, torus

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import corner_faces, flip_faces
from balloon_warp.mesh.geometry import face_vector_areas, signed_volume
from balloon_warp.mesh.orientation import facing_outward
from balloon_warp.mesh.repair import distinct_faces, repaired
from balloon_warp.mesh.topology import inconsistent_edges, mesh_edges


def turned(mesh: PolygonMesh, faces: np.ndarray) -> PolygonMesh:
    """Return the mesh with some faces' winding reversed, by a mask."""
    backwards = flip_faces(mesh.face_vertex_counts, mesh.face_vertex_indices)
    indices = np.where(faces[corner_faces(mesh)], backwards, mesh.face_vertex_indices)
    return replace(mesh, face_vertex_indices=indices)


def moved(mesh: PolygonMesh, shift: tuple[float, float, float]) -> PolygonMesh:
    return replace(mesh, points=mesh.points + np.array(shift))


SPHERE = quad_sphere(4)
ALL = np.ones(SPHERE.face_count, dtype=bool)


@pytest.mark.parametrize("seed", range(5))
def test_any_winding_of_closed_components_is_found_again(seed: int) -> None:
    pair = joined(moved(SPHERE, (-2, 0, 0)), moved(torus(9, 7), (2, 0, 0)))
    mixed = turned(pair, np.random.default_rng(seed).random(pair.face_count) < 0.5)
    # The sums over a face run the other way around where it was turned twice.
    np.testing.assert_allclose(face_vector_areas(facing_outward(mixed)), face_vector_areas(pair), rtol=0, atol=1e-14)


def test_an_inward_component_is_turned_beside_and_left_inside() -> None:
    beside = joined(SPHERE, turned(moved(SPHERE, (3, 0, 0)), ALL))
    assert signed_volume(facing_outward(beside)) == pytest.approx(2.0 * signed_volume(SPHERE))
    hollow = joined(SPHERE, turned(replace(SPHERE, points=0.5 * SPHERE.points), ALL))
    assert signed_volume(facing_outward(hollow)) == pytest.approx((1.0 - 0.5**3) * signed_volume(SPHERE))


def test_an_open_mesh_keeps_the_side_that_most_faces_show() -> None:
    sheet = grid(3, 3)
    few, many = np.zeros(9, dtype=bool), np.ones(9, dtype=bool)
    few[[0, 4]] = True
    many[[0, 4]] = False
    assert (face_vector_areas(facing_outward(turned(sheet, few)))[:, 2] == 1.0).all()
    assert (face_vector_areas(facing_outward(turned(sheet, many)))[:, 2] == -1.0).all()


def test_what_no_winding_fits_stays_as_it_is() -> None:
    strip = moebius(9)
    assert repaired(strip, "strip").face_vertex_indices.tolist() == strip.face_vertex_indices.tolist()
    assert len(inconsistent_edges(mesh_edges(strip))) == 1


def test_a_flat_envelope_without_volume_is_left_alone() -> None:
    # Tilted, so that the rounding of its volume has either sign.
    for tilt in np.random.default_rng(0).normal(size=(20, 3, 3)):
        flat = replace(SPHERE, points=(SPHERE.points * [1.0, 1.0, 0.0]) @ tilt)
        assert facing_outward(flat) is flat


def test_corners_and_faces_are_taken_once() -> None:
    faces = [[0, 1, 1, 2], [3, 3, 3], [2, 0, 1], [0, 3, 0, 1], [1, 2, 3, 0, 2]]
    mesh, kept = distinct_faces(mesh_of(np.eye(4, 3), faces))
    assert np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])[1].tolist() == [0, 3, 1]
    assert (kept.tolist(), mesh.face_vertex_counts.tolist()) == ([0, 3, 4], [3, 3, 4])
    with pytest.raises(InputError, match=r"^thing: has no face with three different corners$"):
        repaired(mesh_of(np.eye(4, 3), [[0, 1, 0], [2, 2, 2]]), "thing")
