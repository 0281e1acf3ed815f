"""Stages as .glb files, read by trimesh, and by the specification alone."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from exported import FRAMES, RATE, STRING, UV, points, scene, turned
from glb_files import Glb
from pxr import Usd, UsdGeom

from balloon_warp import InputError, animate, export_stage
from balloon_warp.outputs.exports import glb


@pytest.fixture(scope="module", params=["Y", "Z"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exports") / "stage.usdc"
    animate(scene(up_axis=request.param), path, device="cpu")
    return path


@pytest.mark.full
def test_morph_targets_are_the_frames(written: Path, tmp_path: Path):
    """The weights of each keyframe give that frame's points; the root turns them so that Y is up."""
    export_stage(written, tmp_path / "out.glb")
    file = Glb(tmp_path / "out.glb")
    root = file.nodes["World"]
    stage = Usd.Stage.Open(str(written))
    half = np.sqrt(0.5)
    assert root.get("rotation") == (None if (turned(stage) == np.eye(3)).all() else pytest.approx([-half, 0, 0, half]))
    for name in ("ball", "box"):
        shapes = file.shapes(name)
        times, _, _ = file.channels(name)["weights"]
        np.testing.assert_allclose(times, np.arange(FRAMES + 1) / RATE, rtol=1e-6)
        assert len(shapes) == FRAMES + 1
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}"))
        for frame, shape in enumerate(shapes):
            expected = np.array(mesh.GetPointsAttr().Get(frame), np.float64)
            # Vertices are split by their texture coordinates: as sets of points they are the same.
            both = np.unique(np.round(shape, 5), axis=0), np.unique(np.round(expected, 5), axis=0)
            distance = np.linalg.norm(shape[:, None] - expected, axis=-1).min(axis=1)
            assert distance.max() < 1e-6  # a difference of two float32 near 3 is rounded by 1e-7
            assert len(both[0]) == pytest.approx(len(both[1]), abs=3)
        normals = file.shapes(name, "NORMAL")
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
        outward = (normals * (shapes - shapes.mean(axis=1, keepdims=True))).sum(axis=-1)
        assert (outward > 0.0).all()


@pytest.mark.full
def test_trimesh_reads_the_glb(written: Path, tmp_path: Path):
    """Trimesh reads the first frame without ground and water; objects that appear later have negligible size."""
    export_stage(written, tmp_path / "out.glb")
    found = trimesh.load(tmp_path / "out.glb", merge_primitives=True)
    assert isinstance(found, trimesh.Scene)
    assert set(found.geometry) == {"ball", "box", "Sphere_0", "Sphere_1", *STRING, "Obstacles_box"}
    placed = {name: found.graph.get(name) for name in found.graph.nodes_geometry}
    for name in ("ball", "box"):
        transform, _ = placed[name]
        here = trimesh.transform_points(found.geometry[name].vertices, transform)
        expected = points(written, f"/World/{name}", 0)
        np.testing.assert_allclose(here.min(axis=0), expected.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(here.max(axis=0), expected.max(axis=0), atol=1e-5)
        assert len(found.geometry[name].faces) == 2 * (54 if name == "ball" else 6)
    color = found.geometry["box"].visual.material.baseColorFactor
    np.testing.assert_allclose(color[:3], np.array([0.1, 0.2, 0.3]) * 255, atol=1.0)
    assert found.geometry["ball"].visual.uv is not None
    uv = np.unique(np.round(found.geometry["ball"].visual.uv, 5), axis=0)
    np.testing.assert_allclose(uv, np.unique(np.round(UV, 5), axis=0), atol=2e-5)


def test_what_is_rigid_moves_as_a_node(written: Path, tmp_path: Path):
    export_stage(written, tmp_path / "out.glb")
    file, stage = Glb(tmp_path / "out.glb"), Usd.Stage.Open(str(written))
    rigid = {"Sphere_0": "/World/Spheres/Sphere_0", "String_0_Knot": "/World/Strings/String_0_Knot"}
    for name, path in (rigid | {"Obstacles_box": "/World/Obstacles/box"}).items():
        prim = stage.GetPrimAtPath(path)
        assert "targets" not in file.primitive(name)
        moves = file.channels(name)
        matrices = [np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)) for frame in range(FRAMES + 1)]
        np.testing.assert_allclose(moves["translation"][1], [matrix[3, :3] for matrix in matrices], atol=1e-6)
        if name == "Obstacles_box":
            x, y, z, w = moves["rotation"][1].T
            first = np.stack([1 - 2 * (y**2 + z**2), 2 * (x * y + z * w), 2 * (x * z - y * w)], axis=1)
            expected = [matrix[0, :3] / np.linalg.norm(matrix[0, :3]) for matrix in matrices]
            np.testing.assert_allclose(first, expected, atol=1e-6)
            assert np.abs(first[-1] - first[0]).max() > 0.9
    _, sizes, how = file.channels("Sphere_1")["scale"]
    assert how == "STEP"
    np.testing.assert_array_equal(sizes[:, 0], [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert file.nodes["Sphere_1"]["scale"] == [0.0, 0.0, 0.0]


def test_a_glb_is_bounded_and_says_so(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: list[str] = []
    export_stage(written, tmp_path / "all.glb", on_note=told.append)
    assert "7 frames of" in told[0]
    assert "MB" in told[0]
    assert "room" not in told[0]
    monkeypatch.setattr(glb, "MOST_TARGETS", 3)
    export_stage(written, tmp_path / "few.glb", on_note=told.append)
    assert "every 2nd of 7 frames, to fit into 3 morph targets" in told[1]
    few = Glb(tmp_path / "few.glb")
    assert len(few.primitive("box")["targets"]) == 3
    np.testing.assert_allclose(few.shapes("box"), Glb(tmp_path / "all.glb").shapes("box")[::2], atol=1e-6)
    monkeypatch.setattr(glb, "MOST_BYTES", 24 * 500)
    with pytest.raises(InputError, match="moving vertices, too many for a"):
        export_stage(written, tmp_path / "none.glb")
    assert not (tmp_path / "none.glb").exists()
