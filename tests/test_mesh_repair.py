"""Repair of a mesh; areas, volumes, normals, triangles and topology of meshes, against known values and trimesh."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import (
    at,
    cube,
    grid,
    joined,
    klein,
    lattice,
    loose,
    mesh_of,
    moebius,
    open_cube,
    polygon,
    prism,
    quad_sphere,
    rings,
    tetrahedron,
    torus,
)
from meshes import two_quads_at_a_vertex as two_quads
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from balloon_warp import Balloon, Inflation, InputError, PolygonMesh, Scene, Simulator, String, load_mesh, load_scene
from balloon_warp.cli.app import app
from balloon_warp.mesh import topology
from balloon_warp.mesh import topology as geometry
from balloon_warp.mesh.load import Treatment, open_seam, prepared, welded, welded_along_seams
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.orientation import facing_outward
from balloon_warp.mesh.repair import Lid, border_loops, distinct_faces, lid_across, repaired, with_lids
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    component_labels,
    face_vector_areas,
    flipped,
    genus,
    inconsistent_edges,
    is_closed,
    mesh_edges,
    signed_volume,
)
from balloon_warp.model import plan_model
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene.load import write_scene


def inward(mesh: PolygonMesh) -> PolygonMesh:
    return flipped(mesh, np.ones(mesh.face_count, dtype=bool))


def whole(mesh: PolygonMesh) -> PolygonMesh:
    return prepared(mesh, "mesh", Treatment())


SPHERE = quad_sphere(4)
SOUND = quad_sphere(6, 0.5)


@pytest.mark.parametrize("seed", range(5))
def test_any_winding_of_closed_components_is_found_again(seed: int) -> None:
    pair = joined(at(SPHERE, (-2, 0, 0)), at(torus(9, 7), (2, 0, 0)))
    mixed = flipped(pair, np.random.default_rng(seed).random(pair.face_count) < 0.5)
    # The sums over a face run the other way around where it was wound twice.
    np.testing.assert_allclose(face_vector_areas(facing_outward(mixed)), face_vector_areas(pair), rtol=0, atol=1e-14)


def test_an_inward_component_is_turned_beside_and_left_inside() -> None:
    beside, hollow = joined(SPHERE, inward(at(SPHERE, (3, 0, 0)))), joined(SPHERE, inward(at(SPHERE, (0, 0, 0), 0.5)))
    assert signed_volume(facing_outward(beside)) == pytest.approx(2.0 * signed_volume(SPHERE))
    assert signed_volume(facing_outward(hollow)) == pytest.approx((1.0 - 0.5**3) * signed_volume(SPHERE))


def test_an_open_mesh_keeps_the_side_that_most_faces_show() -> None:
    few = np.isin(np.arange(9), [0, 4])
    for turned_faces, side in ((few, 1.0), (~few, -1.0)):
        assert (face_vector_areas(facing_outward(flipped(grid(3, 3), turned_faces)))[:, 2] == side).all()


@pytest.mark.filterwarnings("error")
def test_what_no_winding_fits_or_has_no_volume_or_area_is_left_alone() -> None:
    strip = moebius(9)
    assert repaired(strip, "strip").face_vertex_indices.tolist() == strip.face_vertex_indices.tolist()
    assert len(inconsistent_edges(mesh_edges(strip))) == 1
    # Tilted, so that the rounding of its volume has either sign.
    for tilt in np.random.default_rng(0).normal(size=(20, 3, 3)):
        flat = replace(SPHERE, points=(SPHERE.points * [1.0, 1.0, 0.0]) @ tilt)
        assert facing_outward(flat) is flat
    line = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    assert with_lids(line) is line
    assert whole(cube()).face_count == 6


def test_corners_and_faces_are_taken_once() -> None:
    faces = [[0, 1, 1, 2], [3, 3, 3], [2, 0, 1], [0, 3, 0, 1], [1, 2, 3, 0, 2]]
    mesh, kept = distinct_faces(mesh_of(np.eye(4, 3), faces))
    assert np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])[1].tolist() == [0, 3, 1]
    assert (kept.tolist(), mesh.face_vertex_counts.tolist()) == ([0, 3, 4], [3, 3, 4])
    with pytest.raises(InputError, match=r"^thing: has no face with three different corners$"):
        repaired(mesh_of(np.eye(4, 3), [[0, 1, 0], [2, 2, 2]]), "thing")


def test_welding_takes_the_first_vertex_at_a_place_and_tells_how_many_went() -> None:
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0), (2, 0, 0), (1, 1, -0.0), (0, 0, 0)]
    mesh = welded(mesh_of(points, [[0, 1, 2], [3, 4, 5]]))
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 1, 4, 2]
    assert mesh.stand_ins is not None
    assert mesh.stand_ins.tolist() == [0, 1, 2, 1, 4, 2, 0]
    assert mesh.warnings == (
        "2 vertices that lay exactly on others have been welded to them: they keep their numbers and move with them.",
    )
    sound = cube()
    assert welded(sound) is sound


@pytest.mark.parametrize("mesh", [cube(), quad_sphere(4)])
def test_seams_are_welded_until_the_mesh_is_closed(mesh: PolygonMesh) -> None:
    sewn = whole(loose(mesh))
    edges = mesh_edges(sewn)
    assert is_closed(edges)
    assert (edges.count, component_count(sewn, edges)) == (mesh_edges(mesh).count, 1)
    assert sewn.vertex_count == len(mesh.face_vertex_indices)  # all keep their numbers
    assert len(sewn.warnings) == 1


def test_bodies_that_touch_stay_apart() -> None:
    wide = mesh_of([(0, -1, 0), (2, -1, 0), (2, 0, 0), (0, 0, 0)], [[0, 1, 2, 3]])
    corners = joined(grid(1, 1), at(grid(1, 1), (1, 1, 0)))
    boxes = [joined(cube(), at(cube(), shift)) for shift in ((1, 1, 1), (1, 1, 0), (1, 0, 0))]
    for touching in (*boxes, corners, joined(grid(2, 1), wide)):
        assert welded_along_seams(touching) is touching
    assert len(welded(corners).left_vertices) == 1
    sewn = whole(joined(loose(cube()), loose(at(cube(), (1, 1, 1)))))
    assert component_count(sewn, mesh_edges(sewn)) == 2
    assert len(np.unique(sewn.face_vertex_indices)) == 16  # each with its own vertex at the corner


def test_numbers_of_welded_vertices_mean_the_ones_that_stand_in(tmp_path: Path, device: str) -> None:
    mesh = loose(quad_sphere(2))
    sewn = whole(mesh)
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


def uv_sphere(around: int, along: int, quads: bool = False) -> PolygonMesh:
    """Return a sphere of a graphics library, with a duplicate vertex around each ring and several at each pole: sine
    and cosine of a full turn leave them 1e-16 apart. Those at the poles of quads, too."""
    theta, phi = np.meshgrid(np.arange(along + 1) / along * np.pi, np.arange(around + 1) / around * 2 * np.pi)
    points = np.stack([-np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=2)
    faces = lattice(np.arange((around + 1) * (along + 1)).reshape(around + 1, -1)).tolist()
    if not quads:
        halves = [(each, number % along) for number, each in enumerate(faces)]
        faces = [half for (b, c, d, a), j in halves for half in [[a, b, d]] * (j > 0) + [[b, c, d]] * (j < along - 1)]
    return mesh_of(points.reshape(-1, 3), faces)


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    return Rotation.from_euler("z", degrees, degrees=True).apply(points)


def halves(move=lambda points: points) -> PolygonMesh:
    """Return a ball of two halves with vertices of their own, of which one is moved."""
    faces = SOUND.face_vertex_indices.reshape(-1, 4)
    left, parts = SOUND.points[faces].mean(axis=1)[:, 0] < 0.0, []
    for half in (faces[left], faces[~left]):
        used, corners = np.unique(half, return_inverse=True)
        parts.append(mesh_of(SOUND.points[used], corners.reshape(-1, 4)))
    return joined(parts[0], replace(parts[1], points=move(parts[1].points)))


def noise(size: float):
    return lambda points: points + np.random.default_rng(0).uniform(-size, size, points.shape)


def in_floats(points: np.ndarray) -> np.ndarray:
    """Return the mesh turned by way of a distant place, in 32 bits, as a program does that moves parts one by one."""
    there = turned(points, 40.0).astype(np.float32) + np.float32(3.0)
    return turned((there - np.float32(3.0)).astype(np.float64), -40.0)


SEWN = {
    "uv": uv_sphere(8, 4),
    "quads": uv_sphere(32, 16, quads=True),
    "moved": replace(uv_sphere(24, 12), points=turned(uv_sphere(24, 12).points * 3.0, 17.0) + 5.0),
    "mirrored": halves(noise(1e-9)),
    "barely": halves(noise(3e-7)),
    "floats": halves(in_floats),
    "soup": replace(loose(quad_sphere(6)), points=noise(1e-7)(loose(quad_sphere(6)).points)),
}


@pytest.mark.parametrize("mesh", SEWN.values(), ids=SEWN)
def test_seams_are_welded_across_what_rounding_makes(mesh: PolygonMesh) -> None:
    """No face is lost but at poles of quads."""
    sewn = whole(mesh)
    assert (genus(sewn, mesh_edges(sewn)), component_count(sewn, mesh_edges(sewn))) == (0, 1)
    assert sewn.face_count == mesh.face_count
    assert not [warning for warning in sewn.warnings if "hole" in warning or "open" in warning.split(";")[0]]
    assert open_seam(mesh) is None or not is_closed(mesh_edges(mesh))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("gap", [2e-5, 1e-4, 2e-3])
def test_a_wider_seam_is_told_and_what_is_advised_closes_it_at_any_size(gap: float, size: float) -> None:
    mesh = at(halves(noise(gap)), (0, 0, 0), size)
    found = open_seam(mesh)
    assert found is not None
    assert found.closes
    assert gap * size < found.gap < 3.0**0.5 * gap * size
    left = whole(mesh)
    assert not is_closed(mesh_edges(left))
    said = f"48 open edges lie within {found.gap:.2g} of others, like a seam; --weld {found.weld} joins them."
    assert said in left.warnings
    assert float(found.weld) < 5.0 * gap
    sewn = prepared(mesh, "mesh", Treatment(weld=float(found.weld)))
    assert (genus(sewn, mesh_edges(sewn)), sewn.face_count) == (0, mesh.face_count)
    assert f"24 vertices along seams, up to {found.gap:.2g} from others," in sewn.warnings[0]
    # Beside sheets that are open by design, the seam does not close all.
    found = open_seam(joined(mesh, *(at(grid(8, 8), (3.0 * size, 9.0 * size * n, 0.0), size) for n in range(4))))
    assert found is not None
    assert (found.edges, found.closes) == (48, False)


@pytest.mark.parametrize("mesh", [grid(6, 6), open_cube(), moebius(40), joined(grid(3, 3), cube())])
def test_what_is_meant_to_be_open_is_no_seam(mesh: PolygonMesh) -> None:
    assert open_seam(mesh) is None
    assert not [warning for warning in whole(mesh).warnings if "seam" in warning]


def test_bodies_that_nearly_touch_stay_apart_and_a_wall_thinner_than_the_gap_stays_thick() -> None:
    sewn = prepared(joined(cube(), at(cube(), (1.0 + 1e-8, 0.0, 0.0))), "mesh", Treatment(weld=0.1))
    assert component_count(sewn, mesh_edges(sewn)) == 2
    plate = replace(cube(), points=cube().points * (1.0, 1.0, 1e-3))
    sewn = prepared(loose(plate), "mesh", Treatment(weld=0.01))
    assert (genus(sewn, mesh_edges(sewn)), signed_volume(sewn)) == (0, pytest.approx(1e-3))


def test_gas_behind_a_wider_seam_says_what_closes_it() -> None:
    mesh = halves(noise(1e-4))
    said = {"balloon.inflation.kind": "gas"}
    with pytest.raises(InputError, match="expected --weld 2e-4, which closes it, or another") as refused:
        plan_model(load_scene(mesh, said))
    assert "open" in str(refused.value)
    plan_model(load_scene(mesh, {**said, "balloon.weld": 2e-4}))


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "closed"),
    [
        ("mesh.obj", False),
        ("mesh.obj --weld 2e-4", True),
        ("mesh.obj --weld=1e-3", True),
        ("--weld mesh.obj", False),
        ("mesh.obj --weld", False),
        ("mesh.obj --set balloon.weld=2e-4", True),
    ],
)
def test_weld_may_stand_alone_or_before_a_number(words: str, closed: bool, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_obj("mesh.obj", halves(noise(1e-4)))
    said = CliRunner().invoke(app, ["inspect", *words.split(), *["--json"] * ("--json" not in words)])
    assert said.exit_code == 0, said.output
    assert json.loads(said.stdout)["closed"] is closed


@pytest.mark.parametrize("value", ["0.5", "wide", "0", "-1e-4", "nan"])
def test_another_value_of_weld_is_refused(value: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "mesh.obj", cube())
    said = CliRunner().invoke(app, ["inspect", str(tmp_path / "mesh.obj"), f"--weld={value}"])
    assert isinstance(said.exception, InputError)
    assert str(said.exception).startswith(f"--weld {value}: expected a fraction of the mesh's size from 1e-06 to 0.1")


def test_a_scene_keeps_a_gap_and_a_truth(tmp_path: Path) -> None:
    for value in (2e-4, True, False):
        scene = load_scene(halves(noise(1e-4)), {"balloon.weld": value})
        write_scene(scene, tmp_path / "scene.toml")
        assert load_scene(tmp_path / "scene.toml").balloon[0].weld is value or value == 2e-4
        assert load_scene(tmp_path / "scene.toml").balloon[0].weld == value


def shuffled(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with its faces in another order, each from another corner."""
    faces = np.random.default_rng(1).permutation(mesh.face_vertex_indices.reshape(-1, 4))
    return replace(mesh, face_vertex_indices=np.roll(faces, 1, axis=1).ravel())


