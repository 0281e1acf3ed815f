"""Surface nets and remeshing: measures, features, looks, and refusals; and solid shapes."""

import os
import re
from collections.abc import Callable

# A mesh may have no looks: these have some, or the test fails.
# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import (
    assert_closed_quads,
    assert_none_folded,
    at,
    box,
    car,
    deformed,
    edge_lengths,
    grid,
    hair,
    haired,
    head,
    joined,
    mesh_of,
    quad_sphere,
    rings,
    sphere_distance,
    sword,
    without,
)
from numpy.typing import NDArray
from painted import PLAIN, SIDES, seen_sides, write_obj_cube, write_painted
from typer.testing import CliRunner, Result

import balloon_warp.scenes
from balloon_warp import Balloon, InputError, Obstacle, PolygonMesh, Scene, load_mesh, remesh
from balloon_warp.cli.app import app
from balloon_warp.mesh import topology
from balloon_warp.mesh.crossings import crossings_sentence
from balloon_warp.mesh.load import with_looks_of
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.mesh.polygon_mesh import Look, Looks
from balloon_warp.mesh.surface_nets import MeshDistance, extract, surface_nets
from balloon_warp.model.obstacles import MOST_SAMPLES, ObstacleShape, is_thin, sample, shape_obstacle
from balloon_warp.scenes.models import MODELS, make_model
from balloon_warp.tools.remesh import infidelity
from balloon_warp.usd.solids import OF_LARGEST, OF_LEAST, beveled_box


def test_sphere_lies_on_its_distance_of_even_quads() -> None:
    mesh = surface_nets(sphere_distance, [-1.1] * 3, [1.1] * 3, cell=0.1)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # float64 Newton steps on an exact distance
    assert np.abs(sphere_distance(mesh.points)).max() < 1e-12
    # Chords of a tenth of the radius: the relative loss is about (0.1)^2 / 4 in volume, half of that in area.
    assert topology.signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi, rel=5e-3)
    assert topology.signed_volume(mesh) < 4.0 / 3.0 * np.pi
    assert topology.total_area(mesh) == pytest.approx(4.0 * np.pi, rel=3e-3)
    lengths = edge_lengths(mesh)
    # Before relaxation the ratio is 2.5; with valences from 3 to 6 it comes to 1.6.
    assert lengths.max() / lengths.min() < 1.75
    valence = np.bincount(topology.mesh_edges(mesh).ends.ravel())
    assert (valence.min(), valence.max() <= 6) == (3, True)
    mirrored = mesh.points * [-1.0, 1.0, 1.0]
    # The symmetry of the distance is kept: Warp places the first vertices in float32.
    assert np.linalg.norm(mesh.points[:, None] - mirrored[None], axis=2).min(axis=1).max() < 1e-6


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


def test_every_edge_has_two_faces_whatever_the_samples() -> None:
    values = np.random.default_rng(5).normal(size=(14, 15, 16))
    for axis in range(3):
        np.moveaxis(values, axis, 0)[[0, -1]] = 1.0
    mesh = extract(values, np.zeros(3), 1.0)
    edges = topology.mesh_edges(mesh)
    assert mesh.face_count > 1000
    assert (edges.face_counts == 2).all()
    assert topology.is_manifold(mesh, edges)


CELLS = 24


def triangles_mesh(surface: trimesh.Trimesh) -> PolygonMesh:
    return mesh_of(surface.vertices, surface.faces.tolist())


