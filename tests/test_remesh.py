"""Surface nets and remeshing, against spheres, tori and boxes whose measures are known."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import warp as wp
from numpy.typing import NDArray
from quads import assert_closed_quads, assert_none_folded, edge_lengths, sphere_distance
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.mesh.remesh import remesh

CELLS = 24


def triangles_mesh(surface: trimesh.Trimesh) -> PolygonMesh:
    return PolygonMesh(
        points=np.array(surface.vertices),
        face_vertex_counts=np.full(len(surface.faces), 3, dtype=np.int32),
        face_vertex_indices=np.array(surface.faces, dtype=np.int32).ravel(),
    )


def without_faces(mesh: PolygonMesh, drop: NDArray[np.bool_]) -> PolygonMesh:
    kept = mesh.face_vertex_indices.reshape(-1, 3)[~drop]
    return replace(mesh, face_vertex_counts=mesh.face_vertex_counts[~drop], face_vertex_indices=kept.ravel())


def joined(*meshes: PolygonMesh) -> PolygonMesh:
    begins = np.cumsum([0] + [mesh.vertex_count for mesh in meshes])
    return PolygonMesh(
        points=np.concatenate([mesh.points for mesh in meshes]),
        face_vertex_counts=np.concatenate([mesh.face_vertex_counts for mesh in meshes]),
        face_vertex_indices=np.concatenate(
            [mesh.face_vertex_indices + begin for mesh, begin in zip(meshes, begins, strict=False)]
        ).astype(np.int32),
    )


def ball(radius: float = 1.0, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PolygonMesh:
    """Return a sphere of 5,120 triangles, whose faces deviate by up to 0.1 % of the radius."""
    surface = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    surface.apply_translation(center)
    return triangles_mesh(surface)


@pytest.mark.full
def test_remeshed_ball(device: str) -> None:
    with wp.ScopedDevice(device):
        mesh = remesh(ball(), CELLS)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    assert mesh.warnings == ()
    # The icosphere's own faces lie up to 0.1 % inside the sphere.
    assert np.abs(sphere_distance(mesh.points)).max() < 1.5e-3
    assert signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi, rel=1e-2)


@pytest.mark.full
def test_cells_are_the_quads_along_the_longest_side() -> None:
    ellipsoid = ball()
    ellipsoid = replace(ellipsoid, points=ellipsoid.points * [3.0, 1.0, 1.0])
    for cells in (24, 48):
        # Edges are about 0.85 of a cell: the slanted quads of a net are as long as a cell, and narrower.
        assert np.median(edge_lengths(remesh(ellipsoid, cells))) == pytest.approx(0.85 * 6.0 / cells, rel=0.1)


@pytest.mark.full
def test_hole_is_closed_by_a_membrane() -> None:
    whole = ball()
    centers = whole.points[whole.face_vertex_indices.reshape(-1, 3)].mean(axis=1)
    mesh = remesh(without_faces(whole, centers[:, 1] > 0.8), CELLS)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # A membrane between the flat one, at 0.8, and the missing cap, up to half a cell of slack.
    over_the_hole = mesh.points[np.hypot(mesh.points[:, 0], mesh.points[:, 2]) < 0.3]
    top = over_the_hole[over_the_hole[:, 1] > 0.0]
    assert len(top) > 10
    assert (top[:, 1] > 0.8 - 0.04).all()
    assert (np.linalg.norm(top, axis=1) < 1.0 + 1e-3).all()


@pytest.mark.full
def test_loose_and_flipped_triangles_make_one_skin() -> None:
    whole = ball()
    # Each triangle with three vertices of its own, as in an STL file, and shrunk by 1 %, so that each edge is a crack.
    corners = whole.points[whole.face_vertex_indices].reshape(-1, 3, 3)
    corners = corners.mean(axis=1, keepdims=True) + 0.99 * (corners - corners.mean(axis=1, keepdims=True))
    soup = replace(
        whole,
        points=corners.reshape(-1, 3),
        face_vertex_indices=np.arange(3 * whole.face_count, dtype=np.int32),
    )
    assert_closed_quads(remesh(soup, CELLS))

    flipped = whole.face_vertex_indices.reshape(-1, 3).copy()
    flipped[::3] = flipped[::3, ::-1]
    mesh = remesh(replace(whole, face_vertex_indices=flipped.ravel()), CELLS)
    assert_closed_quads(mesh)
    assert signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi, rel=1e-2)

    inside_out = whole.face_vertex_indices.reshape(-1, 3)[:, ::-1]
    assert_closed_quads(remesh(replace(whole, face_vertex_indices=inside_out.ravel()), CELLS))


def test_sheet_becomes_a_slab() -> None:
    sheet = PolygonMesh(
        points=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, 0.0]]),
        face_vertex_counts=np.array([4], dtype=np.int32),
        face_vertex_indices=np.array([0, 1, 2, 3], dtype=np.int32),
    )
    mesh = remesh(sheet, 20)
    assert_closed_quads(mesh)
    assert any("thinner" in warning for warning in mesh.warnings)
    # 1.5 cells of 0.1; the relaxed vertices of the round border may cut its corners.
    assert np.ptp(mesh.points[:, 1]) == pytest.approx(0.15, abs=0.005)


def test_wedge_keeps_its_edge_thin() -> None:
    prism = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=3)
    mesh = remesh(triangles_mesh(prism), CELLS)
    assert_closed_quads(mesh)
    assert mesh.warnings == ()
    assert (mesh.points.max(axis=0) < prism.bounds[1] + 1e-4).all()


@pytest.mark.full
def test_crumbs_are_left_out_and_parts_are_kept() -> None:
    cluster = joined(ball(), ball(0.6, (2.5, 0.0, 0.0)), ball(0.2, (0.0, 2.0, 0.0)), ball(0.04, (0.0, 0.0, 1.5)))
    mesh = remesh(cluster, 40)
    assert_closed_quads(mesh, parts=3)
    assert len(mesh.warnings) == 2
    assert "3 separate parts" in mesh.warnings[0]
    assert "1 crumb " in mesh.warnings[1]


def test_overlapping_balls_become_one() -> None:
    mesh = remesh(joined(ball(), ball(1.0, (1.0, 0.0, 0.0))), CELLS)
    assert_closed_quads(mesh)
    # Two balls less their lens, pi (4 + d) (2 - d)^2 / 12; the crease is rounded by half a cell.
    volume = 8.0 / 3.0 * np.pi - np.pi * 5.0 / 12.0
    assert signed_volume(mesh) == pytest.approx(volume, rel=1.5e-2)


def test_far_away_and_tiny_is_as_good() -> None:
    near = ball()
    far = replace(near, points=near.points * 1e-3 + 1e3)
    mesh = remesh(far, CELLS)
    # float64 leaves 1e-13 / 1e-3 of it; the rest is Warp's float32 in cells.
    assert np.abs(np.linalg.norm((mesh.points - 1e3) / 1e-3, axis=1) - 1.0).max() < 1.5e-3


@pytest.mark.parametrize("cells", [3, -1, 257, 100_000])
def test_bad_cells(cells: int) -> None:
    with pytest.raises(InputError, match=rf"^cells must be from 4 to 256 \(got {cells}\)$"):
        remesh(ball(), cells)


def test_mesh_without_size() -> None:
    point = replace(ball(), points=np.ones((2562, 3)))
    with pytest.raises(InputError, match="all vertices coincide"):
        remesh(point, CELLS)


def test_command(tmp_path: Path) -> None:
    source, target = tmp_path / "ball.obj", tmp_path / "out.obj"
    write_obj(source, ball())
    result = CliRunner().invoke(app, ["remesh", str(source), "-o", str(target), "--cells", "12"])
    assert result.exit_code == 0, result.output
    written = read_obj(target)
    assert_closed_quads(written)
    assert result.output.strip().endswith(f"{written.vertex_count:,} vertices, {written.face_count:,} quads")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["-o", "out.obj", "--cells", "2"], "cells must be from 4 to 256 (got 2)"),
        (["-o", "out.stl"], "out.stl: cannot write .stl; expected .obj"),
        (["-o", "nowhere/out.obj", "--cells", "8"], "nowhere/out.obj: the folder nowhere does not exist"),
        (["-o", "../here/ball.obj", "--cells", "8"], "ball.obj: is the input mesh; expected another name, with -o"),
    ],
)
def test_command_refuses(tmp_path: Path, monkeypatch, arguments: list[str], sentence: str) -> None:
    """The command refuses a wrong name and a folder that takes no files before the long measurement."""
    monkeypatch.setattr("balloon_warp.mesh.remesh.surface_nets", lambda *_, **__: pytest.fail("measured"))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_obj("ball.obj", ball())
    before = (folder / "ball.obj").read_bytes()
    result = CliRunner().invoke(app, ["remesh", "ball.obj", *arguments])
    assert isinstance(result.exception, InputError)
    assert sentence in str(result.exception)
    assert [path.name for path in folder.iterdir()] == ["ball.obj"]
    assert (folder / "ball.obj").read_bytes() == before


@pytest.mark.parametrize("name", ["spot_quadrangulated", "mh_fedora", "mh_casualsuit01", "mh_tongue"])
def test_real_meshes(name: str) -> None:
    folder = os.environ.get("BALLOON_WARP_TEST_MESHES")
    if not folder:
        pytest.skip("needs BALLOON_WARP_TEST_MESHES, a folder with the meshes")
    source = read_obj(Path(folder) / f"{name}.obj")
    mesh = remesh(source, 32)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # A slab of 1.5 cells stands out by less than a cell; crumbs and thin ends may be lost.
    cell = np.ptp(source.points, axis=0).max() / 32
    assert (mesh.points.min(axis=0) > source.points.min(axis=0) - cell).all()
    assert (np.ptp(mesh.points, axis=0) > np.ptp(source.points, axis=0) - 4.0 * cell).all()
