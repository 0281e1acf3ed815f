"""Fidelity of remeshing: closed, every part in one piece; or a sentence gives the reason."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import joined, mesh_of, quad_sphere
from quads import assert_closed_quads
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.fidelity import infidelity
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.remesh import remesh
from balloon_warp.mesh.topology import mesh_edges

BALL = quad_sphere(8)


def at(mesh: PolygonMesh, place: tuple[float, float, float], size: float) -> PolygonMesh:
    return replace(mesh, points=mesh.points * size + np.array(place))


def rod(heights: np.ndarray, radii: np.ndarray) -> PolygonMesh:
    """Return a rod along y, 12 faces around, closed by one at either end."""
    turn = 2.0 * np.pi * np.arange(12) / 12
    points = [(r * np.cos(t), y, r * np.sin(t)) for y, r in zip(heights, radii, strict=True) for t in turn]
    faces = [[*range(12)], [*range(len(points) - 12, len(points))][::-1]]
    for low in range(0, len(points) - 12, 12):
        faces += [[low + n, low + 12 + n, low + 12 + (n + 1) % 12, low + (n + 1) % 12] for n in range(12)]
    return mesh_of(points, faces)


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_a_rod_of_any_thickness_stays_in_one_piece(lean: float) -> None:
    """A rod stays in one piece, from thinner than a cell of 1/8 to thicker than two."""
    heights = np.linspace(0.0, 3.0, 60)
    mesh = rod(heights, 0.015 + 0.05 * heights)
    mesh = replace(mesh, points=mesh.points + np.outer(mesh.points[:, 1], [lean, 0.0, 0.0]))
    made = remesh(mesh, 24)
    assert_closed_quads(made)
    assert not [warning for warning in made.warnings if "were used" in warning]


def test_sheets_one_behind_the_other_are_closed() -> None:
    """Sheets one behind the other, as strips of hair, are closed: their winding number exceeds 1 outside."""
    square = mesh_of([(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)], [[0, 1, 2, 3]])
    sheets = [replace(square, points=square.points + (0.0, 0.02 * n, 0.0)) for n in range(9)]
    made = remesh(joined(*sheets), 12)
    assert made.face_count > 100
    assert (mesh_edges(made).face_counts == 2).all()


@pytest.mark.full
def test_more_cells_are_taken_where_a_part_would_be_lost_and_it_is_said() -> None:
    mesh = remesh(joined(BALL, at(BALL, (1.8, 0.0, 0.0), 0.14)), 15)
    assert_closed_quads(mesh, parts=2)
    assert mesh.warnings[0].startswith("With 15 cells the surface near (")
    assert mesh.warnings[0].endswith(") is lost: 34 were used.")


def test_what_is_lost_with_more_cells_too_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    source, target = tmp_path / "far.obj", tmp_path / "out.obj"
    write_obj(source, joined(BALL, at(BALL, (9.0, 0.0, 0.0), 0.6)))
    result = CliRunner().invoke(app, ["remesh", str(source), "-o", str(target), "--cells", "8"])
    assert isinstance(result.exception, InputError)
    assert str(result.exception).startswith("far: with 18 cells the surface near (")
    assert str(result.exception).endswith(") is lost; expected --cells 36, or a surface without that")
    assert list(tmp_path.iterdir()) == [source]


def test_what_is_not_faithful_is_found() -> None:
    small = at(BALL, (0.0, 0.0, 0.0), 0.5)
    assert infidelity(BALL, BALL, 0.1) is None
    assert "is lost" in str(infidelity(BALL, small, 0.1))
    assert infidelity(joined(BALL, small), BALL, 0.1) is None  # it lies within
    one_gone = replace(BALL, face_vertex_counts=BALL.face_vertex_counts[1:])
    one_gone = replace(one_gone, face_vertex_indices=BALL.face_vertex_indices[4:])
    assert infidelity(BALL, one_gone, 0.1) == "4 of its edges are open or crossed"
    assert infidelity(BALL, joined(BALL, small), 0.1) == "it has 2 parts instead of 1"


def test_a_part_in_pieces_is_found() -> None:
    whole, half = rod(np.linspace(0.0, 3.0, 60), np.full(60, 0.2)), rod(np.linspace(0.0, 1.47, 30), np.full(30, 0.2))
    halves = joined(half, replace(half, points=half.points + (0.0, 1.53, 0.0)))
    assert infidelity(halves, halves, 0.1) is None
    assert str(infidelity(whole, halves, 0.1)).startswith("one part breaks into pieces near (")