def ball(radius: float = 1.0, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PolygonMesh:
    """Return a sphere of 5,120 triangles, whose faces deviate by up to 0.1 % of the radius."""
    surface = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    surface.apply_translation(center)
    return triangles_mesh(surface)


def overlapping() -> PolygonMesh:
    """Return seven ellipsoids that overlap: a body, a head, two ears, two feet and a tail."""
    places = [
        ((0.0, -0.3, 0.0), (0.5, 0.35, 0.3)), ((0.5, 0.2, 0.0), (0.28, 0.24, 0.22)),
        ((0.3, -0.5, 0.2), (0.12, 0.24, 0.1)), ((0.3, -0.5, -0.2), (0.12, 0.24, 0.1)),
        ((0.45, 0.45, 0.1), (0.06, 0.36, 0.05)), ((0.45, 0.45, -0.1), (0.06, 0.36, 0.05)),
        ((-0.5, -0.25, 0.0), (0.1, 0.1, 0.1)),
    ]  # fmt: skip
    round_one = trimesh.creation.icosphere(subdivisions=2)
    return joined(*(mesh_of(round_one.vertices * size + place, round_one.faces.tolist()) for place, size in places))


@pytest.mark.parametrize("cells", [18, 28])
def test_quads_do_not_cross_whatever_the_number_of_cells(cells: int) -> None:
    """Along whichever diagonal they are cut; tips of thin ears turned quads over, and legs met."""
    assert crossings_sentence(overlapping())
    assert crossings_sentence(remesh(overlapping(), cells)) is None


def remeshed(source: Path | str, target: Path | str, cells: int, *words: str) -> Result:
    """Return the output of the command for a surface that it can remesh; raise its refusal of another."""
    named = ["remesh", str(source), "-o", str(target), "--cells", str(cells), *words]
    said = CliRunner().invoke(app, named)
    if said.exception and not isinstance(said.exception, SystemExit):
        raise said.exception
    assert said.exit_code == 0, said.output
    return said


def test_quads_that_cross_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = tmp_path / "ball.obj", tmp_path / "quads.obj"
    write_obj(source, quad_sphere(3))
    monkeypatch.setattr("balloon_warp.tools.remesh.crossings_sentence", lambda quads: "crosses itself at 2 places")
    with pytest.raises(InputError, match="with 14 cells it crosses itself at 2 places; expected --cells 28, or"):
        remeshed(source, target, 6)
    assert not target.exists()


@pytest.mark.full
def test_cells_are_the_quads_along_the_longest_side() -> None:
    ellipsoid = deformed(ball(), lambda points: points * [3.0, 1.0, 1.0])
    for cells in (24, 48):
        # Edges are about 0.85 of a cell: the slanted quads of a net are as long as a cell, and narrower.
        assert np.median(edge_lengths(remesh(ellipsoid, cells))) == pytest.approx(0.85 * 6.0 / cells, rel=0.1)


@pytest.mark.full
def test_hole_is_closed_by_a_membrane() -> None:
    mesh = remesh(without(ball(), topology.face_centers(ball())[:, 1] > 0.8), CELLS)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # A membrane between the flat one, at 0.8, and the missing cap, up to half a cell of slack.
    top = mesh.points[(np.hypot(mesh.points[:, 0], mesh.points[:, 2]) < 0.3) & (mesh.points[:, 1] > 0.0)]
    assert len(top) > 10
    assert (top[:, 1] > 0.8 - 0.04).all()
    assert (np.linalg.norm(top, axis=1) < 1.0 + 1e-3).all()


@pytest.mark.full
def test_loose_and_flipped_triangles_make_one_skin() -> None:
    whole = ball()
    # Each triangle with three vertices of its own, as in an STL file, and shrunk by 1 %, so that each edge is a crack.
    corners = whole.points[whole.face_vertex_indices].reshape(-1, 3, 3)
    corners = corners.mean(axis=1, keepdims=True) + 0.99 * (corners - corners.mean(axis=1, keepdims=True))
    assert_closed_quads(remesh(mesh_of(corners, np.arange(3 * whole.face_count).reshape(-1, 3).tolist()), CELLS))
    mesh = remesh(topology.flipped(whole, np.arange(whole.face_count) % 3 == 0), CELLS)
    assert_closed_quads(mesh)
    assert topology.signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi, rel=1e-2)
    assert_closed_quads(remesh(topology.flipped(whole, np.ones(whole.face_count, dtype=bool)), CELLS))


def test_sheet_becomes_a_slab_and_a_wedge_keeps_its_edge_thin() -> None:
    mesh = remesh(mesh_of([(0, 0, 0), (0, 0, 2), (2, 0, 2), (2, 0, 0)], [[0, 1, 2, 3]]), 20)
    assert_closed_quads(mesh)
    assert any("thinner" in warning for warning in mesh.warnings)
    # 1.5 cells of 0.1; the relaxed vertices of the round border may cut its corners.
    assert np.ptp(mesh.points[:, 1]) == pytest.approx(0.15, abs=0.005)
    prism = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=3)
    mesh = remesh(triangles_mesh(prism), CELLS)
    assert_closed_quads(mesh)
    assert mesh.warnings == ()
    assert (mesh.points.max(axis=0) < prism.bounds[1] + 1e-4).all()


