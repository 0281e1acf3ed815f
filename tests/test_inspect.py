"""Report of `inspect`, comparison of runs, check of a stage, and arguments of wrong types, each refused by name."""

import csv
import itertools
import json
import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import command, inside_out, lines_executed, status_of, with_faces
from meshes import cube, grid, joined, mesh_of, moebius, open_cube, prism, quad_sphere, torus, two_quads_at_a_vertex
from PIL import Image
from pxr import Gf, UsdGeom
from render_stages import new_stage

import balloon_warp as bw
from balloon_warp import InputError, PolygonMesh, Simulator, advise_step, animate, check_stage, inspect_mesh, load_mesh
from balloon_warp.errors import BlowUpError
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import signed_volume, total_area, triangulate
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.scene import Balloon, Inflation, Scene, load_scene
from balloon_warp.scene.load import override_scene
from balloon_warp.tools.compare import Comparison, compare, parse_choices


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
}
"""Those that no mesh of test_mesh_by_itself.py has, or has once"""


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


def test_no_loop_goes_over_vertices() -> None:
    few, many = quad_sphere(6), quad_sphere(22)
    assert lines_executed(lambda: inspect_mesh(many)) <= 1.1 * lines_executed(lambda: inspect_mesh(few))


@pytest.mark.full
def test_what_is_simulated_is_reported_and_what_is_otherwise_in_the_file(tmp_path: Path) -> None:
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


BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
EDGE = float(BALL.edges_unique_length.mean())
FRAMES = 3


class Stage:
    def __init__(self, path: Path):
        self.path = path
        self._stage = new_stage(path, frames=FRAMES)

    def balloon(self, name: str, mesh: trimesh.Trimesh, *way: Sequence[float]) -> "Stage":
        """Add a mesh with a shift of its points at each frame."""
        prim = self.obstacle(name, mesh, under="/World")
        for frame in range(FRAMES):
            shift = np.array(way[min(frame, len(way) - 1)])
            prim.GetPointsAttr().Set((mesh.vertices + shift).astype(np.float32), frame)
        return self

    def obstacle(self, name: str, mesh: trimesh.Trimesh, under: str = "/World/Obstacles") -> Any:
        prim = UsdGeom.Mesh.Define(self._stage, f"{under}/{name}")
        prim.CreatePointsAttr(np.asarray(mesh.vertices, np.float32))
        prim.CreateFaceVertexCountsAttr([3] * len(mesh.faces))
        prim.CreateFaceVertexIndicesAttr(mesh.faces.ravel().tolist())
        return prim

    def sphere(self, radius: float, center: Sequence[float]) -> "Stage":
        prim = UsdGeom.Sphere.Define(self._stage, "/World/Spheres/Sphere_0")
        prim.CreateRadiusAttr(radius)
        prim.AddTranslateOp().Set(Gf.Vec3d(*center))
        return self

    def capsule(self, radius: float, length: float, center: Sequence[float]) -> "Stage":
        prim = UsdGeom.Capsule.Define(self._stage, "/World/Obstacles/capsule")
        prim.CreateAxisAttr("Z")
        prim.CreateRadiusAttr(radius)
        prim.CreateHeightAttr(length)
        prim.AddTranslateOp().Set(Gf.Vec3d(*center))
        return self

    def ground(self, height: float) -> "Stage":
        corners = [(-9.0, height, 9.0), (9.0, height, 9.0), (9.0, height, -9.0), (-9.0, height, -9.0)]
        mesh = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
        self.obstacle("Ground", mesh, under="/World").GetPrim().SetCustomDataByKey(SCENERY, "Ground")
        return self

    def save(self) -> Path:
        self._stage.GetRootLayer().Save()
        return self.path


@pytest.fixture
def stage(tmp_path) -> Stage:
    return Stage(tmp_path / "stage.usda")


