"""Areas, volumes, normals and triangles against analytic values and trimesh."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from meshes import cube, grid, mesh_of, moebius, open_cube, polygon, prism, quad_sphere, tetrahedron, torus

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import (
    face_areas,
    face_centers,
    face_vector_areas,
    first_coincident,
    signed_volume,
    total_area,
    triangulate,
    vertex_normals,
    volume_and_area,
)

# A few hundred float64 operations of values near 1.
ROUND_OFF = 1e-13


def test_cube() -> None:
    mesh = cube()
    assert signed_volume(mesh) == pytest.approx(1.0, abs=ROUND_OFF)
    assert total_area(mesh) == pytest.approx(6.0, abs=ROUND_OFF)
    outward = face_centers(mesh) - 0.5
    np.testing.assert_allclose(face_vector_areas(mesh), 2.0 * outward, atol=ROUND_OFF)
    np.testing.assert_allclose(vertex_normals(mesh), (mesh.points - 0.5) * 2.0 / np.sqrt(3.0), atol=ROUND_OFF)


@pytest.mark.parametrize("mesh", [quad_sphere(5, 0.7), torus(7, 5), tetrahedron(), prism(5), open_cube()])
def test_quads_alone_are_measured_as_among_others(mesh: PolygonMesh) -> None:
    """The path for quads alone agrees with that for mixed faces."""
    points = np.random.default_rng(0).normal(1.0, 0.02, mesh.points.shape) * mesh.points + 3.0  # faces are not flat
    alone = replace(mesh, points=points)
    crumb = np.array([0, 0, 0], dtype=np.int32)  # adds nothing but its one point three times to the mean of all
    among = replace(
        alone,
        face_vertex_counts=np.append(mesh.face_vertex_counts, np.int32(3)),
        face_vertex_indices=np.append(mesh.face_vertex_indices, crumb),
    )
    np.testing.assert_allclose(face_vector_areas(alone), face_vector_areas(among)[:-1], atol=ROUND_OFF)
    assert volume_and_area(alone) == pytest.approx((signed_volume(alone), total_area(alone)), abs=ROUND_OFF)
    assert total_area(alone) == pytest.approx(total_area(among), abs=ROUND_OFF)


def test_tetrahedron() -> None:
    assert signed_volume(tetrahedron()) == pytest.approx(1.0 / 6.0, abs=ROUND_OFF)
    assert total_area(tetrahedron()) == pytest.approx(1.5 + np.sqrt(3.0) / 2.0, abs=ROUND_OFF)


@pytest.mark.parametrize("n", [3, 5, 12])
def test_polygons_of_any_size(n: int) -> None:
    area = n / 2.0 * np.sin(2.0 * np.pi / n)
    np.testing.assert_allclose(face_vector_areas(polygon(n)), [[0.0, 0.0, area]], atol=ROUND_OFF)
    assert signed_volume(prism(n)) == pytest.approx(area, abs=ROUND_OFF)
    assert total_area(prism(n)) == pytest.approx(2.0 * area + 2.0 * n * np.sin(np.pi / n), abs=ROUND_OFF)


def test_concave_polygon() -> None:
    dart = mesh_of([(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)], [[0, 1, 2, 3]])
    # Two triangles of base 0.5 and height 1, about the dart's axis.
    np.testing.assert_allclose(face_areas(dart), [0.5], atol=ROUND_OFF)


def test_sphere_converges_to_the_analytic_one() -> None:
    errors = [abs(signed_volume(quad_sphere(n)) / (4.0 / 3.0 * np.pi) - 1.0) for n in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.05)  # chords of a circle: second order
    assert errors[-1] < 2e-3


@pytest.mark.parametrize("mesh", [quad_sphere(6), torus(9, 7), prism(7), tetrahedron(), open_cube()])
def test_volume_does_not_depend_on_place_and_first_corner(mesh: PolygonMesh) -> None:
    volume = signed_volume(mesh)
    # Coordinates of 1e6 are rounded at 1e-10, which moves the surface by as much.
    assert signed_volume(replace(mesh, points=mesh.points + 1e6)) == pytest.approx(volume, rel=1e-8)
    if (mesh.face_vertex_counts == 4).all():
        turned = np.roll(mesh.face_vertex_indices.reshape(-1, 4), 1, axis=1).ravel()
        assert signed_volume(replace(mesh, face_vertex_indices=turned)) == pytest.approx(volume, abs=ROUND_OFF)


def test_volume_is_negative_inside_out() -> None:
    inside_out = replace(quad_sphere(4), face_vertex_indices=quad_sphere(4).face_vertex_indices[::-1].copy())
    assert signed_volume(inside_out) == pytest.approx(-signed_volume(quad_sphere(4)), abs=ROUND_OFF)


@pytest.mark.parametrize("mesh", [quad_sphere(5), torus(9, 7), prism(7), cube()])
def test_quad_volume_is_the_mean_of_its_triangulations_by_trimesh(mesh: PolygonMesh) -> None:
    volumes = []
    for shift in (0, 1):
        faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
        shifted = mesh_of(mesh.points, [np.roll(face, shift).tolist() for face in faces])
        triangles, _ = triangulate(shifted)
        volumes.append(trimesh.Trimesh(mesh.points, triangles, process=False).volume)
    assert signed_volume(mesh) == pytest.approx(np.mean(volumes), abs=ROUND_OFF)


def test_triangle_meshes_agree_with_trimesh() -> None:
    reference = trimesh.creation.icosphere(subdivisions=2)
    mesh = mesh_of(reference.vertices, reference.faces.tolist())
    assert signed_volume(mesh) == pytest.approx(reference.volume, rel=1e-12)
    assert total_area(mesh) == pytest.approx(reference.area, rel=1e-12)
    np.testing.assert_allclose(face_centers(mesh), reference.triangles_center, atol=ROUND_OFF)


def test_vertex_normals_of_a_sphere_point_outward() -> None:
    mesh = quad_sphere(16)
    # Least where three squares of the cube met: their normals are known to half a cell.
    assert np.einsum("ij,ij->i", vertex_normals(mesh), mesh.points).min() > 0.999


def test_vertex_normal_is_the_mean_of_unit_normals() -> None:
    # A big face and a small one at right angles count alike; the face without area counts nothing.
    points = [(0, 0, 0), (10, 0, 0), (10, 9, 0), (0, 9, 0), (0, 0, -1), (1, 0, -1), (1, 0, 0), (5, 5, 5)]
    mesh = mesh_of(points, [[0, 1, 2, 3], [0, 6, 5, 4], [0, 1, 1]])
    expected = np.array([(0, 1, 1)]) / np.sqrt(2.0)
    normals = vertex_normals(mesh)
    np.testing.assert_allclose(normals[:1], expected, atol=ROUND_OFF)
    np.testing.assert_allclose(normals[1], [0, 0, 1], atol=ROUND_OFF)
    np.testing.assert_array_equal(normals[7], 0.0)  # of no face


def test_triangulate() -> None:
    mesh = mesh_of(np.eye(6, 3), [[0, 1, 2], [2, 3, 4, 5], [0, 1, 2, 3, 4]])
    triangles, face = triangulate(mesh)
    assert triangles.tolist() == [[0, 1, 2], [2, 3, 4], [2, 4, 5], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert face.tolist() == [0, 1, 1, 2, 2, 2]
    assert (triangles.dtype, face.dtype) == (np.int32, np.int32)


def test_open_and_one_sided_surfaces_have_areas() -> None:
    assert total_area(grid(3, 5)) == pytest.approx(15.0, abs=ROUND_OFF)
    assert np.isfinite(face_areas(moebius(9))).all()


def test_first_coincident() -> None:
    points = np.array([(1, 2, 3), (0, 0, 0), (1, 2, 3), (-0.0, 0, 0), (1, 2, 3.0000001)])
    assert first_coincident(points).tolist() == [0, 1, 0, 1, 4]
