"""Borders, manifoldness, winding, components and genus of meshes whose topology is known."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, moebius, prism, quad_sphere, tetrahedron, torus, two_quads_at_a_vertex

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    euler_characteristic,
    genus,
    inconsistent_edges,
    is_closed,
    is_manifold,
    is_orientable,
    mesh_edges,
    non_manifold_edges,
    non_manifold_vertices,
    unused_vertices,
)


def klein_bottle(n: int = 6, m: int = 5) -> PolygonMesh:
    """Return a torus whose tube is glued to itself mirrored: closed, and of one side. Its points do not matter."""
    faces = []
    for i in range(n):
        for j in range(m):
            here, there = (j, (j + 1) % m), (j, (j + 1) % m)
            if i == n - 1:
                there = ((-j) % m, (-j - 1) % m)
            right = (i + 1) % n
            faces.append([i * m + here[0], right * m + there[0], right * m + there[1], i * m + here[1]])
    return mesh_of(np.random.default_rng(0).normal(size=(n * m, 3)), faces)


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


# border edges, manifold, components, genus
KNOWN = {
    "cube": (cube(), 0, True, 1, 0),
    "tetrahedron": (tetrahedron(), 0, True, 1, 0),
    "prism": (prism(6), 0, True, 1, 0),
    "quad sphere": (quad_sphere(5), 0, True, 1, 0),
    "torus": (torus(7, 5), 0, True, 1, 1),
    "double torus": (double_torus(), 0, True, 1, 2),
    "torus and cube": (joined(torus(7, 5), cube()), 0, True, 2, 1),
    "grid": (grid(3, 2), 10, True, 1, None),
    "Moebius strip": (moebius(9), 18, True, 1, None),
    "Klein bottle": (klein_bottle(), 0, True, 1, None),
    "two quads at a vertex": (two_quads_at_a_vertex(), 8, False, 1, None),
    "three triangles on an edge": (mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]]), 6, False, 1, None),
}


@pytest.mark.parametrize("case", KNOWN)
def test_known_topology(case: str) -> None:
    mesh, borders, manifold, components, handles = KNOWN[case]
    edges = mesh_edges(mesh)
    assert len(border_edges(edges)) == borders
    assert is_closed(edges) == (borders == 0)
    assert is_manifold(mesh, edges) == manifold
    assert component_count(mesh, edges) == components
    assert genus(mesh, edges) == handles


@pytest.mark.parametrize(
    ("mesh", "expected"), [(cube(), 2), (torus(5, 5), 0), (moebius(6), 0), (grid(2, 2), 1), (klein_bottle(), 0)]
)
def test_euler_characteristic(mesh: PolygonMesh, expected: int) -> None:
    assert euler_characteristic(mesh, mesh_edges(mesh)) == expected


def test_edges_of_a_triangle_pair() -> None:
    edges = mesh_edges(mesh_of(np.eye(4, 3), [[0, 1, 2], [2, 1, 3]]))
    assert edges.ends.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert edges.face_counts.tolist() == [1, 1, 2, 1, 1]


def test_turning_one_face_spoils_the_winding_and_nothing_else() -> None:
    mesh = cube()
    indices = mesh.face_vertex_indices.copy()
    indices[:4] = indices[:4][::-1]
    turned = replace(mesh, face_vertex_indices=indices)
    edges = mesh_edges(turned)
    assert len(inconsistent_edges(mesh_edges(mesh))) == 0
    assert len(inconsistent_edges(edges)) == 4
    assert is_orientable(turned, edges)
    assert genus(turned, edges) == 0


@pytest.mark.parametrize(("mesh", "orientable"), [(moebius(8), False), (klein_bottle(), False), (torus(5, 4), True)])
def test_orientable(mesh: PolygonMesh, orientable: bool) -> None:
    assert is_orientable(mesh, mesh_edges(mesh)) == orientable


def test_non_manifold_parts_are_found() -> None:
    fins = mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    edges = mesh_edges(fins)
    assert edges.ends[non_manifold_edges(edges)].tolist() == [[0, 1]]
    bow = two_quads_at_a_vertex()
    assert non_manifold_vertices(bow, mesh_edges(bow)).tolist() == [2]
    # Two cubes that touch at a corner are closed, and each edge has two faces.
    pair = joined(cube(), cube())
    touching = replace(pair, face_vertex_indices=np.where(pair.face_vertex_indices == 8, 7, pair.face_vertex_indices))
    assert is_closed(mesh_edges(touching))
    assert non_manifold_vertices(touching, mesh_edges(touching)).tolist() == [7]


def test_a_repeated_corner_makes_no_edge_and_no_hole() -> None:
    faces = [[0, 2, 1], [0, 1, 1, 3], [1, 2, 3], [0, 3, 2]]
    mesh = mesh_of(tetrahedron().points, faces)
    edges = mesh_edges(mesh)
    assert edges.count == 6
    assert is_manifold(mesh, edges)
    assert genus(mesh, edges) == 0


def test_unused_vertices_are_no_component() -> None:
    mesh = replace(cube(), points=np.concatenate([cube().points, np.ones((2, 3))]))
    assert unused_vertices(mesh).tolist() == [8, 9]
    assert component_count(mesh, mesh_edges(mesh)) == 1
    assert genus(mesh, mesh_edges(mesh)) == 0


@pytest.mark.parametrize("seed", range(5))
def test_component_labels_of_random_graphs(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = 200
    first, second = random.integers(0, count, size=(2, 150))
    expected = list(range(count))
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        low, high = sorted((expected[a], expected[b]))
        expected = [low if label == high else label for label in expected]
    assert component_labels(count, first, second).tolist() == expected


def test_component_labels_of_a_shuffled_chain() -> None:
    nodes = np.random.default_rng(1).permutation(10_000)
    assert (component_labels(10_000, nodes[:-1], nodes[1:]) == 0).all()
