"""Report of `balloon-warp inspect`, and its agreement with the simulation."""

import json
import os
import subprocess
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from inspecting import command, inside_out, with_faces
from meshes import cube, grid, joined, mesh_of, moebius, open_cube, prism, quad_sphere, torus, two_quads_at_a_vertex
from work import lines_executed

from balloon_warp import PolygonMesh, advise_step, inspect_mesh, load_mesh, load_scene
from balloon_warp.mesh.obj import write_obj


def curve(count: int) -> np.ndarray:
    """Return so many points, no four of them in a plane."""
    along = np.arange(count, dtype=np.float64)
    return np.stack([along, along**2, along**3], axis=1)


def test_report_of_a_cube() -> None:
    assert asdict(inspect_mesh(cube())) == {
        **{"vertices": 8, "faces": 6, "triangles": 0, "quads": 6, "ngons": 0, "unused_vertices": 0, "in_file": {}},
        **{"closed": True, "border_edges": 0, "manifold": True, "components": 1, "genus": 0, "warnings": []},
        "springs": {"structural": 12, "shear": 12, "flexion": 0, "holding": 0},
        "volume": pytest.approx(1.0, abs=1e-13),  # round-off of a sum of six terms
        "area": pytest.approx(6.0, abs=1e-13),
    }


def test_reports_of_polygons_of_all_sizes_of_a_strip_and_of_two_parts() -> None:
    report = inspect_mesh(mesh_of(curve(7), [[0, 1, 2], [2, 3, 4, 5], [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5]]))
    assert (report.faces, report.triangles, report.quads, report.ngons, report.unused_vertices) == (4, 1, 1, 2, 1)
    strip = inspect_mesh(moebius(9))
    assert (strip.closed, strip.border_edges, strip.manifold) == (False, 18, True)
    assert (strip.genus, strip.volume) == (None, None)
    pair = inspect_mesh(joined(cube(), torus(5, 5)))
    assert (pair.components, pair.genus, pair.closed) == (2, 1, True)
    assert "1,002 edges are on open borders" in inspect_mesh(grid(500, 1)).warnings[0]


WARNINGS = {
    "repeated corner, and two faces that only follow each other": (
        mesh_of(curve(5), [[0, 1, 2], [2, 3, 4], [4, 0, 4]]),
        "1 face repeats a corner; it is face 3, counting from 1. Repeated corners count once.",
    ),
    "duplicate faces": (
        with_faces(prism(5), [1, 6, 5, 0], [0, 1, 2, 3, 4]),
        "2 faces have the corners of earlier faces; the first is face 8, counting from 1. Repeated faces count once.",
    ),
    "coincident vertices": (
        joined(cube(), replace(cube(), points=cube().points + (1.0, 0.0, 0.0))),
        "4 vertices lie exactly on others; the first is vertex 9, at the place of vertex 2, counting from 1."
        " They are separate particles; --weld merges them.",
    ),
    "unused vertices": (
        replace(cube(), points=np.concatenate([cube().points, [(5.0, 5.0, 5.0), (6.0, 6.0, 6.0)]])),
        "2 vertices belong to no face; the first is vertex 9, counting from 1."
        " Such a vertex keeps its number, has no mass and stays where it is.",
    ),
    "non-manifold vertex": (
        two_quads_at_a_vertex(),
        "1 vertex joins parts of the surface that share no edge there; it is vertex 3, counting from 1."
        " The parts stay joined there.",
    ),
    "one of three components inward, one open": (
        joined(quad_sphere(1), inside_out(open_cube()), inside_out(torus(5, 5))),
        "1 closed component winds inward; it has face 12, counting from 1. Such a component is flipped outward.",
    ),
    "parts": (
        joined(cube(), torus(5, 5)),
        "2 separate parts (the second starts at face 7) are tied together by springs; "
        'parts = "free" lets them separate.',
    ),
    "the reader's": (replace(cube(), warnings=("The stage has 2 meshes.",)), "The stage has 2 meshes."),
}
"""Those that no mesh of test_odd_meshes.py has, or has once"""


@pytest.mark.parametrize("case", WARNINGS)
def test_warnings(case: str) -> None:
    mesh, sentence = WARNINGS[case]
    assert sentence in inspect_mesh(mesh).warnings