def test_what_is_apart_passes(stage: Stage):
    stage.balloon("one", BALL, (0, 0, 0)).balloon("two", BALL, (1.01, 0, 0)).sphere(0.1, (0, 0.61, 0)).ground(-0.5)
    report = check_stage(stage.save())
    assert report.passed
    assert (report.frames, len(report.things)) == (FRAMES, 4)


def test_balloons_that_cross_are_found_at_their_frame(stage: Stage):
    stage.balloon("one", BALL, (0, 0, 0)).balloon("two", BALL, (1.01, 0, 0), (0.97, 0, 0), (1.01, 0, 0))
    (crossing,) = check_stage(stage.save()).crossings
    assert (crossing.frame, crossing.first, crossing.second) == (1, "balloon one", "balloon two")
    assert 0.005 < crossing.depth < 0.031
    np.testing.assert_allclose(crossing.place, (0.485, 0.0, 0.0), atol=0.13)


def test_parts_of_a_balloon_that_cross_are_found(stage: Stage):
    stage.balloon("ball", BALL + BALL.copy().apply_translation((0.9, 0, 0)), (0, 0, 0))
    crossings = check_stage(stage.save()).crossings
    assert [crossing.frame for crossing in crossings] == list(range(FRAMES))
    assert {crossing.second for crossing in crossings} == {"balloon ball"}
    assert "itself" in str(crossings[0])


def sheet_of(*corners: Sequence[float]) -> trimesh.Trimesh:
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


FLAT = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)]  # corners of a sheet that looks up


@pytest.mark.parametrize(
    ("corners", "shift", "depth"),
    [
        pytest.param(FLAT, (0.7, 0, 0.1), 0.3, id="overlap"),
        pytest.param(FLAT, (0, 0, 0), 0.7, id="same-place"),
        pytest.param(FLAT, (1, 0, 0), 0.0, id="beside"),
        pytest.param(FLAT, (0.7, 0.001, 0.1), 0.0, id="above"),
        pytest.param(FLAT[::-1], (0.7, 0, 0.1), 0.0, id="face-to-face"),
    ],
)
def test_sheets_that_overlap_in_one_plane_are_found(corners: list, shift: tuple, depth: float, stage: Stage):
    stage.balloon("one", sheet_of(*FLAT), (0, 0, 0)).balloon("two", sheet_of(*corners), shift)
    crossings = check_stage(stage.save()).crossings
    assert len(crossings) == (FRAMES if depth else 0)
    for crossing in crossings:
        assert (crossing.first, crossing.second) == ("balloon one", "balloon two")
        assert crossing.depth == pytest.approx(depth, abs=0.05)
        least, most = np.array(shift) - 1e-6, np.array((1.0, 0.0, 1.0)) + 1e-6
        assert (least < crossing.place).all()
        assert (crossing.place < most).all()


def upright_sheet(cells: int) -> trimesh.Trimesh:
    sheet = grid(cells, cells)
    x, y, _ = sheet.points.T / cells
    places = np.stack([np.full(x.size, 0.013), 1.6 * y - 2.0, 2.0 * x - 1.0], axis=1)
    return trimesh.Trimesh(places, triangulate(sheet)[0], process=False)


BOX = trimesh.creation.box((3.0, 3.0, 3.0))
ROOM = BOX.copy()
ROOM.invert()
MIDDLE, OUTWARD, TIP = BALL.triangles_center[0], BALL.face_normals[0], 0.2 * EDGE


