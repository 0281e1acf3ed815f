"""Check of a stage: it finds crossings and their depths, and nothing else."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import status_of
from meshes import grid
from pxr import Gf, UsdGeom
from render_stages import new_stage

from balloon_warp import InputError, Scene, animate, check_stage
from balloon_warp.mesh.topology import triangulate
from balloon_warp.mesh.usd_stage import SCENERY

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