@pytest.mark.parametrize("mesh", [cube(), prism(7), torus(6, 5), quad_sphere(6)])
def test_a_sound_mesh_has_no_warnings(mesh: PolygonMesh) -> None:
    assert inspect_mesh(mesh).warnings == []


STAGES = ("reading the mesh", "checking the mesh and building springs", "building the scene")


def said(result: subprocess.CompletedProcess[str]) -> list[str]:
    """Return the lines of standard error but for stages, which a slow machine shows."""
    return [line for line in result.stderr.splitlines() if not line.endswith(STAGES)]


@pytest.mark.full
def test_command_prints_json_alone(tmp_path: Path) -> None:
    write_obj(tmp_path / "sphere.obj", quad_sphere(9))
    result = command(tmp_path / "sphere.obj", "--json")
    assert (result.returncode, said(result)) == (0, [])
    report = json.loads(result.stdout)
    step, (inflation,) = report.pop("step"), report.pop("inflation")
    assert (inflation["balloon"], inflation["pressure"] > 0.0) == ("sphere", True)
    assert report == asdict(inspect_mesh(load_mesh(tmp_path / "sphere.obj")))
    assert step["limiting_place"] == pytest.approx(quad_sphere(9).points[step["limiting_particle"]].tolist())


@pytest.mark.full
def test_command_prints_a_table_and_warnings(tmp_path: Path) -> None:
    write_obj(tmp_path / "grid[1].obj", grid(40, 40))
    result = command(tmp_path / "grid[1].obj")
    assert result.returncode == 0
    rows = {line.split()[0]: " ".join(line.split()[1:]) for line in result.stdout.splitlines()}
    assert "grid[1].obj" in rows
    assert rows["vertices"] == "1,681"
    assert rows["faces"] == "1,600 (0 triangles, 1,600 quads, 0 n-gons)"
    assert rows["springs"] == "9,678 (3,280 structural, 3,200 shear, 3,198 flexion)"
    assert rows["closed"] == "no, 160 border edges"
    assert (rows["manifold"], rows["components"], rows["genus"], rows["volume"]) == ("yes", "1", "-", "-")
    assert rows["area"] == "1,600 square units"
    assert rows["warning:"].startswith("160 edges are on open borders")


@pytest.mark.full
def test_command_refuses_a_bad_mesh_with_status_2(tmp_path: Path) -> None:
    """A mesh that makes no balloon is reported all the same."""
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n")
    result = command(tmp_path / "bad.obj")
    assert (result.returncode, result.stdout) == (2, "")
    assert said(result) == [f"error: {tmp_path / 'bad.obj'}, line 4: there is no vertex 4, the file has 3"]
    write_obj(tmp_path / "point.obj", replace(cube(), points=np.zeros((8, 3))))
    result = command(tmp_path / "point.obj", "--json")
    report = json.loads(result.stdout)
    assert (result.returncode, report["step"], report["vertices"]) == (2, None, 8)
    assert said(result)[0].startswith(f"error: {tmp_path / 'point.obj'}: all vertices coincide")


@pytest.mark.full
def test_a_solver_that_is_stable_at_any_step_is_said_to_be():
    report = json.loads(command("squirrel_inflate", "--set", "solver=projective", "--json").stdout)["step"]
    explicit = json.loads(command("squirrel_inflate", "--json").stdout)["step"]
    assert (report["solver"], report["substeps"]) == ("projective", 2)
    assert report == explicit | {"solver": "projective", "substeps": 2}
    step, explicitly, *_ = command("squirrel_inflate", "--set", "solver=projective").stdout.splitlines()[3:]
    assert step.rstrip().endswith('stable at any step: 2 with "auto" at 60 frames/s')
    assert explicitly.split()[:4] == ["explicit", "stable", "up", "to"]


@pytest.mark.full
def test_command_reports_a_scene_and_its_step(tmp_path: Path) -> None:
    result = command("sphere_launch", "--set", "balloon.stiffness.structural=100", "--json")
    assert (result.returncode, said(result)) == (0, [])
    report = json.loads(result.stdout)
    assert [Path(balloon["mesh"]).name for balloon in report["balloons"]] == ["pillow.obj"]
    scene = load_scene("sphere_launch", [("balloon.stiffness.structural", 100)])
    assert report["step"] == json.loads(json.dumps(asdict(advise_step(scene))))
    lines = command("sphere_launch").stdout.splitlines()
    assert lines[0] == "sphere_launch"
    assert any(line.startswith(" holds       1 balloon, 1 sphere") for line in lines)
    assert "pillow.obj" in lines
    for name, holds in (("table", "4 balloons, 1 obstacle"), ("two_balloons", "2 balloons, 1 tube")):
        assert any(f"holds       {holds}" in line for line in command(name).stdout.splitlines())
    unknown = command("sphere_lunch")
    assert (unknown.returncode, unknown.stdout) == (2, "")
    assert "sphere_lunch: no such scene or file; did you mean sphere_launch?" in unknown.stderr


