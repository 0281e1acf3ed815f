"""Faces of membranes as blocks go through them, where they hand out area vectors, too: on a GPU alone otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from lone_films import QUADS, TRIANGLES, measured, measured_at_ends, moved
from meshes import cube, grid, mesh_of, prism, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Material, Scene
from balloon_warp.scene.schema.material import Kind
from balloon_warp.schedules.films import film_layout, held_layout, shapes_of, sums_of
from balloon_warp.schedules.membranes import membrane_quads
from balloon_warp.schedules.pairs import paired
from balloon_warp.schedules.traits import model_traits


@pytest.mark.parametrize(("mesh", "held"), [(QUADS, 0), (QUADS, 1), (QUADS, 2), (TRIANGLES, 0)])
def test_area_vectors_are_the_gradient_of_the_volume(mesh: PolygonMesh, held: int) -> None:
    """Of a volume that is cubic in each place, central differences are exact but for rounding, 1e-10 over 1e-4."""
    points = moved(mesh, 1.0)
    _, found = measured(mesh, points, held)
    np.testing.assert_allclose(found, gradient(mesh, points.astype(np.float64)), atol=1e-7)


@pytest.mark.parametrize("held", [1, 2])
@pytest.mark.parametrize("kind", ["neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.6], ids=["slack", "wrinkled here and there", "taut"])
def test_quads_pull_alike_whether_threads_keep_them(stretch: float, kind: Kind, held: int) -> None:
    """Up to float32's rounding; and all pulls add up to nothing."""
    points = moved(QUADS, stretch)
    kept, read = (measured(QUADS, points, each, kind)[0] for each in (held, 0))
    largest = np.abs(read).max()
    assert largest > 0.0
    np.testing.assert_allclose(kept, read, atol=2e-5 * largest)
    np.testing.assert_allclose(kept.sum(axis=0), 0.0, atol=1e-5 * largest)


@pytest.mark.parametrize("kind", ["neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("stretch", [0.9, 1.6], ids=["slack", "taut"])
def test_pairs_pull_alike_where_threads_have_their_ends(stretch: float, kind: Kind) -> None:
    points = moved(QUADS, stretch)
    kept, read = measured_at_ends(QUADS, points, kind), measured(QUADS, points, 0, kind)
    for of_ends, expected in zip(kept, read, strict=True):
        np.testing.assert_allclose(of_ends, expected, atol=2e-5 * np.abs(expected).max())


def uneven() -> PolygonMesh:
    """Quads with angles of all kinds."""
    mesh = grid(12, 12)
    aside = np.random.default_rng(0).uniform(-0.25, 0.25, (len(mesh.points), 3))
    return replace(mesh, points=np.asarray(mesh.points) + aside)


@pytest.mark.parametrize("mesh", [QUADS, uneven()], ids=["sphere", "uneven"])
def test_taut_quads_of_a_linear_law_are_told_by_sums(mesh: PolygonMesh) -> None:
    """They bound the trace of each triangle from above, whatever shape it has taken; also one that is flat, whose edges
    are each other's opposite."""
    quads = membrane_quads(build_model(Scene(balloon=[Balloon(mesh=mesh, material=Material(preset="latex"))]), "cpu"))
    steep = sums_of(quads)[2, :, 2:]
    d1, beside = np.random.default_rng(0).normal(size=(2, len(steep), 3))
    for d2 in (beside, -d1):
        squares = np.stack([(d**2).sum(axis=1) for d in (d1, d2, d2 - d1)], axis=1)
        for corner in range(4):
            cotangents = shapes_of(quads)[:, corner, :3]
            of_corner = np.roll(steep, -corner, axis=1)
            assert ((cotangents * squares).sum(axis=1) <= (of_corner * squares[:, :2]).sum(axis=1) * (1.0 + 1e-6)).all()


def paired_corners(corners: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the two quads of each pair, turned."""
    ordered = (np.arange(4) + pairs[:, 2:, None]) % 4
    first, second = (np.take_along_axis(corners[pairs[:, n]], ordered[:, n], axis=1) for n in (0, 1))
    return first, second


@pytest.mark.parametrize(
    ("mesh", "most"), [(quad_sphere(9), 3), (quad_sphere(4), 3), (cube(), 3), (grid(4, 4), 3), (grid(2, 5), 3)]
)
def test_each_quad_is_in_a_pair_that_shares_an_edge(mesh: PolygonMesh, most: int) -> None:
    corners = mesh.face_vertex_indices.reshape(-1, 4).astype(np.int64)
    pairs = paired(corners, np.zeros(len(corners), dtype=np.int64))
    np.testing.assert_array_equal(np.sort(pairs[:, :2], axis=None), np.arange(len(corners)))
    first, second = paired_corners(corners, pairs)
    np.testing.assert_array_equal(first[:, 1:3], second[:, [0, 3]])
    assert np.bincount(np.concatenate([first, second[:, 1:3]], axis=1).ravel()).max() <= most


def test_some_meshes_have_no_such_pairs() -> None:
    """Nine quads; three in a T of four, whose fourth has no neighbor that is free; two that are wound against each
    other."""
    strip = grid(3, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    branch = np.concatenate([strip, [[5, 6, 9, 8]]])  # at the middle
    against = grid(2, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    against[1] = against[1, ::-1]
    odd = grid(3, 3).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    for corners in (odd, branch, against):
        assert len(paired(corners, np.zeros(len(corners), dtype=np.int64))) == 0


def test_no_pair_is_of_two_balloons() -> None:
    corners = quad_sphere(2).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    both = np.concatenate([corners, corners + corners.max() + 1])
    balloons = np.repeat([0, 1], len(corners))
    pairs = paired(both, balloons)
    assert len(pairs) == len(corners)
    assert (balloons[pairs[:, 0]] == balloons[pairs[:, 1]]).all()
    strip = grid(2, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    assert len(paired(strip, np.array([0, 0]))) == 1
    assert len(paired(strip, np.array([0, 1]))) == 0


def test_threads_keep_single_quads_where_some_have_no_pair() -> None:
    mesh = prism(4)  # without its lid: five quads
    mesh = mesh_of(mesh.points.tolist(), mesh.face_vertex_indices.reshape(-1, 4)[1:].tolist())
    material = Material(preset="latex")
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, material=material)]), "cpu")
    film = film_layout(model, model_traits(model))
    assert film is not None
    held = held_layout(model, film, 6, 3)
    assert held == film._replace(held=6)


def gradient(mesh: PolygonMesh, points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Of the enclosed volume by each place [m^2]."""
    found = np.zeros_like(points)
    for place in np.ndindex(*points.shape):
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[place] += sign * step
            found[place] += sign * signed_volume(replace(mesh, points=moved)) / (2.0 * step)
    return found
