"""Welding: everywhere, along seams alone, and across gaps and rounding."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, moebius, open_cube, quad_sphere
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.seams import open_seam, welded, welded_along_seams
from balloon_warp.mesh.topology import component_count, genus, is_closed, mesh_edges
from balloon_warp.model import plan_model
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Scene, String, load_scene
from balloon_warp.scene.write import write_scene
from balloon_warp.simulator import Simulator


def loose(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with vertices of its own for each face."""
    corners = mesh.face_vertex_indices
    return replace(mesh, points=mesh.points[corners], face_vertex_indices=np.arange(len(corners), dtype=np.int32))


def test_welding_takes_the_first_vertex_at_a_place_and_tells_how_many_went() -> None:
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0), (2, 0, 0), (1, 1, -0.0), (0, 0, 0)]
    mesh = welded(mesh_of(points, [[0, 1, 2], [3, 4, 5]]))
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 1, 4, 2]
    assert mesh.stand_ins is not None
    assert mesh.stand_ins.tolist() == [0, 1, 2, 1, 4, 2, 0]
    assert mesh.warnings == (
        "2 vertices that lay exactly on others have been welded to them: they keep their numbers and move with them.",
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
    """Bodies that touch at a corner, along an edge or over a face stay apart: they share no seam."""
    for shift in ((1, 1, 1), (1, 1, 0), (1, 0, 0)):
        touching = joined(cube(), replace(cube(), points=cube().points + shift))
        assert welded_along_seams(touching) is touching
    corners = joined(grid(1, 1), replace(grid(1, 1), points=grid(1, 1).points + (1, 1, 0)))
    assert welded_along_seams(corners) is corners
    assert len(welded(corners).left_vertices) == 1


def test_two_loose_cubes_at_a_corner_become_two_cubes() -> None:
    """Two loose cubes at a corner become two cubes, each with its own vertex there."""
    pair = joined(loose(cube()), loose(replace(cube(), points=cube().points + (1, 1, 1))))
    sewn = prepared(pair, "pair", Treatment())
    assert component_count(sewn, mesh_edges(sewn)) == 2
    assert len(np.unique(sewn.face_vertex_indices)) == 16


def test_a_seam_with_a_point_in_it_is_no_seam_there() -> None:
    """Two quads beside a longer one share no seam: no edge of theirs lies on its edge from end to end."""
    wide = mesh_of([(0, -1, 0), (2, -1, 0), (2, 0, 0), (0, 0, 0)], [[0, 1, 2, 3]])
    apart = joined(grid(2, 1), wide)
    assert welded_along_seams(apart) is apart


def test_numbers_of_welded_vertices_mean_the_ones_that_stand_in(tmp_path: Path, device: str) -> None:
    """Numbers of welded vertices refer to their replacements: fixed, on a string, and in every frame."""
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


def uv_sphere(around: int, along: int, quads: bool = False) -> PolygonMesh:
    """Return a sphere of a graphics library, with a duplicate vertex around each ring and several at each pole: sine
    and cosine of a full turn leave them 1e-16 apart. Those at the poles of quads, too."""
    theta, phi = np.meshgrid(np.arange(along + 1) / along * np.pi, np.arange(around + 1) / around * 2 * np.pi)
    points = np.stack([-np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=2)
    faces = []
    for i in range(around):
        for j in range(along):
            a, b = (i + 1) * (along + 1) + j, i * (along + 1) + j
            c, d = b + 1, a + 1
            if quads:
                faces.append([a, b, c, d])
            else:
                faces += [[a, b, d]] * (j > 0) + [[b, c, d]] * (j < along - 1)
    return mesh_of(points.reshape(-1, 3), faces)


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    spin = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return points @ spin.T


def halves(move=lambda points: points, cells: int = 6) -> PolygonMesh:
    """Return a ball of two halves with vertices of their own, of which one is moved."""
    ball = quad_sphere(cells, 0.5)
    faces = ball.face_vertex_indices.reshape(-1, 4)
    left = ball.points[faces].mean(axis=1)[:, 0] < 0.0
    parts = []
    for half in (faces[left], faces[~left]):
        used, corners = np.unique(half, return_inverse=True)
        parts.append(mesh_of(ball.points[used], corners.reshape(-1, 4)))
    return joined(parts[0], replace(parts[1], points=move(parts[1].points)))


def noise(size: float):
    return lambda points: points + np.random.default_rng(0).uniform(-size, size, points.shape)


def in_floats(points: np.ndarray) -> np.ndarray:
    """Return the mesh turned by way of a distant place, in 32 bits, as a program does that moves parts one by one."""
    there = turned(points, 40.0).astype(np.float32) + np.float32(3.0)
    return turned((there - np.float32(3.0)).astype(np.float64), -40.0)


@pytest.mark.parametrize(
    "mesh",
    [
        *(uv_sphere(8, 4), uv_sphere(32, 16), uv_sphere(32, 16, quads=True)),
        *(replace(uv_sphere(24, 12), points=turned(uv_sphere(24, 12).points * 3.0, 17.0) + 5.0),),
        *(halves(noise(1e-9)), halves(noise(3e-7)), halves(in_floats)),
        *(replace(loose(quad_sphere(6)), points=noise(1e-7)(loose(quad_sphere(6)).points)),),
    ],
    ids=["uv", "finer", "quads", "moved", "mirrored", "barely", "floats", "soup"],
)
def test_seams_are_welded_across_what_rounding_makes(mesh: PolygonMesh) -> None:
    """Seams are welded across rounding into one closed ball, with no lid, and no face lost but at poles of quads."""
    sewn = prepared(mesh, "mesh", Treatment())
    assert genus(sewn, mesh_edges(sewn)) == 0
    assert component_count(sewn, mesh_edges(sewn)) == 1
    assert sewn.face_count == mesh.face_count
    assert not [warning for warning in sewn.warnings if "hole" in warning or "open" in warning.split(";")[0]]
    assert open_seam(mesh) is None or not is_closed(mesh_edges(mesh))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("gap", [2e-5, 1e-4, 2e-3])
def test_a_wider_seam_is_told_and_what_is_advised_closes_it(gap: float, size: float) -> None:
    """A wider seam is reported with its largest gap and a `weld` that closes it, at any size."""
    mesh = halves(noise(gap))
    mesh = replace(mesh, points=size * mesh.points)
    found = open_seam(mesh)
    assert found is not None
    assert found.closes
    assert gap * size < found.gap < 3.0**0.5 * gap * size
    left = prepared(mesh, "mesh", Treatment())
    assert not is_closed(mesh_edges(left))
    assert f"48 open edges lie within {found.gap:.2g} of others, like a seam; --weld {found.weld} joins them." in (
        left.warnings
    )
    assert float(found.weld) < 5.0 * gap
    sewn = prepared(mesh, "mesh", Treatment(weld=float(found.weld)))
    assert (genus(sewn, mesh_edges(sewn)), sewn.face_count) == (0, mesh.face_count)
    assert f"24 vertices along seams, up to {found.gap:.2g} from others," in sewn.warnings[0]


def test_a_seam_in_one_of_many_parts_is_told() -> None:
    """A seam in one of many parts is reported, beside sheets that are open by design."""
    sheets = [replace(grid(8, 8), points=grid(8, 8).points + (3.0, 9.0 * n, 0.0)) for n in range(4)]
    mesh = halves(noise(1e-4))
    for sheet in sheets:
        mesh = joined(mesh, sheet)
    found = open_seam(mesh)
    assert found is not None
    assert (found.edges, found.closes) == (48, False)


@pytest.mark.parametrize("mesh", [grid(6, 6), open_cube(), moebius(40), joined(grid(3, 3), cube())])
def test_what_is_meant_to_be_open_is_no_seam(mesh: PolygonMesh) -> None:
    assert open_seam(mesh) is None
    assert not [warning for warning in prepared(mesh, "mesh", Treatment()).warnings if "seam" in warning]


def test_bodies_that_nearly_touch_stay_apart_and_a_thin_wall_stays_thick() -> None:
    """Closed bodies that nearly touch stay apart, and walls thinner than the gap keep their two sides."""
    near = replace(cube(), points=cube().points + (1.0 + 1e-8, 0.0, 0.0))
    sewn = prepared(joined(cube(), near), "mesh", Treatment(weld=0.1))
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


@pytest.mark.parametrize(
    ("words", "closed"),
    [
        (["mesh.obj"], False),
        (["mesh.obj", "--weld", "2e-4"], True),
        (["--weld", "2e-4", "mesh.obj"], True),
        (["mesh.obj", "--weld=1e-3"], True),
        (["--weld", "mesh.obj"], False),
        (["mesh.obj", "--weld"], False),
        (["mesh.obj", "--weld", "--json"], False),
        (["mesh.obj", "--set", "balloon.weld=2e-4"], True),
    ],
)
def test_weld_may_stand_alone_or_before_a_number(
    words: list[str], closed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`--weld` without a number means exact coincidence, whatever follows."""
    monkeypatch.chdir(tmp_path)
    write_obj("mesh.obj", halves(noise(1e-4)))
    said = CliRunner().invoke(app, ["inspect", *words, *["--json"] * ("--json" not in words)])
    assert said.exit_code == 0, said.output
    assert json.loads(said.stdout)["closed"] is closed


@pytest.mark.parametrize("value", ["0.5", "wide", "0", "-1e-4", "nan"])
def test_another_value_of_weld_is_refused(value: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "mesh.obj", cube())
    said = CliRunner().invoke(app, ["inspect", str(tmp_path / "mesh.obj"), f"--weld={value}"])
    assert isinstance(said.exception, InputError)
    assert str(said.exception).startswith(f"--weld {value}: expected a fraction of the mesh's size from 1e-06 to 0.1")


def test_a_scene_keeps_a_gap_and_a_truth(tmp_path: Path) -> None:
    """A gap and a flag for welding survive a round trip through a scene file."""
    for value in (2e-4, True, False):
        scene = load_scene(halves(noise(1e-4)), {"balloon.weld": value})
        write_scene(scene, tmp_path / "scene.toml")
        assert load_scene(tmp_path / "scene.toml").balloon[0].weld is value or value == 2e-4
        assert load_scene(tmp_path / "scene.toml").balloon[0].weld == value
