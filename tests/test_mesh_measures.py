"""Areas, volumes, normals, triangles and topology of meshes, against known values and trimesh."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from meshes import cube, grid, joined, mesh_of, moebius, open_cube, polygon, prism, quad_sphere, tetrahedron, torus
from meshes import two_quads_at_a_vertex as two_quads
from odd_meshes import klein

from balloon_warp.mesh import PolygonMesh, topology
from balloon_warp.mesh import topology as geometry
from balloon_warp.mesh.topology import component_labels

# A few hundred float64 operations of values near 1.
ROUND_OFF = 1e-13


def test_solids_and_sheets_have_known_areas_volumes_and_normals() -> None:
    mesh = cube()
    outward = geometry.face_centers(mesh) - 0.5
    np.testing.assert_allclose(geometry.face_vector_areas(mesh), 2.0 * outward, atol=ROUND_OFF)
    np.testing.assert_allclose(geometry.vertex_normals(mesh), (mesh.points - 0.5) * 2.0 / np.sqrt(3.0), atol=ROUND_OFF)
    for solid, volume, area in ((mesh, 1.0, 6.0), (tetrahedron(), 1.0 / 6.0, 1.5 + np.sqrt(3.0) / 2.0)):
        found = geometry.signed_volume(solid), geometry.total_area(solid)
        assert found == pytest.approx((volume, area), abs=ROUND_OFF)
    assert geometry.total_area(grid(3, 5)) == pytest.approx(15.0, abs=ROUND_OFF)
    assert np.isfinite(geometry.face_areas(moebius(9))).all()
    # Least where three squares of the cube met: their normals are known to half a cell.
    assert np.einsum("ij,ij->i", geometry.vertex_normals(quad_sphere(16)), quad_sphere(16).points).min() > 0.999
    inside_out = replace(quad_sphere(4), face_vertex_indices=quad_sphere(4).face_vertex_indices[::-1].copy())
    assert geometry.signed_volume(inside_out) == pytest.approx(-geometry.signed_volume(quad_sphere(4)), abs=ROUND_OFF)


@pytest.mark.parametrize("mesh", [quad_sphere(5, 0.7), torus(7, 5), tetrahedron(), prism(5), open_cube()])
def test_quads_alone_are_measured_as_among_others(mesh: PolygonMesh) -> None:
    points = np.random.default_rng(0).normal(1.0, 0.02, mesh.points.shape) * mesh.points + 3.0  # faces are not flat
    alone = replace(mesh, points=points)
    crumb = np.array([0, 0, 0], dtype=np.int32)  # adds nothing but its one point three times to the mean of all
    among = replace(
        alone,
        face_vertex_counts=np.append(mesh.face_vertex_counts, np.int32(3)),
        face_vertex_indices=np.append(mesh.face_vertex_indices, crumb),
    )
    areas = [geometry.face_vector_areas(each) for each in (alone, among)]
    np.testing.assert_allclose(areas[0], areas[1][:-1], atol=ROUND_OFF)
    expected = geometry.signed_volume(alone), geometry.total_area(alone)
    assert geometry.volume_and_area(alone) == pytest.approx(expected, abs=ROUND_OFF)
    assert geometry.total_area(alone) == pytest.approx(geometry.total_area(among), abs=ROUND_OFF)


@pytest.mark.parametrize("n", [3, 5, 12])
def test_polygons_of_any_size(n: int) -> None:
    area = n / 2.0 * np.sin(2.0 * np.pi / n)
    np.testing.assert_allclose(geometry.face_vector_areas(polygon(n)), [[0.0, 0.0, area]], atol=ROUND_OFF)
    assert geometry.signed_volume(prism(n)) == pytest.approx(area, abs=ROUND_OFF)
    assert geometry.total_area(prism(n)) == pytest.approx(2.0 * area + 2.0 * n * np.sin(np.pi / n), abs=ROUND_OFF)


def test_concave_polygon() -> None:
    dart = mesh_of([(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)], [[0, 1, 2, 3]])
    # Two triangles of base 0.5 and height 1, about the dart's axis.
    np.testing.assert_allclose(geometry.face_areas(dart), [0.5], atol=ROUND_OFF)


def test_sphere_converges_to_the_analytic_one() -> None:
    errors = [abs(geometry.signed_volume(quad_sphere(n)) / (4.0 / 3.0 * np.pi) - 1.0) for n in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.05)  # chords of a circle: second order
    assert errors[-1] < 2e-3


@pytest.mark.parametrize("mesh", [quad_sphere(6), torus(9, 7), prism(7), tetrahedron(), open_cube()])
def test_volume_does_not_depend_on_place_and_first_corner(mesh: PolygonMesh) -> None:
    volume = geometry.signed_volume(mesh)
    # Coordinates of 1e6 are rounded at 1e-10, which moves the surface by as much.
    assert geometry.signed_volume(replace(mesh, points=mesh.points + 1e6)) == pytest.approx(volume, rel=1e-8)
    if (mesh.face_vertex_counts == 4).all():
        turned = np.roll(mesh.face_vertex_indices.reshape(-1, 4), 1, axis=1).ravel()
        assert geometry.signed_volume(replace(mesh, face_vertex_indices=turned)) == pytest.approx(volume, abs=ROUND_OFF)


@pytest.mark.parametrize("mesh", [quad_sphere(5), torus(9, 7), prism(7), cube()])
def test_quad_volume_is_the_mean_of_its_triangulations_by_trimesh(mesh: PolygonMesh) -> None:
    volumes = []
    for shift in (0, 1):
        faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
        shifted = mesh_of(mesh.points, [np.roll(face, shift).tolist() for face in faces])
        triangles, _ = geometry.triangulate(shifted)
        volumes.append(trimesh.Trimesh(mesh.points, triangles, process=False).volume)
    assert geometry.signed_volume(mesh) == pytest.approx(np.mean(volumes), abs=ROUND_OFF)


def test_triangle_meshes_agree_with_trimesh() -> None:
    reference = trimesh.creation.icosphere(subdivisions=2)
    mesh = mesh_of(reference.vertices, reference.faces.tolist())
    assert geometry.signed_volume(mesh) == pytest.approx(reference.volume, rel=1e-12)
    assert geometry.total_area(mesh) == pytest.approx(reference.area, rel=1e-12)
    np.testing.assert_allclose(geometry.face_centers(mesh), reference.triangles_center, atol=ROUND_OFF)


def test_vertex_normal_is_the_mean_of_unit_normals() -> None:
    # A big face and a small one at right angles count alike; the face without area counts nothing.
    points = [(0, 0, 0), (10, 0, 0), (10, 9, 0), (0, 9, 0), (0, 0, -1), (1, 0, -1), (1, 0, 0), (5, 5, 5)]
    mesh = mesh_of(points, [[0, 1, 2, 3], [0, 6, 5, 4], [0, 1, 1]])
    normals = geometry.vertex_normals(mesh)
    np.testing.assert_allclose(normals[0], np.array([0, 1, 1]) / np.sqrt(2.0), atol=ROUND_OFF)
    np.testing.assert_allclose(normals[1], [0, 0, 1], atol=ROUND_OFF)
    np.testing.assert_array_equal(normals[7], 0.0)  # of no face


def test_triangulate() -> None:
    mesh = mesh_of(np.eye(6, 3), [[0, 1, 2], [2, 3, 4, 5], [0, 1, 2, 3, 4]])
    triangles, face = geometry.triangulate(mesh)
    assert triangles.tolist() == [[0, 1, 2], [2, 3, 4], [2, 4, 5], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert face.tolist() == [0, 1, 1, 2, 2, 2]
    assert (triangles.dtype, face.dtype) == (np.int32, np.int32)


def test_first_coincident() -> None:
    points = np.array([(1, 2, 3), (0, 0, 0), (1, 2, 3), (-0.0, 0, 0), (1, 2, 3.0000001)])
    assert geometry.first_coincident(points).tolist() == [0, 1, 0, 1, 4]


def double_torus() -> PolygonMesh:
    """Return two tori without a quad each, glued along its border."""
    torus_a = torus(6, 6)
    quads = torus_a.face_vertex_indices.reshape(-1, 4)
    hole = quads[0].tolist()
    offset = torus_a.vertex_count
    # Glued along the same four vertices, the second torus must run the other way around them.
    second = quads[1:, ::-1] + offset
    for vertex in hole:
        second[second == vertex + offset] = vertex
    return mesh_of(np.zeros((2 * offset, 3)), [*quads[1:].tolist(), *second.tolist()])


FINS = mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
KNOWN = {
    "cube": (cube(), 0, True, 1, 0, 2, True),
    "tetrahedron": (tetrahedron(), 0, True, 1, 0, 2, True),
    "prism": (prism(6), 0, True, 1, 0, 2, True),
    "quad sphere": (quad_sphere(5), 0, True, 1, 0, 2, True),
    "torus": (torus(7, 5), 0, True, 1, 1, 0, True),
    "double torus": (double_torus(), 0, True, 1, 2, -2, True),
    "torus and cube": (joined(torus(7, 5), cube()), 0, True, 2, 1, 2, True),
    "grid": (grid(3, 2), 10, True, 1, None, 1, True),
    "Moebius strip": (moebius(9), 18, True, 1, None, 0, False),
    "even Moebius strip": (moebius(8), 16, True, 1, None, 0, False),
    "Klein bottle": (klein(6, 5), 0, True, 1, None, 0, False),
    "two quads at a vertex": (two_quads(), 8, False, 1, None, 1, True),
    "three triangles on an edge": (FINS, 6, False, 1, None, 1, None),
}
"""border edges, whether it is manifold, components, genus, Euler characteristic, and whether it is orientable"""


@pytest.mark.parametrize("case", KNOWN)
def test_known_topology(case: str) -> None:
    mesh, borders, manifold, components, handles, characteristic, orientable = KNOWN[case]
    edges = topology.mesh_edges(mesh)
    assert len(topology.border_edges(edges)) == borders
    assert topology.is_closed(edges) == (borders == 0)
    assert topology.is_manifold(mesh, edges) == manifold
    assert topology.component_count(mesh, edges) == components
    assert topology.genus(mesh, edges) == handles
    assert topology.euler_characteristic(mesh, edges) == characteristic
    assert orientable is None or topology.is_orientable(mesh, edges) == orientable


def test_edges_of_a_triangle_pair() -> None:
    edges = topology.mesh_edges(mesh_of(np.eye(4, 3), [[0, 1, 2], [2, 1, 3]]))
    assert edges.ends.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert edges.face_counts.tolist() == [1, 1, 2, 1, 1]


def test_turning_one_face_spoils_the_winding_and_nothing_else() -> None:
    mesh = cube()
    indices = mesh.face_vertex_indices.copy()
    indices[:4] = indices[:4][::-1]
    turned = replace(mesh, face_vertex_indices=indices)
    edges = topology.mesh_edges(turned)
    assert len(topology.inconsistent_edges(topology.mesh_edges(mesh))) == 0
    assert len(topology.inconsistent_edges(edges)) == 4
    assert topology.is_orientable(turned, edges)
    assert topology.genus(turned, edges) == 0


def test_non_manifold_parts_are_found() -> None:
    edges = topology.mesh_edges(FINS)
    assert edges.ends[topology.non_manifold_edges(edges)].tolist() == [[0, 1]]
    bow = two_quads()
    assert topology.non_manifold_vertices(bow, topology.mesh_edges(bow)).tolist() == [2]
    # Two cubes that touch at a corner are closed, and each edge has two faces.
    pair = joined(cube(), cube())
    touching = replace(pair, face_vertex_indices=np.where(pair.face_vertex_indices == 8, 7, pair.face_vertex_indices))
    assert topology.is_closed(topology.mesh_edges(touching))
    assert topology.non_manifold_vertices(touching, topology.mesh_edges(touching)).tolist() == [7]


def test_a_repeated_corner_makes_no_edge_and_no_hole() -> None:
    faces = [[0, 2, 1], [0, 1, 1, 3], [1, 2, 3], [0, 3, 2]]
    mesh = mesh_of(tetrahedron().points, faces)
    edges = topology.mesh_edges(mesh)
    assert edges.count == 6
    assert topology.is_manifold(mesh, edges)
    assert topology.genus(mesh, edges) == 0


def test_unused_vertices_are_no_component() -> None:
    mesh = replace(cube(), points=np.concatenate([cube().points, np.ones((2, 3))]))
    assert topology.unused_vertices(mesh).tolist() == [8, 9]
    assert topology.component_count(mesh, topology.mesh_edges(mesh)) == 1
    assert topology.genus(mesh, topology.mesh_edges(mesh)) == 0


@pytest.mark.parametrize("seed", range(5))
def test_component_labels_of_random_graphs(seed: int) -> None:
    first, second = np.random.default_rng(seed).integers(0, 200, size=(2, 150))
    expected = list(range(200))
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        low, high = sorted((expected[a], expected[b]))
        expected = [low if label == high else label for label in expected]
    assert component_labels(200, first, second).tolist() == expected


def test_component_labels_of_a_shuffled_chain() -> None:
    nodes = np.random.default_rng(1).permutation(10_000)
    assert (component_labels(10_000, nodes[:-1], nodes[1:]) == 0).all()
