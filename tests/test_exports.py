"""Stages as files of other kinds, read back by programs that are not ours, or by their specification alone."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from exported import FRAMES, points, scene
from glb_files import Glb
from pxr import Usd, UsdGeom, UsdUtils, UsdValidation
from test_resume import FRAMES as RESUMED_FRAMES
from test_resume import SCENE as RESUMED_SCENE
from test_resume import press_ctrl_c, stop

from balloon_warp import InputError, MissingExtraError, PolygonMesh, animate, export_stage
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.outputs.exports import export, glb
from balloon_warp.outputs.knot import AROUND, PROFILE
from balloon_warp.outputs.round_shapes import capsule_mesh, sphere_mesh, tube_points, tube_topology

READ_ALEMBIC = """
import sys
import bpy
import numpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.alembic_import(filepath=sys.argv[1], as_background_job=False)
bpy.context.scene.frame_set(int(sys.argv[3]))
ball = bpy.data.objects["ball"].evaluated_get(bpy.context.evaluated_depsgraph_get())
numpy.save(sys.argv[2], [ball.matrix_world @ vertex.co for vertex in ball.data.vertices])
"""
"""in a process of its own, as Blender writes it"""


@pytest.fixture(scope="module", params=["Y", "Z"])
def written(request, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("exports") / "stage.usdc"
    animate(scene(up_axis=request.param), path, device="cpu")
    return path


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_a_file_for_each_frame_in_meters_with_y_up(written: Path, tmp_path, suffix: str):
    export_stage(written, tmp_path / f"out.####{suffix}")
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"out.{frame:04d}{suffix}" for frame in range(FRAMES + 1)]
    for frame, name in enumerate(names):
        found = trimesh.load(tmp_path / name, process=False, group_material=False)
        here = found.to_geometry() if isinstance(found, trimesh.Scene) else found
        for prim in ("ball", "box"):
            expected = points(written, f"/World/{prim}", frame)
            distance = np.linalg.norm(here.vertices[:, None] - expected, axis=-1).min(axis=0)
            assert distance.max() < 1e-6
        assert here.vertices[:, 1].max() < 6.0  # no ground of many meters
        # a sphere has 14 rings of 32 quads, and two caps of 16; the second one appears in the third frame
        spheres = 1 + (frame >= 2)
        string, knot = 6 * 16, AROUND * (len(PROFILE) - 2) + AROUND // 2
        obstacle = 6 * 9 * 9  # its edges are round
        assert len(here.faces) == 2 * (54 + 6 + obstacle + string + knot + spheres * (14 * 32 + 2 * 16))


def test_a_ply_has_normals_and_colors(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.##.ply")
    found = trimesh.load(tmp_path / "out.00.ply", process=False)
    ball = points(written, "/World/ball", 0)
    own = np.linalg.norm(found.vertices[:, None] - ball, axis=-1).min(axis=1) < 1e-5
    assert own.sum() == len(ball)
    outward = found.vertices[own] - ball.mean(axis=0)
    assert ((found.vertex_normals[own] * outward).sum(axis=1) > 0.9 * np.linalg.norm(outward, axis=1)).all()
    box = np.linalg.norm(found.vertices[:, None] - points(written, "/World/box", 0), axis=-1).min(axis=1) < 1e-5
    linear = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(found.visual.vertex_colors[box][0, :3], 255 * linear ** (1 / 2.2), atol=4.0)


def test_what_is_left_of_a_longer_sequence_is_named(written: Path, tmp_path):
    (tmp_path / "out.0099.ply").write_text("old")
    told: list[str] = []
    export_stage(written, tmp_path / "out.####.ply", on_note=told.append)
    assert told == ["out.0099.ply: from an earlier sequence of that name; kept"]
    assert (tmp_path / "out.0099.ply").read_text() == "old"


def test_a_package_passes_every_validator(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.usdz")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdz"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)] == []
    _, assets, unresolved = UsdUtils.ComputeAllDependencies(str(tmp_path / "out.usdz"))
    assert not unresolved
    assert not assets
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    before = Usd.Stage.Open(str(written))
    original = UsdGeom.Mesh(before.GetPrimAtPath("/World/ball"))
    for frame in range(FRAMES + 1):
        np.testing.assert_array_equal(mesh.GetPointsAttr().Get(frame), original.GetPointsAttr().Get(frame))


@pytest.mark.full
@pytest.mark.parametrize("kind", ["glb", "usdz", "usda"])
def test_run_writes_what_convert_makes_of_its_stage(tmp_path, kind: str):
    """A run writes what `convert` makes of its stage, and no other file but the requested picture."""
    small = scene(frames=2)
    animate(small, tmp_path / "stage.usdc", device="cpu")
    folder = tmp_path / "run"
    folder.mkdir()
    summary = animate(small, folder / f"out.{kind}", picture=folder / "out.png", device="cpu")
    assert summary.output == str(folder / f"out.{kind}")
    assert sorted(path.name for path in folder.iterdir()) == sorted([f"out.{kind}", "out.png"])
    export_stage(tmp_path / "stage.usdc", tmp_path / f"out.{kind}")
    if kind == "glb":
        assert (tmp_path / "out.glb").read_bytes() == (folder / "out.glb").read_bytes()


@pytest.mark.full
def test_a_run_that_is_stopped_goes_on_to_the_same_glb(tmp_path):
    whole, output = tmp_path / "whole.glb", tmp_path / "out.glb"
    animate(RESUMED_SCENE, whole, device="cpu")
    output.write_bytes(b"good")
    folder = stop(RESUMED_SCENE, output, press_ctrl_c, device="cpu")
    assert folder.name == "out.glb.partial"
    assert output.read_bytes() == b"good"
    summary = animate(RESUMED_SCENE, output, device="cpu", resume=True)
    assert 0 < summary.begin < RESUMED_FRAMES
    assert output.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.glb", "whole.glb"]


def test_a_failure_keeps_what_was_there_and_the_checkpoints(tmp_path, monkeypatch):
    """A failed write, such as on a full disk, keeps the old file and the checkpoints: hours of a run are safe."""

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    output = tmp_path / "out.glb"
    output.write_bytes(b"good")
    with monkeypatch.context() as patch:
        patch.setattr(glb.GlbBuffer, "write", fail)
        with pytest.raises(InputError, match=r"out\.glb: cannot be written: No space left"):
            animate(RESUMED_SCENE, output, device="cpu", checkpoint_seconds=1e-9)
    assert output.read_bytes() == b"good"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.glb", "out.glb.partial"]
    assert animate(RESUMED_SCENE, output, device="cpu", resume=True).begin > 0
    assert Glb(output).said["asset"]["version"] == "2.0"


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("out.fbx", r"cannot write \.fbx; expected \.usdc, .*\.glb, .*\.abc"),
        (
            "out.obj",
            r"is one file for all frames; expected #### in the name for the frame number, such as out\.####\.obj",
        ),
        ("missing/out.glb", "the folder .* does not exist"),
        ("stage.usdc", "is the input stage"),
    ],
)
def test_mistakes_are_told_before_any_work(written: Path, tmp_path, name: str, complaint: str):
    (tmp_path / "stage.usdc").write_bytes(written.read_bytes())
    with pytest.raises(InputError, match=complaint):
        export_stage(tmp_path / "stage.usdc", tmp_path / name)
    told: list[int] = []
    if name != "stage.usdc":
        with pytest.raises(InputError, match=complaint):
            animate(scene(), tmp_path / name, device="cpu", on_frame=told.append)
    assert told == []


def test_an_empty_stage_has_nothing_to_export(tmp_path):
    (tmp_path / "empty.usda").write_text("#usda 1.0\n")
    with pytest.raises(InputError, match=r"empty\.usda: has no mesh, cube, sphere, capsule or linear curves to export"):
        export_stage(tmp_path / "empty.usda", tmp_path / "out.glb")


def test_alembic_needs_blenders_module(written: Path, tmp_path, monkeypatch):
    from balloon_warp.outputs.exports import alembic

    monkeypatch.setattr(alembic, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"an \.abc needs Blender's Python module: pip install bpy"):
        export_stage(written, tmp_path / "out.abc")


def test_blender_writes_alembic(written: Path, tmp_path):
    pytest.importorskip("bpy")
    """And reads it back: the ball in the last frame, with Blender's Z up."""
    export_stage(written, tmp_path / "out.abc")
    assert (tmp_path / "out.abc").read_bytes()[:5] == b"Ogawa"
    command = [sys.executable, "-c", READ_ALEMBIC, str(tmp_path / "out.abc"), str(tmp_path / "ball.npy"), str(FRAMES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    expected = points(written, "/World/ball", FRAMES)[:, [0, 2, 1]] * [1, -1, 1]
    np.testing.assert_allclose(np.load(tmp_path / "ball.npy"), expected, atol=1e-5)


def test_every_writer_is_there():
    """Writers that the table names, to be imported late, exist."""
    from importlib import import_module

    for place in export.WRITERS.values():
        module, function = place.split(".")
        assert callable(getattr(import_module(f"balloon_warp.outputs.exports.{module}"), function))


@pytest.mark.parametrize("height", [0.0, 2.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_round_shapes_enclose_what_they_should(height: float, axis: int):
    """A sphere of 16 rings of 32 loses 2 % of its volume at most: (pi/32)^2 / 3 around and as much along, twice."""
    places, counts, indices = sphere_mesh(0.5) if height == 0.0 else capsule_mesh(0.5, height, axis)
    volume = signed_volume(PolygonMesh(places, counts, indices))
    exact = np.pi * 0.25 * height + np.pi / 6.0
    assert 0.98 * exact < volume < exact
    if height:
        assert np.ptp(places, axis=0).argmax() == axis
        assert np.ptp(places, axis=0).max() == pytest.approx(height + 1.0)


def test_tubes_follow_their_curves():
    """A tube along a circle has the volume of its cross section times the length of the curve, and open ends."""
    turn = np.linspace(0.0, np.pi, 200)
    curve = np.stack([np.cos(turn), np.sin(turn), np.zeros(200)], axis=1)
    lengths = np.array([200, 2], np.int32)
    centers = np.concatenate([curve, [[5.0, 0, 0], [5.0, 1.0, 0]]])
    places = tube_points(centers, lengths, 0.1)
    counts, indices = tube_topology(lengths)
    assert len(counts) == 6 * (199 + 1)
    distance = np.linalg.norm(places.reshape(-1, 6, 3) - centers[:, None], axis=-1)
    np.testing.assert_allclose(distance, 0.1, atol=1e-9)
    mesh = PolygonMesh(places, counts, indices)
    first = indices.reshape(-1, 4)[:6]
    normals = np.cross(places[first[:, 1]] - places[first[:, 0]], places[first[:, 3]] - places[first[:, 0]])
    assert ((places[first[:, 0]] - centers[0]) * normals).sum(axis=1).min() > 0.0  # outward
    assert mesh.face_count == len(counts)
