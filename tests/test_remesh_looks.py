"""Looks of a remeshed surface: materials, images and colors of vertices, in memory and in files."""

# A mesh may have no looks: these have some, or the test fails.
# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid, quad_sphere
from painted import SIDES, seen_sides, write_obj_cube, write_painted
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import face_centers
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.look_transfer import dressed
from balloon_warp.mesh.looks import Look, Looks
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.mesh.remesh import remesh

MATERIALS = "".join(f"newmtl {side}\nKd {0.1 * side:g} 0.5 0.25\n" for side in range(6))


def within_sides(mesh: PolygonMesh) -> list[tuple[int, tuple[float, ...]]]:
    """Return sides and colors as `seen_sides` does, without faces that go around an edge of the cube."""
    inner = (np.abs(face_centers(mesh)) > 0.8).sum(axis=1) == 1
    return [each for each, is_inner in zip(seen_sides(mesh), inner.tolist(), strict=True) if is_inner]


@pytest.mark.parametrize("kind", ["obj", "glb", "usda"])
def test_a_texture_stays_where_it_was(tmp_path: Path, kind: str):
    """A texture stays in place: each side has a tile of its own, and a quad across an edge lies in one of them."""
    made = remesh(load_mesh(write_painted(tmp_path, kind)), 12)
    found = within_sides(made)
    assert {side for side, _ in found} == set(range(6))
    assert all(color == SIDES[side] for side, color in found)
    assert made.warnings == ()
    tiles = np.floor(made.texture_coordinates.reshape(-1, 4, 2) * [3.0, 2.0])
    assert (tiles == tiles[:, :1]).all()


def test_the_command_writes_materials_and_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    write_painted(tmp_path, "obj")
    done = CliRunner().invoke(app, ["remesh", "cube.obj", "-o", "out/quads.obj", "--cells", "12"])
    assert done.exit_code == 0, done.output
    again = load_mesh(tmp_path / "out/quads.obj")
    assert again.warnings == ()
    assert all(color == SIDES[side] for side, color in within_sides(again))
    (image,) = (tmp_path / "out/textures").iterdir()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["quads.mtl", "quads.obj", "textures"]
    assert f"map_Kd textures/{image.name}\n" in (tmp_path / "out/quads.mtl").read_text()
    assert CliRunner().invoke(app, ["remesh", "cube.obj", "-o", "out/quads.obj", "--cells", "8"]).exit_code == 0


def test_materials_stay_on_their_faces(tmp_path: Path):
    made = remesh(load_mesh(write_obj_cube(tmp_path, MATERIALS)), 12)
    write_obj(tmp_path / "quads.obj", made)
    for mesh in (made, load_mesh(tmp_path / "quads.obj")):
        found = within_sides(mesh)
        assert {side for side, _ in found} == set(range(6))
        assert all(color == pytest.approx((0.1 * side, 0.5, 0.25)) for side, color in found)


def test_colors_of_vertices_stay_where_they_were(tmp_path: Path):
    """Vertex colors stay in place: red grows with height."""
    ball = quad_sphere(12)
    heights = 0.5 + 0.5 * ball.points[:, 1]
    colors = np.stack([heights, 0.25 + 0.0 * heights, 1.0 - heights], axis=1)[ball.face_vertex_indices]
    none = np.full(len(colors), -1, np.int32)
    made = remesh(replace(ball, looks=Looks((), none, colors.astype(np.float32))), 12)
    write_obj(tmp_path / "quads.obj", made)
    assert [path.name for path in tmp_path.iterdir()] == ["quads.obj"]
    for mesh in (made, read_obj(tmp_path / "quads.obj")):
        seen = mesh.looks.color_at_corners((0.0, 0.0, 0.0))
        expected = 0.5 + 0.5 * mesh.points[mesh.face_vertex_indices, 1]
        assert np.abs(seen[:, 0] - expected).max() < 0.02
        assert np.abs(seen[:, 1] - 0.25).max() < 1e-3


def test_a_texture_in_crumbs_becomes_its_mean(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    surface = load_mesh(write_painted(tmp_path, "obj"))
    monkeypatch.setattr("balloon_warp.mesh.look_transfer.MOST_CHARTS", 2)
    made = remesh(surface, 8)
    assert made.texture_coordinates is None
    assert made.warnings == ("The texture's pieces are smaller than the quads, which have its mean color instead.",)
    assert made.looks.pictures == []
    assert made.looks.mean((0.0, 0.0, 0.0)) == pytest.approx(surface.looks.pictures[0].mean, abs=1e-4)


def test_faces_without_looks_stay_so(tmp_path: Path):
    """Faces without looks keep none: half of a sheet is red; the other mesh is coarser, and a little above."""
    sheet = grid(8, 2)
    red = np.repeat(np.where(np.arange(sheet.face_count) % 8 < 4, 0, -1), 4).astype(np.int32)
    sheet = replace(sheet, looks=Looks((Look("my red", (1.0, 0.0, 0.0)),), red))
    coarse = grid(4, 1)
    coarse = replace(coarse, points=coarse.points * [2.0, 2.0, 1.0] + [0.0, 0.0, 0.1])
    made = dressed(coarse, sheet)
    assert made.looks.of_corners.reshape(4, 4).tolist() == [[0] * 4] * 2 + [[-1] * 4] * 2
    write_obj(tmp_path / "sheet.obj", made)
    again = read_obj(tmp_path / "sheet.obj")
    assert again.looks.of_corners.reshape(4, 4).tolist() == made.looks.of_corners.reshape(4, 4).tolist()
    assert dressed(coarse, grid(8, 2)) is coarse


def test_materials_of_another_program_are_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Materials of another program are refused before the surface is measured, which takes long."""
    monkeypatch.setattr("balloon_warp.mesh.remesh.remesh", lambda *_, **__: pytest.fail("measured"))
    source = write_painted(tmp_path, "obj").rename(tmp_path / "source.obj")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    result = CliRunner().invoke(app, ["remesh", str(source), "-o", str(tmp_path / "cube.obj")])
    assert isinstance(result.exception, InputError)
    assert "cube.mtl: another program wrote it, and the materials of cube.obj go there; expected another name" in str(
        result.exception
    )
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_a_color_that_multiplies_an_image_goes_into_it(tmp_path: Path):
    """A color that multiplies an image is baked into it, as OBJ files have one or the other."""
    surface = load_mesh(write_painted(tmp_path, "obj"))
    (look,) = surface.looks.materials
    tinted = replace(surface, looks=replace(surface.looks, materials=(replace(look, color=(1.0, 0.5, 0.0)),)))
    write_obj(tmp_path / "tinted.obj", tinted)
    red, green, blue = look.picture.mean
    again = read_obj(tmp_path / "tinted.obj").looks
    assert again.materials[0].color == (1.0, 1.0, 1.0)
    assert again.pictures[0].mean == pytest.approx((red, 0.5 * green, 0.0 * blue), abs=5e-3)