@pytest.mark.full
def test_far_away_and_tiny_is_as_good() -> None:
    mesh = remesh(deformed(ball(), lambda points: points * 1e-3 + 1e3), CELLS)
    assert_closed_quads(mesh)
    assert_none_folded(mesh)
    # float64 leaves 1e-13 / 1e-3 of it; the rest is Warp's float32 in cells; the icosphere is 0.1 % inside the sphere.
    assert np.abs(np.linalg.norm((mesh.points - 1e3) / 1e-3, axis=1) - 1.0).max() < 1.5e-3


@pytest.mark.full
def test_crumbs_are_left_out_and_parts_are_kept() -> None:
    cluster = joined(ball(), ball(0.6, (2.5, 0.0, 0.0)), ball(0.2, (0.0, 2.0, 0.0)), ball(0.04, (0.0, 0.0, 1.5)))
    mesh = remesh(cluster, 40)
    assert_closed_quads(mesh, parts=3)
    assert len(mesh.warnings) == 2
    assert "3 separate parts" in mesh.warnings[0]
    assert "1 crumb " in mesh.warnings[1]


def test_parts_that_are_fused_or_lost_are_named():
    """A part is told by its group, or by its size and middle; the box's quads are of 0.1."""
    head, nose, brain, moon = ball(), ball(0.4, (0.0, 0.0, 1.1)), ball(0.3), ball(0.3, (0.0, 3.0, 0.0))
    face = joined(head, nose, brain, moon)
    named = replace(face, groups={"Head": np.arange(head.vertex_count, dtype=np.int32)})
    *_, fused, inside = remesh(named, 30).warnings
    assert fused.startswith("Head and a part of 0.8 at (0, 0, 1.1) became one part")
    assert inside == "A part of 0.6 at (0, 0, 0) lies inside of others and left no quads."
    assert len(remesh(joined(head, moon), 30).warnings) == 1  # that there are two


@pytest.mark.parametrize("cells", [3, -1, 257, 100_000])
def test_bad_cells(cells: int) -> None:
    with pytest.raises(InputError, match=rf"^cells must be from 4 to 256 \(got {cells}\)$"):
        remesh(ball(), cells)
    with pytest.raises(InputError, match="all vertices coincide"):
        remesh(deformed(ball(), np.ones_like), CELLS)


@pytest.mark.parametrize(
    ("file", "words", "upright", "said"),
    [
        pytest.param("cone.stl", [], True, "so Z is up, which has its widest flat side below; --up Y", id="stl"),
        pytest.param("cone.stl", ["--up", "Y"], False, "", id="stl as told"),
        pytest.param("cone.obj", [], False, "", id="obj"),
        pytest.param("cone.obj", ["--up", "Z"], True, "cone.obj: Z is up, as given", id="obj as told"),
    ],
)
def test_quads_stand_as_a_run_of_the_file_would(tmp_path: Path, file: str, words: list[str], upright: bool, said: str):
    """A cone along Z becomes one along Y, up in an OBJ file, where Z is up in its file, by the rule of `run`."""
    trimesh.creation.cone(radius=1.0, height=3.0, sections=16).export(tmp_path / file)
    target = tmp_path / "quads.obj"
    result = remeshed(tmp_path / file, target, 8, *words)
    assert int(np.ptp(read_obj(target).points, axis=0).argmax()) == (1 if upright else 2)
    assert said in result.stderr
    assert bool(said) == ("is up" in result.stderr)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["-o", "out.obj", "--up", "X"], "--up X: expected Y, Z"),
        (["-o", "out.obj", "--cells", "2"], "cells must be from 4 to 256 (got 2)"),
        (["-o", "out.stl"], "out.stl: cannot write .stl; expected .obj"),
        (["-o", "nowhere/out.obj", "--cells", "8"], "nowhere/out.obj: the folder nowhere does not exist"),
        (["-o", "../here/ball.obj", "--cells", "8"], "ball.obj: is the input mesh; expected another name, with -o"),
    ],
)
def test_command_refuses_before_the_long_measurement(tmp_path: Path, monkeypatch, arguments: list[str], sentence: str):
    monkeypatch.setattr("balloon_warp.tools.remesh.surface_nets", lambda *_, **__: pytest.fail("measured"))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_obj("ball.obj", ball())
    before = (folder / "ball.obj").read_bytes()
    with pytest.raises(InputError, match=re.escape(sentence)):
        app(["remesh", "ball.obj", *arguments], standalone_mode=False)
    assert [path.name for path in folder.iterdir()] == ["ball.obj"]
    assert (folder / "ball.obj").read_bytes() == before