@pytest.mark.parametrize(
    ("kind", "how", "second", "depth", "within"),
    [
        pytest.param("capsule", (0.02, 0.001, MIDDLE + 0.002 * OUTWARD), "obstacle capsule", 0.02, 0.003, id="rod"),
        pytest.param("sphere", (TIP, MIDDLE + 0.25 * TIP * OUTWARD), "sphere Sphere_0", 0.75 * TIP, 1e-5, id="needle"),
        pytest.param("sphere", (TIP, MIDDLE + 0.9 * TIP * OUTWARD), "sphere Sphere_0", 0.0, 0.0, id="within-thickness"),
        pytest.param("obstacle", ("sheet", upright_sheet(1)), "obstacle sheet", 0.1, 0.01, id="coarse-sheet"),
        pytest.param("obstacle", ("sheet", upright_sheet(40)), "obstacle sheet", 0.1, 0.01, id="fine-sheet"),
        pytest.param("ground", (-0.4,), "the ground", 0.1, 1e-6, id="ground"),
        pytest.param("obstacle", ("box", BOX), "obstacle box", 1.5 - 0.5 / np.sqrt(3.0), 0.05, id="box-that-swallows"),
        pytest.param("obstacle", ("room", ROOM), "obstacle room", 0.0, 0.0, id="room-that-does-not"),
    ],
)
def test_a_ball_is_as_deep_as_it_is(kind: str, how: tuple, second: str, depth: float, within: float, stage: Stage):
    getattr(stage.balloon("ball", BALL, (0, 0, 0)), kind)(*how)
    crossings = check_stage(stage.save()).crossings
    assert {crossing.second for crossing in crossings} == ({second} if depth else set())
    assert max([crossing.depth for crossing in crossings], default=0.0) == pytest.approx(depth, abs=within)


@pytest.mark.full
def test_a_run_passes_or_does_not(tmp_path):
    BALL.export(tmp_path / "ball.obj")
    ball = {"mesh": str(tmp_path / "ball.obj"), "mass": 0.05}
    balls = [{**ball, "position": [-side, 0, 0], "velocity": [side / 0.6, 0, 0]} for side in (0.6, -0.6)]
    scene = {"balloon": balls, "gravity": 0.0, "frames": 24}
    animate(Scene(**scene, touch=False), tmp_path / "through.usda", device="cpu")
    animate(Scene(**scene), tmp_path / "apart.usda", device="cpu")
    assert not check_stage(tmp_path / "through.usda").passed
    report = check_stage(tmp_path / "apart.usda")
    assert report.passed, report.crossings


def test_bad_input_gets_a_sentence(stage: Stage):
    with pytest.raises(InputError, match="has nothing to check"):
        check_stage(stage.save())
    with pytest.raises(InputError, match="no such file"):
        check_stage(stage.path.with_name("none.usda"))
    path = stage.balloon("ball", BALL, (0, 0, 0)).save()
    with pytest.raises(InputError, match=r"has frames 0 to 2; expected a range within \(got 0:9\)"):
        check_stage(path, frames=(0, 9))
    with pytest.raises(InputError, match="expected at least 0 m"):
        check_stage(path, within=-1.0)


@pytest.mark.full
def test_the_command_says_where_and_ends_with_one(stage: Stage, capsys):
    path = stage.balloon("one", BALL, (0, 0, 0)).balloon("two", BALL, (0.9, 0, 0)).save()
    assert status_of("check", str(path), "--device", "cpu") == 1
    assert re.search(r"balloon one penetrates balloon two by [\d.]+ m at \(", capsys.readouterr().out)


SIZE = (96, 64)
GREEN = Balloon(mesh=quad_sphere(3), color=(0.0, 1.0, 0.0), damping=1.0, inflation=Inflation(k_normal=0.2))
GREEN_BALL = Scene(gravity=0.0, frames=6, picture_frame=4, balloon=[GREEN])
K_NORMAL = "balloon.inflation.k_normal"


def compared(folder: Path, vary: dict[str, list[Any]], **options: Any) -> Comparison:
    return compare(GREEN_BALL, vary, folder / "out.png", size=SIZE, samples=1, device="cpu", **options)


def tiles(folder: Path, rows: int, columns: int) -> list[np.ndarray]:
    """Return the sheet cut evenly, row by row; a tile keeps its label."""
    sheet = np.asarray(Image.open(folder / "out.png").convert("RGB"))
    return [part for band in np.array_split(sheet, rows) for part in np.array_split(band, columns, axis=1)]


