"""Welding: everywhere, and along seams alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.seams import welded, welded_along_seams
from balloon_warp.mesh.topology import component_count, is_closed, mesh_edges
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Scene, String
from balloon_warp.simulator import Simulator


def loose(mesh: PolygonMesh) -> PolygonMesh:
    """Each face with corners of its own."""
    corners = mesh.face_vertex_indices
    return replace(mesh, points=mesh.points[corners], face_vertex_indices=np.arange(len(corners), dtype=np.int32))


def test_welding_takes_the_first_vertex_at_a_place_and_tells_how_many_went() -> None:
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0), (2, 0, 0), (1, 1, -0.0), (0, 0, 0)]
    mesh = welded(mesh_of(points, [[0, 1, 2], [3, 4, 5]]))
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 1, 4, 2]
    assert mesh.stand_ins is not None
    assert mesh.stand_ins.tolist() == [0, 1, 2, 1, 4, 2, 0]
    assert mesh.warnings == (
        "2 vertices that lay exactly on others have been welded to them: they keep their numbers and move along.",
    )
    whole = cube()
    assert welded(whole) is whole


@pytest.mark.parametrize("mesh", [cube(), quad_sphere(4)])
def test_seams_are_welded_until_the_mesh_is_closed(mesh: PolygonMesh) -> None:
    sewn = prepared(loose(mesh), "mesh", Treatment())
    edges = mesh_edges(sewn)
    assert is_closed(edges)
    assert (edges.count, component_count(sewn, edges)) == (mesh_edges(mesh).count, 1)
    assert sewn.vertex_count == len(mesh.face_vertex_indices)  # all keep their numbers
    assert len(sewn.warnings) == 1


def test_bodies_that_touch_stay_apart() -> None:
    """At a corner, along an edge and over a face: closed ones have no seam, and those of an open one end elsewhere."""
    for shift in ((1, 1, 1), (1, 1, 0), (1, 0, 0)):
        touching = joined(cube(), replace(cube(), points=cube().points + shift))
        assert welded_along_seams(touching) is touching
    corners = joined(grid(1, 1), replace(grid(1, 1), points=grid(1, 1).points + (1, 1, 0)))
    assert welded_along_seams(corners) is corners
    assert len(welded(corners).left_vertices) == 1


def test_two_loose_cubes_at_a_corner_become_two_cubes() -> None:
    """What lies at one place is one vertex for each of them."""
    pair = joined(loose(cube()), loose(replace(cube(), points=cube().points + (1, 1, 1))))
    sewn = prepared(pair, "pair", Treatment())
    assert component_count(sewn, mesh_edges(sewn)) == 2
    assert len(np.unique(sewn.face_vertex_indices)) == 16


def test_a_seam_with_a_point_in_it_is_no_seam_there() -> None:
    """Two quads beside a longer one: no edge of theirs lies on its edge from end to end."""
    wide = mesh_of([(0, -1, 0), (2, -1, 0), (2, 0, 0), (0, 0, 0)], [[0, 1, 2, 3]])
    apart = joined(grid(2, 1), wide)
    assert welded_along_seams(apart) is apart


def test_numbers_of_welded_vertices_mean_the_ones_that_stand_in(tmp_path: Path, device: str) -> None:
    """Fixed or on a string, and in every frame at the place of its other half."""
    mesh = loose(quad_sphere(2))
    sewn = prepared(mesh, "mesh", Treatment())
    left = int(sewn.left_vertices[-1])
    balloon = Balloon(mesh=mesh, fixed=[left])
    scene = Scene(balloon=[balloon], string=[String(anchor=(0.0, 3.0, 0.0), particle=left)], substeps=4)
    assert shape_balloon(balloon, scene).mass_share[sewn.stand_in(left)] == 0.0
    simulator = Simulator(scene.model_copy(update={"balloon": [Balloon(mesh=mesh)]}), device)
    assert simulator.model.string_particle.numpy().tolist() == [sewn.stand_in(left)]
    for _ in range(3):
        simulator.step()
    frame = simulator.read_frame()
    assert np.abs(frame.points[0] - mesh.points).max() > 1e-3
    assert sewn.stand_ins is not None
    for array in (frame.points[0], frame.velocities[0]):
        np.testing.assert_array_equal(array, array[sewn.stand_ins])