@pytest.mark.parametrize(
    "name",
    [
        "spot_quadrangulated",
        "mh_tongue",
        pytest.param("mh_casualsuit01", marks=pytest.mark.full),
    ],
)
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


def standing_out(surface: PolygonMesh, made: PolygonMesh, cells: int) -> float:
    """Return the largest distance of a vertex of the surface outside of the result [cells]."""
    cell = float(np.ptp(surface.points, axis=0).max()) / cells
    distance = MeshDistance(made.points / cell, topology.triangulate(made)[0], thickness=0.0)
    return float(distance(surface.points / cell).max())


def patches() -> PolygonMesh:
    """Return 24 pieces of a ball, a little smaller, so that there are cracks between them: they are no hair."""
    whole, pieces = quad_sphere(8, 0.5), []
    for quads in np.array_split(whole.face_vertex_indices.reshape(-1, 4), 24):
        used, numbers = np.unique(quads, return_inverse=True)
        middle = whole.points[used].mean(axis=0)
        pieces.append(mesh_of(middle + 0.999 * (whole.points[used] - middle), numbers.reshape(-1, 4)))
    return joined(*pieces)


# Two overlapping balls less their lens, pi (4 + d) (2 - d)^2 / 12; the crease is rounded by half a cell.
TWO_BALLS = 8.0 / 3.0 * np.pi - np.pi * 5.0 / 12.0
KEPT = {
    "two balls": (lambda: joined(ball(), ball(1.0, (1.0, 0.0, 0.0))), CELLS, TWO_BALLS, 1.5e-2),
    # A blade a sixth of a cell thick, where a slab had seven times its volume.
    "blade": (sword, 48, None, 0.1),
    **{
        f"plate {size} cells thick": (partial(box, (0.0, 0.0, 0.0), (1.0, 0.6, size / 24), (24, 12, 1)), 24, None, 0.1)
        for size in (0.05, 1.2)
    },
    "patches with cracks": (patches, 16, topology.signed_volume(quad_sphere(8, 0.5)), 0.05),
}
"""mesh, cells, volume, if it is not the mesh's own, and its tolerance"""


@pytest.mark.full
@pytest.mark.parametrize(("make", "cells", "volume", "tolerance"), KEPT.values(), ids=KEPT)
def test_volume_is_kept(make: Callable[[], PolygonMesh], cells: int, volume: float | None, tolerance: float) -> None:
    made = remesh(make(), cells)
    assert_closed_quads(made)
    assert_none_folded(made)
    assert [each for each in made.warnings if "became one part" not in each] == []
    assert topology.signed_volume(made) == pytest.approx(volume or topology.signed_volume(make()), rel=tolerance)


@pytest.mark.full
def test_ears_and_nose_stay() -> None:
    made = remesh(head(), 32)
    assert_closed_quads(made)
    assert_none_folded(made)
    assert standing_out(head(), made, 32) < 0.5
    assert topology.signed_volume(made) == pytest.approx(topology.signed_volume(head()), rel=0.02)


def test_corners_of_a_box_stay() -> None:
    cube = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (4, 4, 4))
    assert standing_out(cube, remesh(cube, 12), 12) < 0.2


@pytest.mark.full
def test_a_car_is_made_with_the_cells_that_are_asked_for() -> None:
    made = remesh(car(windshield=False), 32)
    assert_closed_quads(made)
    assert not [warning for warning in made.warnings if "were used" in warning]


def test_hair_is_refused_before_it_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("balloon_warp.tools.remesh._quads", lambda *_: pytest.fail("it was begun"))
    with pytest.raises(InputError, match=r"200 of its 200 parts are open, like hair, .* expected a surface with an"):
        remesh(hair(), 48)
    with pytest.raises(InputError, match=r"60 of its 61 parts are open, like hair, .* expected --parts closed"):
        remesh(haired(), 48)


def test_too_many_quads_are_refused_with_a_number_that_works() -> None:
    many = joined(*(at(grid(4, 4), (0.0, 0.0, z)) for z in np.linspace(0.0, 4.0, 9)))
    with pytest.raises(InputError, match=r"256 cells would make .* quads; expected --cells 1\d\d or fewer"):
        remesh(many, 256)


BALL = quad_sphere(8)


@pytest.mark.full
def test_a_rod_of_any_thickness_stays_in_one_piece() -> None:
    heights = np.linspace(0.0, 3.0, 60)
    mesh = deformed(rings(0.015 + 0.05 * heights, heights, 12), lambda p: p + np.outer(p[:, 2], [0.3, 0.0, 0.0]))
    made = remesh(mesh, 24)
    assert_closed_quads(made)
    assert not [warning for warning in made.warnings if "were used" in warning]


