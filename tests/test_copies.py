"""Duplicate surfaces, as where both sides are exported, count once."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, joined, open_cube, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import genus, mesh_edges
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Scene

BALL = quad_sphere(6, 0.5)


def inward(mesh: PolygonMesh) -> PolygonMesh:
    return replace(mesh, face_vertex_indices=mesh.face_vertex_indices.reshape(-1, 4)[:, ::-1].ravel())


def loose(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with vertices of its own for each face."""
    corners = mesh.face_vertex_indices
    return replace(mesh, points=mesh.points[corners], face_vertex_indices=np.arange(len(corners), dtype=np.int32))


def shuffled(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with its faces in another order, each from another corner."""
    faces = np.random.default_rng(1).permutation(mesh.face_vertex_indices.reshape(-1, 4))
    return replace(mesh, face_vertex_indices=np.roll(faces, 1, axis=1).ravel())


def rounded(mesh: PolygonMesh) -> PolygonMesh:
    return replace(mesh, points=mesh.points + np.random.default_rng(2).uniform(-1e-7, 1e-7, mesh.points.shape))


def on_the_same_vertices(mesh: PolygonMesh) -> PolygonMesh:
    """Return both sides on the same vertices, one after the other."""
    return replace(
        mesh,
        face_vertex_counts=np.tile(mesh.face_vertex_counts, 2),
        face_vertex_indices=np.concatenate([mesh.face_vertex_indices, inward(mesh).face_vertex_indices]),
    )


@pytest.mark.parametrize(
    "mesh",
    [
        on_the_same_vertices(BALL),
        joined(BALL, inward(BALL)),
        joined(BALL, shuffled(inward(BALL))),
        joined(BALL, rounded(inward(BALL))),
        joined(inward(BALL), BALL),
        joined(loose(BALL), loose(inward(BALL))),
        joined(BALL, shuffled(loose(inward(BALL)))),
        joined(loose(BALL), inward(BALL)),
        joined(BALL, inward(BALL), rounded(BALL)),
    ],
    ids=["shared", "apart", "shuffled", "rounded", "inward", "soups", "of a soup", "soup", "thrice"],
)
def test_both_sides_of_a_ball_make_one_ball(mesh: PolygonMesh) -> None:
    """A ball exported with both sides is one closed ball, outward, of its volume and springs."""
    once = prepared(mesh, "mesh", Treatment())
    assert genus(once, mesh_edges(once)) == 0
    assert once.face_count == BALL.face_count
    assert signed_volume(once) == pytest.approx(signed_volume(BALL), rel=1e-5)  # what is rounded is moved by 1e-7
    assert f"{mesh.face_count - BALL.face_count:,} faces have the corners of earlier faces" in " ".join(once.warnings)
    assert not [warning for warning in once.warnings if "no face" in warning]
    used = np.isin(np.arange(mesh.vertex_count), once.face_vertex_indices)
    stand_ins = np.array([once.stand_in(vertex) for vertex in range(mesh.vertex_count)])
    assert used[stand_ins].all()
    assert np.abs(mesh.points - mesh.points[stand_ins]).max() < 1e-6
    balloon = Balloon(mesh=mesh)
    shape = shape_balloon(balloon, Scene(balloon=[balloon]))
    assert shape.springs.count == shape_balloon(Balloon(mesh=BALL), Scene(balloon=[Balloon(mesh=BALL)])).springs.count


@pytest.mark.parametrize("sheet", [grid(4, 4), open_cube()])
def test_both_sides_of_a_sheet_make_one_sheet(sheet: PolygonMesh) -> None:
    """A sheet exported with both sides is one sheet, not a flat balloon sewn at the rim."""
    once = prepared(joined(sheet, inward(sheet)), "mesh", Treatment())
    assert once.face_count == sheet.face_count
    alone = prepared(sheet, "mesh", Treatment())
    assert mesh_edges(once).count == mesh_edges(alone).count


def test_one_part_of_several_may_be_there_twice() -> None:
    """A duplicate among several parts is removed, and the parts before and after it stay."""
    aside = replace(cube(), points=cube().points + (3.0, 0.0, 0.0))
    mesh = joined(aside, BALL, inward(BALL), open_cube())
    once = prepared(mesh, "mesh", Treatment())
    assert once.face_count == mesh.face_count - BALL.face_count
    assert f"the first is face {7 + BALL.face_count}, counting from 1" in " ".join(once.warnings)


def test_what_only_touches_counts_twice() -> None:
    """Boxes wall to wall, and two sheets sewn at the rim, a balloon that is still flat, are no duplicates."""
    row = joined(cube(), replace(cube(), points=cube().points + (1.0, 0.0, 0.0)))
    assert prepared(row, "mesh", Treatment()).face_count == 12
    sheet = grid(4, 4)
    rim = (sheet.points[:, :2] % 4.0 == 0.0).any(axis=1)
    back = np.where(rim, np.arange(25), 25 + np.cumsum(~rim) - 1)[inward(sheet).face_vertex_indices]
    pillow = replace(
        sheet,
        points=np.concatenate([sheet.points, sheet.points[~rim]]),
        face_vertex_counts=np.tile(sheet.face_vertex_counts, 2),
        face_vertex_indices=np.concatenate([sheet.face_vertex_indices, back]).astype(np.int32),
    )
    assert prepared(pillow, "mesh", Treatment()).face_count == 32


def test_texture_coordinates_stay_with_their_corners(tmp_path: Path) -> None:
    """Texture coordinates stay with their corners, wherever the duplicate stands in the file."""
    textures = np.random.default_rng(3).random((BALL.face_count * 4, 2), dtype=np.float32)
    own = replace(BALL, texture_coordinates=textures)
    other = replace(shuffled(inward(BALL)), texture_coordinates=textures)
    both = replace(
        joined(own, other), texture_coordinates=np.concatenate([own.texture_coordinates, other.texture_coordinates])
    )
    write_obj(tmp_path / "both.obj", both)
    once = prepared(load_mesh(tmp_path / "both.obj"), "mesh", Treatment())
    np.testing.assert_allclose(once.texture_coordinates, textures, atol=1e-6)  # seven digits are written