def green(tile: np.ndarray) -> int:
    return int(((tile[..., 1] > 60) & (tile[..., 0] < 0.7 * tile[..., 1])).sum())


@pytest.mark.parametrize(
    ("text", "path", "values"),
    [
        ("a.b=1,2.5, x", "a.b", [1, 2.5, "x"]),
        ("a=[[0, 1], [1, 2]],3", "a", [[[0, 1], [1, 2]], 3]),
        ("a='x,y',true", "a", ["x,y", True]),
        ("balloon.mesh=some.obj", "balloon.mesh", [Path("some.obj")]),
    ],
)
def test_choices_are_read_as_in_set(text: str, path: str, values: list[Any]):
    assert parse_choices(text) == (path, values)


@pytest.mark.parametrize("text", ["a", "a=", "=1", "a=1,,2", "a..b=1"])
def test_choices_without_path_or_value_are_refused(text: str):
    with pytest.raises(InputError, match="expected PATH=VALUE"):
        parse_choices(text)


@pytest.mark.full
def test_every_value_meets_every_other_and_the_last_path_makes_the_columns(tmp_path):
    result = compared(tmp_path, {"frames_per_second": [60, 120], K_NORMAL: [0.0, 1.0, 2.0]})
    assert [tuple(run.values.values()) for run in result.runs] == [(f, k) for f in (60, 120) for k in (0.0, 1.0, 2.0)]
    assert {run.outcome for run in result.runs} == {"done"}
    assert result.runs[0].figures["substeps"] > result.runs[-1].figures["substeps"]
    small, larger, largest, *others = [green(tile) for tile in tiles(tmp_path, 2, 3)]
    assert 1.05 * small < larger < 0.95 * largest  # one camera: a ball that grew more looks larger
    assert others[0] == pytest.approx(small, rel=0.02)  # where nothing happens time does not matter
    assert others[0] < others[1] < others[2]


def test_the_figures_are_those_of_the_frame_that_is_shown(tmp_path):
    result = compared(tmp_path, {K_NORMAL: [0.5]})
    simulator = Simulator(override_scene(GREEN_BALL, [(K_NORMAL, 0.5)]), "cpu")
    *_, last = (frame for frame in simulator.run() if frame.number <= 4)
    shape = replace(simulator.model.shapes[0].mesh, points=last.points[0].astype(np.float64))
    figures, volume, area = result.runs[0].figures, signed_volume(shape), total_area(shape)
    assert figures["frame"] == last.number == 4
    np.testing.assert_allclose([figures["volume"], figures["area"]], [volume, area], rtol=1e-5)  # sums of 54 faces
    np.testing.assert_allclose(figures["roundness"], 36 * np.pi * volume**2 / area**3, rtol=5e-5)
    assert compared(tmp_path, {K_NORMAL: [0.5]}, frame=6).runs[0].figures["volume"] > figures["volume"]


def test_each_of_several_frames_is_shown_and_one_past_the_end_is_refused(tmp_path):
    result = compared(tmp_path, {"picture_frame": [2, 5, 7]})
    assert [run.figures.get("frame") for run in result.runs] == [2, 5, None]
    assert result.runs[2].sentence == "frame: 7 is not in the scene; expected 0 to 6"


@pytest.mark.full
def test_refused_and_exploded_runs_stand_beside_the_others(tmp_path):
    result = compared(tmp_path, {K_NORMAL: [0.1, 9e11, "much"]}, table=tmp_path / "out.csv")
    assert [run.outcome for run in result.runs] == ["done", "blew up", "refused"]
    rows = list(csv.DictReader((tmp_path / "out.csv").open(encoding="utf-8")))
    assert [row["outcome"] for row in rows] == ["done", "blew up", "refused"]
    assert [float(row["volume"]) > 0.0 if row["volume"] else None for row in rows] == [True, None, None]
    assert rows[0]["sentence"] == ""
    assert rows[1]["sentence"].startswith("the simulation blew up")
    assert rows[2]["sentence"].startswith(f"{K_NORMAL.replace('balloon', 'balloon.0')}: must be a valid number")
    good, *bad = tiles(tmp_path, 1, 3)
    assert green(good) > 100 > max(map(green, bad))
    assert all(tile.min() < 100 for tile in bad)  # the sentence