def rounded(mesh: PolygonMesh) -> PolygonMesh:
    return replace(mesh, points=mesh.points + np.random.default_rng(2).uniform(-1e-7, 1e-7, mesh.points.shape))


def on_the_same_vertices(mesh: PolygonMesh) -> PolygonMesh:
    """Return both sides on the same vertices, one after the other."""
    indices = np.concatenate([mesh.face_vertex_indices, inward(mesh).face_vertex_indices])
    return replace(mesh, face_vertex_counts=np.tile(mesh.face_vertex_counts, 2), face_vertex_indices=indices)


TWICE = {
    "shared": on_the_same_vertices(SOUND),
    "apart": joined(SOUND, inward(SOUND)),
    "shuffled": joined(SOUND, shuffled(inward(SOUND))),
    "rounded": joined(SOUND, rounded(inward(SOUND))),
    "soups": joined(loose(SOUND), loose(inward(SOUND))),
    "thrice": joined(SOUND, inward(SOUND), rounded(SOUND)),
}


@pytest.mark.parametrize("mesh", TWICE.values(), ids=TWICE)
def test_both_sides_of_a_ball_make_one_ball(mesh: PolygonMesh) -> None:
    once = whole(mesh)
    assert (genus(once, mesh_edges(once)), once.face_count) == (0, SOUND.face_count)
    assert signed_volume(once) == pytest.approx(signed_volume(SOUND), rel=1e-5)  # rounded vertices are moved by 1e-7
    assert f"{mesh.face_count - SOUND.face_count:,} faces have the corners of earlier faces" in " ".join(once.warnings)
    assert not [warning for warning in once.warnings if "no face" in warning]
    used = np.isin(np.arange(mesh.vertex_count), once.face_vertex_indices)
    stand_ins = np.array([once.stand_in(vertex) for vertex in range(mesh.vertex_count)])
    assert used[stand_ins].all()
    assert np.abs(mesh.points - mesh.points[stand_ins]).max() < 1e-6
    twice, alone = (shape_balloon(each, Scene(balloon=[each])) for each in (Balloon(mesh=mesh), Balloon(mesh=SOUND)))
    assert twice.springs.count == alone.springs.count