def test_sheets_one_behind_the_other_are_closed() -> None:
    """Sheets one behind the other, as strips of hair, are closed: their winding number exceeds 1 outside."""
    square = mesh_of([(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)], [[0, 1, 2, 3]])
    made = remesh(joined(*(at(square, (0.0, 0.02 * n, 0.0)) for n in range(9))), 12)
    assert made.face_count > 100
    assert (topology.mesh_edges(made).face_counts == 2).all()


@pytest.mark.full
def test_more_cells_are_taken_where_a_part_would_be_lost_and_it_is_said() -> None:
    mesh = remesh(joined(BALL, at(BALL, (1.8, 0.0, 0.0), 0.14)), 15)
    assert_closed_quads(mesh, parts=2)
    assert mesh.warnings[0].startswith("With 15 cells the surface near (")
    assert mesh.warnings[0].endswith(") is lost: 34 were used.")


def test_what_is_lost_with_more_cells_too_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    source, target = tmp_path / "far.obj", tmp_path / "out.obj"
    write_obj(source, joined(BALL, at(BALL, (9.0, 0.0, 0.0), 0.6)))
    lost = r"^far: with 18 cells the surface near \(.*\) is lost; expected --cells 36, or a surface without that$"
    with pytest.raises(InputError, match=lost):
        remeshed(source, target, 8)
    assert list(tmp_path.iterdir()) == [source]


def test_what_is_not_faithful_is_found() -> None:
    small = at(BALL, (0.0, 0.0, 0.0), 0.5)
    assert infidelity(BALL, BALL, 0.1) is None
    assert "is lost" in str(infidelity(BALL, small, 0.1))
    assert infidelity(joined(BALL, small), BALL, 0.1) is None  # it lies within
    one_gone = without(BALL, np.arange(BALL.face_count) == 0)
    assert infidelity(BALL, one_gone, 0.1) == "4 of its edges are open or crossed"
    assert infidelity(BALL, joined(BALL, small), 0.1) == "it has 2 parts instead of 1"
    whole, half = (rings(np.full(n, 0.2), np.linspace(0.0, size, n), 12) for n, size in ((60, 3.0), (30, 1.47)))
    halves = joined(half, at(half, (0.0, 0.0, 1.53)))
    assert infidelity(halves, halves, 0.1) is None
    assert str(infidelity(whole, halves, 0.1)).startswith("one part breaks into pieces near (")


def within_sides(mesh: PolygonMesh) -> list[tuple[int, tuple[float, ...]]]:
    """Return sides and colors as `seen_sides` does, without faces that go around an edge of the cube."""
    inner = (np.abs(topology.face_centers(mesh)) > 0.8).sum(axis=1) == 1
    return [each for each, is_inner in zip(seen_sides(mesh), inner.tolist(), strict=True) if is_inner]


@pytest.mark.full
@pytest.mark.parametrize("kind", ["obj", "glb", "usda"])
def test_a_texture_stays_where_it_was(tmp_path: Path, kind: str):
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
    remeshed("cube.obj", "out/quads.obj", 12)
    again = load_mesh(tmp_path / "out/quads.obj")
    assert again.warnings == ()
    assert all(color == SIDES[side] for side, color in within_sides(again))
    (image,) = (tmp_path / "out/textures").iterdir()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["quads.mtl", "quads.obj", "textures"]
    assert f"map_Kd textures/{image.name}\n" in (tmp_path / "out/quads.mtl").read_text()
    remeshed("cube.obj", "out/quads.obj", 8)


def test_materials_stay_on_their_faces(tmp_path: Path):
    made = remesh(load_mesh(write_obj_cube(tmp_path, PLAIN)), 12)
    write_obj(tmp_path / "quads.obj", made)
    for mesh in (made, load_mesh(tmp_path / "quads.obj")):
        found = within_sides(mesh)
        assert {side for side, _ in found} == set(range(6))
        assert all(color == pytest.approx((0.1 * side, 0.5, 0.25)) for side, color in found)


def test_colors_of_vertices_stay_where_they_were(tmp_path: Path):
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
    monkeypatch.setattr("balloon_warp.mesh.load.MOST_CHARTS", 2)
    made = remesh(surface, 8)
    assert made.texture_coordinates is None
    assert made.warnings == ("The texture's pieces are smaller than the quads, which have its mean color instead.",)
    assert made.looks.pictures == []
    assert made.looks.mean((0.0, 0.0, 0.0)) == pytest.approx(surface.looks.pictures[0].mean, abs=1e-4)