@pytest.mark.parametrize(
    ("vary", "options", "error", "sentence"),
    [
        ({}, {}, InputError, "nothing differs"),
        ({K_NORMAL: []}, {}, InputError, "nothing differs"),
        ({K_NORMAL: ["much", "more"]}, {}, InputError, "must be a valid number"),
        ({"no.such": [1]}, {}, InputError, "no: unknown table"),
        ({K_NORMAL: [9e11, 8e11]}, {}, BlowUpError, "the simulation blew up"),
        ({K_NORMAL: [1]}, {"frame": 7}, InputError, "frame: 7 is not in the scene; expected 0 to 6"),
        ({K_NORMAL: list(range(600))}, {}, InputError, "expected at most 8192x8192"),
        ({K_NORMAL: [1]}, {"table": "out.txt"}, InputError, "cannot write .txt; expected .csv"),
    ],
)
def test_where_no_run_is_good_nothing_is_written(tmp_path, vary, options, error, sentence):
    with pytest.raises(error, match=sentence):
        compared(tmp_path, vary, **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_the_command_prints_a_table_and_says_what_it_wrote(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    write_obj(tmp_path / "other.obj", quad_sphere(6))  # which takes other substeps
    words = "compare ball.obj --set frames=2 --device cpu --table t.csv --vary balloon.mesh=ball.obj,other.obj"
    assert status_of(*words.split(), "--vary", "normals=cached,fresh,stale") == 0
    lines, notes = (text.splitlines() for text in capsys.readouterr())
    assert [line.split(": ")[0] for line in notes] == [f"ball, run {n} of 6" for n in (1, 2, 4, 5)]
    assert lines[0] == "frame 2"
    assert lines[1].split()[:3] == ["mesh", "normals", "volume"]
    pairs = itertools.product(("ball.obj", "other.obj"), ("cached", "fresh", "stale"))
    assert [line.split()[:2] for line in lines[2:8]] == list(map(list, pairs))
    assert lines[8].startswith("refused: balloon.mesh = ball.obj, normals = stale: normals: must be 'cached' or")
    assert lines[-2:] == ["wrote ball_compare.png", "wrote t.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "ball_compare.png", "other.obj", "t.csv"]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: bw.remesh(cube(), "8"), r"cells: must be a whole number \(got '8'\)"),
        (lambda: bw.animate("two_balloons", 3.5), r"output: must be a path \(got 3.5\)"),
        (
            lambda: bw.render_stage("a.usdc", "a.png", size=np.zeros((2, 2))),
            r"size: must be 2 whole numbers \(got an array of shape \(2, 2\)\)",
        ),
        (lambda: bw.run_batch("two_balloons", "a", 2, export="1"), r"export: must be a list of whole numbers"),
        (lambda: bw.TrajectoryFiles("a", format="csv"), r"format: must be h5 or zarr or npz \(got 'csv'\)"),
    ],
)
def test_a_wrong_argument_is_named(call: Callable[[], Any], sentence: str, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"^{sentence}"):
        call()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: bw.Simulator(device="cpu"), "Simulator: missing a required argument: 'scene'"),  # pyright: ignore
        (
            lambda: bw.Simulator("two_balloons", fps=24),  # pyright: ignore
            "Simulator: got an unexpected keyword argument 'fps'; known are scene, device, world_count, vary, "
            "schedule, laws",
        ),
    ],
)
def test_arguments_that_do_not_fit_the_signature_are_named_with_the_function(call: Callable[[], Any], sentence: str):
    with pytest.raises(TypeError, match=f"^{re.escape(sentence)}$"):
        call()