@pytest.mark.parametrize("sheet", [grid(4, 4), open_cube()])
def test_both_sides_of_a_sheet_make_one_sheet_and_no_flat_balloon_sewn_at_the_rim(sheet: PolygonMesh) -> None:
    once = whole(joined(sheet, inward(sheet)))
    assert once.face_count == sheet.face_count
    assert mesh_edges(once).count == mesh_edges(whole(sheet)).count


def test_one_part_of_several_may_be_there_twice() -> None:
    mesh = joined(at(cube(), (3.0, 0.0, 0.0)), SOUND, inward(SOUND), open_cube())
    once = whole(mesh)
    assert once.face_count == mesh.face_count - SOUND.face_count
    assert f"the first is face {7 + SOUND.face_count}, counting from 1" in " ".join(once.warnings)


def test_what_only_touches_counts_twice() -> None:
    """Boxes wall to wall, and two sheets sewn at the rim, a balloon that is still flat, are no duplicates."""
    assert whole(joined(cube(), at(cube(), (1.0, 0.0, 0.0)))).face_count == 12
    sheet = grid(4, 4)
    rim = (sheet.points[:, :2] % 4.0 == 0.0).any(axis=1)
    back = np.where(rim, np.arange(25), 25 + np.cumsum(~rim) - 1)[inward(sheet).face_vertex_indices]
    faces = np.concatenate([sheet.face_vertex_indices, back]).reshape(-1, 4)
    assert whole(mesh_of(np.concatenate([sheet.points, sheet.points[~rim]]), faces.tolist())).face_count == 32