def test_faces_without_looks_stay_so(tmp_path: Path):
    sheet = grid(8, 2)
    red = np.repeat(np.where(np.arange(sheet.face_count) % 8 < 4, 0, -1), 4).astype(np.int32)
    sheet = replace(sheet, looks=Looks((Look("my red", (1.0, 0.0, 0.0)),), red))
    coarse = grid(4, 1)
    coarse = replace(coarse, points=coarse.points * [2.0, 2.0, 1.0] + [0.0, 0.0, 0.1])
    made = with_looks_of(coarse, sheet)
    assert made.looks.of_corners.reshape(4, 4).tolist() == [[0] * 4] * 2 + [[-1] * 4] * 2
    write_obj(tmp_path / "sheet.obj", made)
    again = read_obj(tmp_path / "sheet.obj")
    assert again.looks.of_corners.reshape(4, 4).tolist() == made.looks.of_corners.reshape(4, 4).tolist()
    assert with_looks_of(coarse, grid(8, 2)) is coarse


def test_materials_of_another_program_are_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("balloon_warp.tools.remesh.remesh", lambda *_, **__: pytest.fail("measured"))
    source = write_painted(tmp_path, "obj").rename(tmp_path / "source.obj")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    said = r"cube\.mtl: another program wrote it, and the materials of cube\.obj go there; expected another name"
    with pytest.raises(InputError, match=said):
        remeshed(source, tmp_path / "cube.obj", 40)
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_a_color_that_multiplies_an_image_goes_into_it(tmp_path: Path):
    surface = load_mesh(write_painted(tmp_path, "obj"))
    (look,) = surface.looks.materials
    tinted = replace(surface, looks=replace(surface.looks, materials=(replace(look, color=(1.0, 0.5, 0.0)),)))
    write_obj(tmp_path / "tinted.obj", tinted)
    red, green, blue = look.picture.mean
    again = read_obj(tmp_path / "tinted.obj").looks
    assert again.materials[0].color == (1.0, 1.0, 1.0)
    assert again.pictures[0].mean == pytest.approx((red, 0.5 * green, 0.0 * blue), abs=5e-3)


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
    edges = topology.mesh_edges(mesh)
    assert (mesh.face_vertex_counts == 4).all()
    assert (edges.face_counts == 2).all()
    assert topology.genus(mesh, edges) == (name == "slot")  # its hole; None where the mesh is not manifold
    assert (topology.component_count(mesh, edges), len(topology.inconsistent_edges(edges))) == (1, 0)
    assert topology.signed_volume(mesh) > 0.0
    valence = np.bincount(edges.ends.ravel())
    assert (valence.min(), valence.max() <= 6) == (3, True)
    lengths = edge_lengths(mesh)
    # As good as these come: 1.9 for the pillow, 2.2 for the bowl, about 3 where flippers and ears are near a cell thin.
    assert lengths.max() / lengths.min() < 3.3
    assert_none_folded(mesh)


UP = np.array([0.0, 1.0, 0.0])


def solid(mesh: PolygonMesh) -> ObstacleShape:
    """Return an obstacle of that mesh."""
    return shape_obstacle(0, Obstacle(mesh=mesh), Scene(balloon=[Balloon(mesh=quad_sphere(1))]))


def block(width: float, depth: float, height: float, x: float = 0.0, y: float = 0.0) -> PolygonMesh:
    """Return a block of faces outward, of some size, with its middle at a place."""
    return box((x, y, 0.0), (width, height, depth), (1, 1, 1))


def test_a_thing_is_as_thin_as_its_thinnest_part() -> None:
    """A table with a top of 40 mm and legs of 50 mm, though it is 0.7 m high; a cube and a ball of 1 m."""
    legs = [block(0.05, 0.05, 0.7, x, -0.4) for x in (-0.4, 0.4)]
    table = joined(block(1.0, 1.0, 0.04), *legs)
    for mesh, less, more in ((table, 0.03, 0.1), (block(1.0, 1.0, 1.0), 0.5, 1.01), (quad_sphere(8, 0.5), 0.5, 1.01)):
        assert [is_thin(solid(mesh), than) for than in (less, more)] == [False, True]


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
    assert topology.is_closed(topology.mesh_edges(box))
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