def test_no_loop_goes_over_vertices() -> None:
    few, many = quad_sphere(6), quad_sphere(22)
    assert lines_executed(lambda: inspect_mesh(many)) <= 1.1 * lines_executed(lambda: inspect_mesh(few))


REAL = {
    "spot_quadrangulated": {"vertices": 2930, "quads": 2928, "genus": 0, "border_edges": 0},
    "mh_tongue": {"vertices": 226, "quads": 224, "genus": 0, "border_edges": 0},
    "mh_fedora": {"vertices": 634, "quads": 622, "closed": False},
    "mh_casualsuit01": {"vertices": 8426, "quads": 8336, "closed": False},
}
"""from the notes that come with the meshes"""


@pytest.mark.skipif("BALLOON_WARP_TEST_MESHES" not in os.environ, reason="needs BALLOON_WARP_TEST_MESHES")
@pytest.mark.parametrize("name", REAL)
def test_real_meshes(name: str) -> None:
    report = asdict(inspect_mesh(load_mesh(Path(os.environ["BALLOON_WARP_TEST_MESHES"]) / f"{name}.obj")))
    assert report == report | REAL[name]


@pytest.mark.full
def test_what_is_simulated_is_reported_and_what_is_otherwise_in_the_file(tmp_path: Path) -> None:
    """Counts and measures are those of a run, with the file's beside them: all faces are twice and inward."""
    faces = inside_out(cube()).face_vertex_indices.reshape(-1, 4)
    write_obj(tmp_path / "twice.obj", with_faces(inside_out(cube()), *faces.tolist()))
    report = json.loads(command(tmp_path / "twice.obj", "--json").stdout)
    assert (report["faces"], report["quads"], report["manifold"], report["genus"]) == (6, 6, True, 0)
    assert (report["volume"], report["area"]) == pytest.approx((1.0, 6.0))
    in_file = {"faces": 12, "quads": 12, "manifold": False, "genus": None, "area": 12.0}
    assert report["in_file"] == {**in_file, "volume": pytest.approx(-2.0)}
    rows = [line.split() for line in command(tmp_path / "twice.obj").stdout.splitlines()]
    assert ["volume", "1", "cubic", "units;", "in", "the", "file:", "-2", "cubic", "units"] in rows
    rows = [line.split() for line in command(tmp_path / "twice.obj", "--unit", "cm").stdout.splitlines()]
    assert ["area", "6", "cm²;", "in", "the", "file:", "12", "cm²"] in rows
    (tmp_path / "twice.toml").write_text("[[balloon]]\nmesh = 'twice.obj'\nunit = 'm'\n")
    assert "12 m²" in command(tmp_path / "twice.toml").stdout


@pytest.mark.full
def test_a_report_has_the_seams_holes_and_parts_of_the_scene(tmp_path: Path) -> None:
    """The report is of the scene's mesh, welded and closed, or as in the file; and of springs between parts."""
    ball = quad_sphere(9)
    corners = ball.points[ball.face_vertex_indices][4:]
    loose = mesh_of(corners, np.arange(len(corners)).reshape(-1, 4).tolist())
    write_obj(tmp_path / "loose.obj", joined(loose, replace(cube(), points=cube().points + 3.0)))

    def report(*words: str) -> dict:
        result = command(tmp_path / "loose.obj", "--json", *words)
        assert result.returncode == 0
        return json.loads(result.stdout)

    whole = report()
    assert (whole["closed"], whole["components"], whole["faces"]) == (True, 2, 486 + 6)
    assert whole["in_file"]["components"] == 486
    assert whole["springs"]["holding"] > 6
    assert not report("--set", "balloon.holes=keep")["closed"]
    assert report("--set", "balloon.weld=false", "--set", "balloon.parts=free")["components"] == 486
    assert report("--set", "balloon.parts=free")["springs"]["holding"] == 0