def test_texture_coordinates_stay_with_their_corners_wherever_the_duplicate_stands(tmp_path: Path) -> None:
    textures = np.random.default_rng(3).random((SOUND.face_count * 4, 2), dtype=np.float32)
    both = replace(joined(SOUND, shuffled(inward(SOUND))), texture_coordinates=np.tile(textures, (2, 1)))
    write_obj(tmp_path / "both.obj", both)
    once = whole(load_mesh(tmp_path / "both.obj"))
    np.testing.assert_allclose(once.texture_coordinates, textures, atol=1e-6)  # seven digits are written


Mask = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
"""of the places of faces, shape (face_count, 3)"""


def without(mesh: PolygonMesh, gone: Mask) -> PolygonMesh:
    """Return the mesh of quads without the faces at some places."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    return mesh_of(mesh.points, quads[~gone(mesh.points[quads].mean(axis=1))].tolist())


def toward(*ways: tuple[float, float, float], angle: float) -> Mask:
    """Return a mask of places whose direction from the origin is within an angle [rad] of one of these."""
    axes = np.array(ways) / np.linalg.norm(ways, axis=1, keepdims=True)
    return lambda at: ((at / np.linalg.norm(at, axis=1, keepdims=True)) @ axes.T > np.cos(angle)).any(axis=1)


def tube(count: int, radius: float = 0.2) -> PolygonMesh:
    """Return a tube of so many rings of quads along z from 0 to 1, open at both ends."""
    return rings(np.full(count + 1, radius), np.linspace(0.0, 1.0, count + 1), lids=False)


BALL = quad_sphere(16)
EYES = toward((0.4, 0.2, 0.9), (-0.4, 0.2, 0.9), angle=0.2)
NECK = toward((0.0, -1.0, 0.0), angle=0.5)


def test_eye_sockets_are_closed_and_hold_gas() -> None:
    eyed = without(BALL, EYES)
    mesh = whole(eyed)
    edges = mesh_edges(mesh)
    assert (len(border_edges(edges)), len(inconsistent_edges(edges)), genus(mesh, edges)) == (0, 0, 0)
    # The cap of the unit ball above a flat lid of the radius sin(0.2), pi h^2 (1 - h / 3), is a thousandth of it.
    cut = 2.0 * np.pi * (1.0 - np.cos(0.2)) ** 2
    assert signed_volume(BALL) - 3.0 * cut < signed_volume(mesh) < signed_volume(BALL)
    said = "2 holes in the surface are closed by faces numbered after the file's; the largest has 16"
    assert mesh.warnings[0].startswith(said)
    np.testing.assert_array_equal(mesh.points, BALL.points)
    np.testing.assert_array_equal(mesh.face_vertex_indices[: 4 * 1500], eyed.face_vertex_indices[: 4 * 1500])
    assert signed_volume(whole(inward(eyed))) == pytest.approx(signed_volume(mesh), rel=1e-3)  # it is turned outward
    gas = Scene(balloon=[Balloon(mesh=eyed, inflation=Inflation(kind="gas"))])
    assert plan_model(gas).shapes[0].closed
    kept = gas.model_copy(update={"balloon": [gas.balloon[0].model_copy(update={"holes": "keep"})]})
    with pytest.raises(InputError, match="an open mesh cannot hold gas"):
        plan_model(kept)


OPEN: dict[str, PolygonMesh] = {
    "a bowl": without(BALL, lambda at: at[:, 1] > 0.0),
    "a cup": without(BALL, lambda at: at[:, 1] > 0.7),
    "a cube without a side": open_cube(),
    "a strip with one side": moebius(9),
    "a sleeve": tube(12),
    "a long sleeve, whose ends are 1% of it each": tube(12, radius=0.04),
    "a hem of 9%": without(replace(BALL, points=BALL.points * [1.0, 1.2, 0.6]), toward((0, -1, 0), angle=0.6)),
}


@pytest.mark.parametrize("name", OPEN)
def test_what_is_meant_to_be_open_stays_so(name: str) -> None:
    mesh = whole(OPEN[name])
    assert mesh.face_count == OPEN[name].face_count
    assert len(border_edges(mesh_edges(mesh))) > 0


def test_a_neck_stays_where_eyes_and_button_holes_are_closed() -> None:
    """An opening of 6% of the surface, or of a fifth of a shirt's hem."""
    mesh = whole(without(BALL, lambda at: EYES(at) | NECK(at)))
    (loop,) = border_loops(mesh, mesh_edges(mesh))
    assert (mesh.points[loop, 1] < -0.8).all()
    hem, neck, pin = toward((0, -1, 0), angle=0.7), toward((0, 1, 0), angle=0.4), toward((0, 0, 1), angle=0.09)
    shirt = without(BALL, lambda at: hem(at) | neck(at) | pin(at))
    assert [len(border_loops(mesh, mesh_edges(mesh))) for mesh in (shirt, whole(shirt))] == [3, 2]


