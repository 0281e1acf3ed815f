"""Solid shapes: bundled models, thin obstacles, points on which bodies stand, and boxes with round edges."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from meshes import box, joined, mesh_of, quad_sphere
from quads import assert_none_folded, edge_lengths

import balloon_warp.scenes
from balloon_warp import Balloon, Obstacle, Scene, load_mesh
from balloon_warp.mesh import PolygonMesh, topology
from balloon_warp.mesh.topology import component_count, genus, inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model.obstacles import MOST_SAMPLES, ObstacleShape, is_thin, sample, shape_obstacle
from balloon_warp.scenes.models import MODELS, make_model
from balloon_warp.usd.solids import OF_LARGEST, OF_LEAST, beveled_box


@cache
def bundled(name: str) -> PolygonMesh:
    return load_mesh(Path(balloon_warp.scenes.__path__[0]) / f"{name}.obj")


@pytest.mark.full
@pytest.mark.parametrize("name", MODELS)
def test_file_is_what_the_script_makes(name: str) -> None:
    made, file = make_model(name), bundled(name)
    np.testing.assert_array_equal(made.face_vertex_indices, file.face_vertex_indices)
    # Written to 1e-5; other machines round sines and square roots their own way.
    np.testing.assert_allclose(made.points, file.points, atol=1e-4)


@pytest.mark.parametrize("name", [name for name in MODELS if "airbag" not in name])  # sewn of flat squares
def test_one_closed_skin_of_even_quads(name: str) -> None:
    mesh = bundled(name)
    edges = mesh_edges(mesh)
    assert (mesh.face_vertex_counts == 4).all()
    assert (edges.face_counts == 2).all()
    assert genus(mesh, edges) == (name == "slot")  # its hole; None where the mesh is not manifold
    assert (component_count(mesh, edges), len(inconsistent_edges(edges))) == (1, 0)
    assert topology.signed_volume(mesh) > 0.0
    valence = np.bincount(edges.ends.ravel())
    assert (valence.min(), valence.max() <= 6) == (3, True)
    lengths = edge_lengths(mesh)
    # As good as these come: 1.9 for the pillow, 2.2 for the bowl, about 3 where flippers and ears are near a cell thin.
    assert lengths.max() / lengths.min() < 3.3
    assert_none_folded(mesh)


@pytest.mark.parametrize(
    ("name", "fewest", "most", "longest"),
    [
        ("squirrel", 2000, 3000, 1.0),
        ("turtle", 2000, 3000, 1.1),
        ("pillow", 1200, 2000, 1.0),
        ("bowl", 1500, 2500, 1.0),
        ("knot", 2500, 3500, 0.97),
    ],
)
def test_size_and_place(name: str, fewest: int, most: int, longest: float) -> None:
    mesh = bundled(name)
    assert fewest <= mesh.vertex_count <= most
    assert np.ptp(mesh.points, axis=0).max() == pytest.approx(longest, abs=0.03)
    assert mesh.points[:, 1].min() == 0.0
    np.testing.assert_allclose(mesh.points[:, [0, 2]].mean(axis=0), 0.0, atol=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("name", ["squirrel", "turtle"])
def test_animals_are_symmetric(name: str) -> None:
    points = bundled(name).points
    apart = np.linalg.norm((points * [-1.0, 1.0, 1.0])[:, None] - points[None], axis=2).min(axis=1)
    # The last of five decimals.
    assert apart.max() < 2e-5


def test_squirrel_hangs_by_its_tail() -> None:
    """The tip of the tail is the highest vertex, behind the head, less than 30 degrees off the vertical."""
    mesh = bundled("squirrel")
    areas = topology.face_areas(mesh)
    centroid = (areas[:, None] * topology.face_centers(mesh)).sum(axis=0) / areas.sum()
    order = np.argsort(mesh.points[:, 1])
    tip = mesh.points[order[-1]]
    assert abs(tip[0]) < 1e-5
    assert tip[2] < -0.25
    up = (tip - centroid) / np.linalg.norm(tip - centroid)
    assert np.degrees(np.arccos(up[1])) < 30.0
    ears = mesh.points[(mesh.points[:, 2] > 0.0) & (mesh.points[:, 1] > 0.7)]
    assert 0.1 < tip[1] - ears[:, 1].max() < 0.25


def test_bowl_is_far_from_a_sphere_and_a_pillow_thin_and_pointed() -> None:
    mesh = bundled("bowl")
    assert 36.0 * np.pi * topology.signed_volume(mesh) ** 2 / topology.total_area(mesh) ** 3 < 0.3
    # Half of a shell between 0.39 and 0.5, and half of a torus as its rim (Pappus); chords lose about 1 %.
    rim = np.pi * 0.445 * np.pi * 0.055**2
    assert topology.signed_volume(mesh) == pytest.approx(2.0 / 3.0 * np.pi * (0.5**3 - 0.39**3) + rim, rel=2e-2)
    points = bundled("pillow").points
    assert np.ptp(points[:, 1]) == pytest.approx(0.25, abs=1e-4)
    # The middle of a side is pulled in behind the line from corner to corner.
    assert np.abs(points[np.abs(points[:, 2]) < 0.01, 0]).max() < 0.46
    assert np.abs(points[:, 0]).max() == pytest.approx(0.5, abs=1e-4)


UP = np.array([0.0, 1.0, 0.0])


def solid(mesh: PolygonMesh) -> ObstacleShape:
    """Return an obstacle of that mesh."""
    return shape_obstacle(0, Obstacle(mesh=mesh), Scene(balloon=[Balloon(mesh=quad_sphere(1))]))


def block(width: float, depth: float, height: float, x: float = 0.0, y: float = 0.0) -> PolygonMesh:
    """Return a block of faces outward, of some size, with its middle at a place."""
    return box((x, y, 0.0), (width, height, depth), (1, 1, 1))


def test_a_large_thing_with_thin_parts_is_thin() -> None:
    """A top of 40 mm, and legs of 50 mm, though the table is 0.7 m high and 1 m wide."""
    legs = [block(0.05, 0.05, 0.7, x, -0.4) for x in (-0.4, 0.4)]
    table = solid(joined(block(1.0, 1.0, 0.04), *legs))
    assert is_thin(table, 0.1)
    assert not is_thin(table, 0.03)


@pytest.mark.parametrize("mesh", [block(1.0, 1.0, 1.0), quad_sphere(8, 0.5)])
def test_what_is_thick_everywhere_is_not_thin(mesh: PolygonMesh) -> None:
    assert not is_thin(solid(mesh), 0.5)
    assert is_thin(solid(mesh), 1.01)


def test_a_mesh_of_many_vertices_stands_on_its_hull() -> None:
    """The turtle of 2,898 vertices: no plane that it lies on is more than the rounding of an edge into it."""
    turtle = solid(load_mesh(Path(balloon_warp.scenes.__path__[0]) / "turtle.obj"))
    samples = sample(turtle, UP)
    assert len(samples.points) == MOST_SAMPLES
    ways = np.random.default_rng(0).normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert turtle.mesh is not None
    whole = (turtle.mesh.points @ ways.T).max(axis=0)
    stands = samples.points[: samples.outermost]
    held = (stands[:, :3] @ ways.T + stands[:, 3:]).max(axis=0)
    assert (whole - held).max() < 1e-3 * turtle.reach


def test_a_small_mesh_stands_as_a_large_one() -> None:
    """Samples of a tetrahedron grow with it, from a gram to a mountain, as its balls do, which have room there."""
    points = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    sizes = (1e-3, 1.0, 1e3)
    found = [
        sample(solid(mesh_of(size * points, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])), UP).points / size
        for size in sizes
    ]
    assert (found[1][:, 3] > 0.0).all()
    for each in found:
        np.testing.assert_allclose(each, found[1], atol=1e-5)


@pytest.mark.parametrize("half", [(0.5, 0.5, 0.5), (1.0, 0.04, 1.0), (0.01, 3.0, 0.2), (1e-3, 1e-3, 1.0)])
def test_a_box_is_as_large_as_it_is_simulated_with_round_edges(half: tuple[float, float, float]):
    sides = np.array(half)
    box, normals = beveled_box(sides)
    assert is_closed(mesh_edges(box))
    np.testing.assert_allclose([-box.points.min(axis=0), box.points.max(axis=0)], np.tile(sides, (2, 1)), rtol=1e-9)
    # Faces look outward and are flat but for the edges, whose radius is some of the sides.
    radius = 2.0 * min(OF_LARGEST * sides.max(), OF_LEAST * sides.min())
    corner = box.points[np.argmax(box.points.sum(axis=1))]
    np.testing.assert_allclose(sides - corner, radius * (1.0 - 1.0 / np.sqrt(3.0)), rtol=1e-6)
    flat = (np.abs(np.abs(box.points) - sides) < 1e-9 * sides.max()).any(axis=1)
    assert np.abs(normals[flat]).max(axis=1) == pytest.approx(1.0)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert np.einsum("ij,ij->i", topology.vertex_normals(box), normals).min() > 0.98
    areas = np.linalg.norm(topology.face_vector_areas(box), axis=1)
    assert areas.min() > 0.0
    assert 0.7 * 8.0 * sides.prod() < topology.signed_volume(box) < 8.0 * sides.prod()
