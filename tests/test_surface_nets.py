"""Surface nets around spheres and tori, whose measures are known."""

import numpy as np
import pytest
from numpy.typing import NDArray
from quads import assert_closed_quads, assert_none_folded, edge_lengths, sphere_distance

from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.mesh.surface_nets import extract, surface_nets
from balloon_warp.mesh.topology import is_manifold, mesh_edges


def torus_distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = points.T
    return np.hypot(np.hypot(x, z) - 1.0, y) - 0.4


def test_sphere_lies_on_its_distance() -> None:
    mesh = surface_nets(sphere_distance, [-1.1] * 3, [1.1] * 3, cell=0.1)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # float64 Newton steps on an exact distance
    assert np.abs(sphere_distance(mesh.points)).max() < 1e-12
    # Chords of a tenth of the radius: the relative loss is about (0.1)^2 / 4 in volume, half of that in area.
    assert signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi, rel=5e-3)
    assert signed_volume(mesh) < 4.0 / 3.0 * np.pi
    assert total_area(mesh) == pytest.approx(4.0 * np.pi, rel=3e-3)


def test_quads_come_out_even() -> None:
    mesh = surface_nets(sphere_distance, [-1.1] * 3, [1.1] * 3, cell=0.1)
    lengths = edge_lengths(mesh)
    # Before relaxation the ratio is 2.5; with valences from 3 to 6 it comes to 1.6.
    assert lengths.max() / lengths.min() < 1.75
    valence = np.bincount(mesh_edges(mesh).ends.ravel())
    assert valence.min() == 3
    assert valence.max() <= 6


def test_symmetry_of_the_distance_is_kept() -> None:
    mesh = surface_nets(sphere_distance, [-1.1] * 3, [1.1] * 3, cell=0.1)
    mirrored = mesh.points * [-1.0, 1.0, 1.0]
    apart = np.linalg.norm(mesh.points[:, None] - mirrored[None], axis=2).min(axis=1)
    # Warp places the first vertices in float32.
    assert apart.max() < 1e-6


def test_a_slit_narrower_than_a_cell_is_bridged() -> None:
    def slit_ball(points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of a ball split down to its middle, 0.06 wide."""
        slit = np.maximum(np.abs(points[:, 0]) - 0.03, -points[:, 1])
        return np.maximum(sphere_distance(points), -slit)

    mesh = surface_nets(slit_ball, [-1.1] * 3, [1.1] * 3, cell=0.1)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # Nowhere does the surface sink into the slit.
    assert np.linalg.norm(mesh.points, axis=1).min() > 0.97


def test_torus_has_genus_one() -> None:
    mesh = surface_nets(torus_distance, [-1.5, -0.5, -1.5], [1.5, 0.5, 1.5], cell=0.1)
    assert_closed_quads(mesh, holes_through=1)
    assert_none_folded(mesh)
    # As on the sphere, the chord loss about a circle of 0.4: (0.1 / 0.4)^2 / 12 in area of its section, twice at most.
    assert signed_volume(mesh) == pytest.approx(2.0 * np.pi**2 * 0.4**2, rel=1.5e-2)


def test_every_edge_has_two_faces_whatever_the_samples() -> None:
    values = np.random.default_rng(5).normal(size=(14, 15, 16))
    for axis in range(3):
        np.moveaxis(values, axis, 0)[[0, -1]] = 1.0
    mesh = extract(values, np.zeros(3), 1.0)
    edges = mesh_edges(mesh)
    assert mesh.face_count > 1000
    assert (edges.face_counts == 2).all()
    assert is_manifold(mesh, edges)