def test_holes_of_details_are_closed_whatever_part_of_them_they_are() -> None:
    """Half an eyeball in a closed head gets a lid; a sheet does not, as the lid would lie on it."""
    eye = without(at(quad_sphere(4), (0, 0, 0), 0.1), lambda at: at[:, 2] < 0.0)
    for detail, borders in ((eye, 0), (at(grid(3, 1), (0, 0, 2), 0.05), 8)):
        assert len(border_edges(mesh_edges(whole(joined(BALL, detail))))) == borders


def test_holes_that_touch_are_closed_each() -> None:
    """Two missing quads that share a corner get a lid each: one loop around both would cross itself."""
    quads = BALL.face_vertex_indices.reshape(-1, 4)
    first = 5 * 16 + 5
    shared = int((np.isin(quads, quads[first]).sum(axis=1) == 1).argmax())
    centers = BALL.points[quads].mean(axis=1)
    gone = without(BALL, lambda at: np.linalg.norm(at[:, None] - centers[[first, shared]], axis=2).min(axis=1) < 1e-9)
    assert sorted(len(loop) for loop in border_loops(gone, mesh_edges(gone))) == [4, 4]
    mesh = whole(gone)
    assert mesh.face_count == BALL.face_count
    assert signed_volume(mesh) == pytest.approx(signed_volume(BALL), rel=1e-12)


