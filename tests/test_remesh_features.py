"""Features that remeshing keeps: volume, thin parts, tips; and its early refusals."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import grid, joined, quad_sphere
from odd_meshes import box, deformed
from odd_things import car, hair, haired, head, sword
from quads import assert_closed_quads, assert_none_folded

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.fit import unfolded
from balloon_warp.mesh.geometry import signed_volume, triangulate
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.remesh import remesh


def standing_out(surface: PolygonMesh, made: PolygonMesh, cells: int) -> float:
    """Return the largest distance of a vertex of the surface outside of the result [cells]."""
    cell = float(np.ptp(surface.points, axis=0).max()) / cells
    distance = MeshDistance(made.points / cell, triangulate(made)[0], thickness=0.0)
    return float(distance(surface.points / cell).max())


def test_a_blade_keeps_its_volume() -> None:
    """A blade a sixth of a cell thick keeps its volume, where a slab had seven times that."""
    made = remesh(sword(), 48)
    assert_closed_quads(made)
    assert made.warnings == ()
    assert signed_volume(made) == pytest.approx(signed_volume(sword()), rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize("thickness", [0.05, 0.5, 1.2])
def test_a_plate_keeps_its_volume(thickness: float) -> None:
    """A plate so many cells thick keeps its volume."""
    plate = box((0.0, 0.0, 0.0), (1.0, 0.6, thickness / 24.0), (24, 12, 1))
    made = remesh(plate, 24)
    assert_closed_quads(made)
    assert_none_folded(made)
    assert signed_volume(made) == pytest.approx(signed_volume(plate), rel=0.1)


def test_a_thin_rod_keeps_its_volume() -> None:
    """A rod of a cell and less across keeps its volume, though a chord of it is well within."""
    rod = deformed(quad_sphere(8, 0.5), lambda p: p * [1.0, 0.05, 0.05])
    made = remesh(rod, 24)
    assert signed_volume(made) == pytest.approx(signed_volume(rod), rel=0.1)


@pytest.mark.full
def test_ears_and_nose_stay() -> None:
    """Ears and nose keep their length, where thin ears lost a cell of theirs."""
    made = remesh(head(), 32)
    assert_closed_quads(made)
    assert_none_folded(made)
    assert standing_out(head(), made, 32) < 0.5
    assert signed_volume(made) == pytest.approx(signed_volume(head()), rel=0.02)


def test_what_folds_goes_back_and_nothing_else() -> None:
    """A vertex moved across its neighbors goes back; one that only moves outward stays."""
    ball = quad_sphere(8, 0.5)
    first, other = int(ball.points[:, 0].argmax()), int(ball.points[:, 0].argmin())
    points = ball.points.copy()
    points[first] += (0.0, 0.5, 0.0)
    points[other] *= 1.1
    made = unfolded(ball, replace(ball, points=points))
    assert_none_folded(made)
    np.testing.assert_array_equal(made.points[first], ball.points[first])
    np.testing.assert_array_equal(made.points[other], points[other])


def test_corners_of_a_box_stay() -> None:
    cube = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (4, 4, 4))
    assert standing_out(cube, remesh(cube, 12), 12) < 0.2


def test_a_car_is_made_with_the_cells_that_are_asked_for() -> None:
    made = remesh(car(windshield=False), 32)
    assert_closed_quads(made)
    assert not [warning for warning in made.warnings if "were used" in warning]


def test_hair_is_refused_before_it_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    def far(*_: object) -> None:
        raise AssertionError("it was begun")

    monkeypatch.setattr("balloon_warp.mesh.remesh._quads", far)
    with pytest.raises(InputError, match=r"200 of its 200 parts are open, like hair, .* expected a surface with an"):
        remesh(hair(), 48)
    with pytest.raises(InputError, match=r"60 of its 61 parts are open, like hair, .* expected --parts closed"):
        remesh(haired(), 48)


def test_patches_of_a_whole_are_no_hair() -> None:
    """A ball in 24 patches without shared vertices is no hair."""
    ball = quad_sphere(8, 0.5)
    quads = ball.face_vertex_indices.reshape(-1, 4)
    parts = [joined_of(ball, part) for part in np.array_split(quads, 24)]
    made = remesh(joined(*parts), 16)
    assert_closed_quads(made)
    assert signed_volume(made) == pytest.approx(signed_volume(ball), rel=0.05)


def joined_of(mesh: PolygonMesh, quads: np.ndarray) -> PolygonMesh:
    """Return some of the quads, a little smaller, so that there are cracks beside them."""
    used, numbers = np.unique(quads, return_inverse=True)
    points = mesh.points[used]
    part = grid(1, 1)
    middle = points.mean(axis=0)
    return PolygonMesh(
        points=middle + 0.999 * (points - middle),
        face_vertex_counts=np.full(len(quads), 4, dtype=np.int32),
        face_vertex_indices=numbers.ravel().astype(part.face_vertex_indices.dtype),
    )


def test_too_many_quads_are_refused_with_a_number_that_works() -> None:
    many = joined(*(deformed(grid(4, 4), lambda p, z=z: p + [0.0, 0.0, z]) for z in np.linspace(0.0, 4.0, 9)))
    with pytest.raises(InputError, match=r"256 cells would make .* quads; expected --cells 1\d\d or fewer"):
        remesh(many, 256)