@pytest.mark.parametrize("count", range(3, 12))
def test_a_lid_covers_its_loop_once(count: int) -> None:
    """A lid of a regular polygon has its area, half n sin(2 pi / n), and each rung on two faces."""
    points, lid = polygon(count).points, Lid(np.arange(count))
    area = 0.5 * count * np.sin(2.0 * np.pi / count)
    np.testing.assert_allclose(lid.vector_areas(points).sum(axis=0), [0.0, 0.0, area], atol=1e-12)
    mesh = mesh_of(points, [face.tolist() for face in lid.faces])
    edges = mesh_edges(mesh)
    assert len(border_edges(edges)) == count
    assert len(lid.rungs) == edges.count - count
    assert mesh.face_vertex_counts.max() <= 4


@pytest.mark.parametrize("taken", [{(0, 3)}, {(1, 4)}, {(0, 3), (2, 5)}, {(0, 3), (1, 4), (2, 5)}])
def test_a_rung_is_no_edge_that_is_there_already(taken: set[tuple[int, int]]) -> None:
    (rung,) = lid_across(np.arange(6), polygon(6).points, taken).rungs
    assert tuple(sorted(rung)) in ({(0, 3), (1, 4), (2, 5)} - taken or taken)


def test_lids_have_texture_coordinates_of_their_vertices() -> None:
    places, eyed = (BALL.points @ [[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]).astype(np.float32), without(BALL, EYES)
    mesh = whole(replace(eyed, texture_coordinates=places[eyed.face_vertex_indices]))
    np.testing.assert_array_equal(mesh.texture_coordinates, places[mesh.face_vertex_indices])


# A few hundred float64 operations of values near 1.
ROUND_OFF = 1e-13


def test_solids_and_sheets_have_known_areas_volumes_and_normals() -> None:
    mesh = cube()
    outward = geometry.face_centers(mesh) - 0.5
    np.testing.assert_allclose(geometry.face_vector_areas(mesh), 2.0 * outward, atol=ROUND_OFF)
    np.testing.assert_allclose(geometry.vertex_normals(mesh), (mesh.points - 0.5) * 2.0 / np.sqrt(3.0), atol=ROUND_OFF)
    for solid, volume, area in ((mesh, 1.0, 6.0), (tetrahedron(), 1.0 / 6.0, 1.5 + np.sqrt(3.0) / 2.0)):
        found = geometry.signed_volume(solid), geometry.total_area(solid)
        assert found == pytest.approx((volume, area), abs=ROUND_OFF)
    assert geometry.total_area(grid(3, 5)) == pytest.approx(15.0, abs=ROUND_OFF)
    # Least where three squares of the cube met: their normals are known to half a cell.
    assert np.einsum("ij,ij->i", geometry.vertex_normals(quad_sphere(16)), quad_sphere(16).points).min() > 0.999
    inside_out = replace(quad_sphere(4), face_vertex_indices=quad_sphere(4).face_vertex_indices[::-1].copy())
    assert geometry.signed_volume(inside_out) == pytest.approx(-geometry.signed_volume(quad_sphere(4)), abs=ROUND_OFF)


@pytest.mark.parametrize("mesh", [quad_sphere(5), torus(9, 7), prism(7), cube()])
def test_volume_is_the_mean_of_that_of_triangulations_by_trimesh_at_any_place(mesh: PolygonMesh) -> None:
    volumes = []
    for shift in (0, 1):
        faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
        shifted = mesh_of(mesh.points, [np.roll(face, shift).tolist() for face in faces])
        triangles, _ = geometry.triangulate(shifted)
        volumes.append(trimesh.Trimesh(mesh.points, triangles, process=False).volume)
    assert geometry.signed_volume(mesh) == pytest.approx(np.mean(volumes), abs=ROUND_OFF)
    # Coordinates of 1e6 are rounded at 1e-10, which moves the surface by as much.
    far = replace(mesh, points=mesh.points + 1e6)
    assert geometry.signed_volume(far) == pytest.approx(np.mean(volumes), rel=1e-8)
    assert geometry.volume_and_area(far)[1] == pytest.approx(geometry.total_area(mesh), rel=1e-8)


def test_vertex_normal_is_the_mean_of_unit_normals() -> None:
    # A big face and a small one at right angles count alike; the face without area counts nothing.
    points = [(0, 0, 0), (10, 0, 0), (10, 9, 0), (0, 9, 0), (0, 0, -1), (1, 0, -1), (1, 0, 0), (5, 5, 5)]
    mesh = mesh_of(points, [[0, 1, 2, 3], [0, 6, 5, 4], [0, 1, 1]])
    normals = geometry.vertex_normals(mesh)
    np.testing.assert_allclose(normals[0], np.array([0, 1, 1]) / np.sqrt(2.0), atol=ROUND_OFF)
    np.testing.assert_allclose(normals[1], [0, 0, 1], atol=ROUND_OFF)
    np.testing.assert_array_equal(normals[7], 0.0)  # of no face


def double_torus() -> PolygonMesh:
    """Return two tori without a quad each, glued along its border."""
    torus_a = torus(6, 6)
    quads = torus_a.face_vertex_indices.reshape(-1, 4)
    hole = quads[0].tolist()
    offset = torus_a.vertex_count
    # Glued along the same four vertices, the second torus must run the other way around them.
    second = quads[1:, ::-1] + offset
    for vertex in hole:
        second[second == vertex + offset] = vertex
    return mesh_of(np.zeros((2 * offset, 3)), [*quads[1:].tolist(), *second.tolist()])


FINS = mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
KNOWN = {
    "cube": (cube(), 0, True, 1, 0, 2, True),
    "quad sphere": (quad_sphere(5), 0, True, 1, 0, 2, True),
    "torus": (torus(7, 5), 0, True, 1, 1, 0, True),
    "double torus": (double_torus(), 0, True, 1, 2, -2, True),
    "torus and cube": (joined(torus(7, 5), cube()), 0, True, 2, 1, 2, True),
    "grid": (grid(3, 2), 10, True, 1, None, 1, True),
    "Moebius strip": (moebius(9), 18, True, 1, None, 0, False),
    "Klein bottle": (klein(6, 5), 0, True, 1, None, 0, False),
    "two quads at a vertex": (two_quads(), 8, False, 1, None, 1, True),
    "three triangles on an edge": (FINS, 6, False, 1, None, 1, None),
}
"""border edges, whether it is manifold, components, genus, Euler characteristic, and whether it is orientable"""


@pytest.mark.parametrize("case", KNOWN)
def test_known_topology(case: str) -> None:
    mesh, borders, manifold, components, handles, characteristic, orientable = KNOWN[case]
    edges = topology.mesh_edges(mesh)
    assert len(topology.border_edges(edges)) == borders
    assert topology.is_closed(edges) == (borders == 0)
    assert topology.is_manifold(mesh, edges) == manifold
    assert topology.component_count(mesh, edges) == components
    assert topology.genus(mesh, edges) == handles
    assert topology.euler_characteristic(mesh, edges) == characteristic
    assert orientable is None or topology.is_orientable(mesh, edges) == orientable


def test_non_manifold_parts_are_found() -> None:
    edges = topology.mesh_edges(FINS)
    assert edges.ends[topology.non_manifold_edges(edges)].tolist() == [[0, 1]]
    bow = two_quads()
    assert topology.non_manifold_vertices(bow, topology.mesh_edges(bow)).tolist() == [2]
    # Two cubes that touch at a corner are closed, and each edge has two faces.
    pair = joined(cube(), cube())
    touching = replace(pair, face_vertex_indices=np.where(pair.face_vertex_indices == 8, 7, pair.face_vertex_indices))
    assert topology.is_closed(topology.mesh_edges(touching))
    assert topology.non_manifold_vertices(touching, topology.mesh_edges(touching)).tolist() == [7]


@pytest.mark.parametrize("seed", range(5))
def test_component_labels_of_random_graphs(seed: int) -> None:
    first, second = np.random.default_rng(seed).integers(0, 200, size=(2, 150))
    expected = list(range(200))
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        low, high = sorted((expected[a], expected[b]))
        expected = [low if label == high else label for label in expected]
    assert component_labels(200, first, second).tolist() == expected


def test_component_labels_of_a_shuffled_chain() -> None:
    nodes = np.random.default_rng(1).permutation(10_000)
    assert (component_labels(10_000, nodes[:-1], nodes[1:]) == 0).all()
