"""Outputs of balloons that burst: stages, pictures, tables, and the scene that shows them."""

from dataclasses import replace

import numpy as np
import pytest
from batches import OFTEN, contents, stop_after
from meshes import mesh_of, quad_sphere
from motion import assert_valid
from pxr import Usd, UsdGeom
from render_stages import read_stage
from test_bursting import BALL, filled, scene_of

from balloon_warp import Balloon, Inflation, Scene, Simulator, StageWriter, load_scene, run_batch
from balloon_warp.batch.output import STAGE_NAME
from balloon_warp.batch.recorder import columns_of
from balloon_warp.mesh.topology import beside_faces, signed_volume, total_area


def test_the_stage_loses_the_faces_that_tear(tmp_path, device: str):
    """Areas exclude torn faces, volumes are of the surface that bounds gas, and pictures do not draw them."""
    scene = scene_of(quad_sphere(4, 0.1), needle_time=1e-3, tear_strength=1e6)
    simulator = filled(scene, 2.0, device)
    path = tmp_path / "burst.usdc"
    with StageWriter(path, simulator.model) as writer:
        frame = simulator.read_frame()
        writer.write(frame)
        for _ in range(7):
            frame = simulator.step()
            writer.write(frame)
    stage = Usd.Stage.Open(str(path))
    (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Mesh))
    corners = [np.array(mesh.GetFaceVertexIndicesAttr().Get(number)).reshape(-1, 4) for number in range(8)]
    gone = [(each == each[:, :1]).all(axis=1) for each in corners]
    assert gone[0].sum() == 0
    assert gone[-1].sum() == frame.torn[0].sum() > 1
    np.testing.assert_array_equal(gone[-1], frame.torn[0])
    closed = replace(frame.meshes[0], points=frame.points[0].astype(np.float64))
    assert frame.gas_amounts[0] > 0.0  # which the torn faces still bound
    assert frame.volumes[0] == pytest.approx(signed_volume(closed), rel=1e-6)
    assert replace(frame, gas_amounts=np.zeros(1)).volumes[0] == 0.0
    whole = simulator.model.shapes[0].mesh.face_vertex_indices.reshape(-1, 4)[~frame.torn[0]]
    left = mesh_of(frame.points[0].astype(np.float64), whole.tolist())
    assert frame.areas[0] == pytest.approx(total_area(left), rel=1e-5)
    assert_valid(stage)
    drawn = read_stage(path)
    first, last = drawn.gone(0), drawn.gone(7)
    assert first is not None
    assert last is not None
    assert first.sum() == 0 < last.sum()
    assert last.mean() == pytest.approx(gone[-1].mean())


def test_what_a_tear_cut_off_is_not_framed(tmp_path):
    simulator = Simulator(scene_of(quad_sphere(4, 0.1)), "cpu")
    frame = simulator.read_frame()
    mesh, points = frame.meshes[0], frame.points[0].copy()
    around = (mesh.face_vertex_indices.reshape(-1, 4) == 0).any(axis=1)
    points[0] += 50.0
    path = tmp_path / "burst.usdc"
    with StageWriter(path, simulator.model) as writer:
        writer.write(replace(frame, points=[points], torn=[around]))
    stage = Usd.Stage.Open(str(path))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    (ball,) = (each for each in meshes if not each.GetPath().HasPrefix("/World/Studio"))
    np.testing.assert_allclose(ball.GetExtentAttr().Get(0), [points[1:].min(axis=0), points[1:].max(axis=0)])
    camera = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Studio/Camera")).ComputeLocalToWorldTransform(0)
    assert np.linalg.norm(camera.ExtractTranslation()) < 2.0


def test_a_batch_exports_worlds_that_burst(tmp_path):
    """Stage and tables are those of a run alone, without torn faces, and at last without volume; also when resumed."""
    balloon = scene_of(quad_sphere(4, 0.1), needle_time=1e9, tear_strength=1e5).balloon[0]
    balloon = balloon.model_copy(update={"inflation": Inflation(kind="pressure", pressure=600.0), "damping": 0.5})
    scene = Scene(balloon=[balloon], gravity=0.0, frames=14, frames_per_second=500.0)
    vary, warnings = {"balloon.material.needle_time": [1e9, 4e-3]}, []
    run_batch(scene, tmp_path / "whole", 2, vary, export=[0, 1], device="cpu", on_warning=warnings.append)
    assert not warnings
    stage = Usd.Stage.Open(str(tmp_path / "whole" / STAGE_NAME))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    with np.load(tmp_path / "whole" / "table.npz") as columns:
        table = {name: columns[name].reshape(15, 2) for name in ("volume", "area", "burst")}
    alone = Simulator(scene, "cpu", 1, {path: values[1:] for path, values in vary.items()}, schedule="gather")
    frame = alone.read_frame()
    for number in range(15):
        whole, burst = (np.array(mesh.GetFaceVertexIndicesAttr().Get(number)) for mesh in meshes)
        np.testing.assert_array_equal(whole, frame.meshes[0].face_vertex_indices)
        np.testing.assert_array_equal(burst, frame.corners(0))
        seen = frame.points[0][beside_faces(frame.meshes[0], frame.torn[0])]
        extent = meshes[1].GetExtentAttr().Get(number)
        np.testing.assert_allclose(extent, [seen.min(axis=0), seen.max(axis=0)], atol=1e-5)
        np.testing.assert_allclose(table["volume"][number, 1], frame.volumes[0], rtol=1e-5)
        np.testing.assert_allclose(table["area"][number, 1], frame.areas[0], rtol=1e-5)
        frame = alone.step()
    assert frame.torn[0].sum() > 2
    assert table["volume"][-1, 0] > 0.0 == table["volume"][-1, 1]
    assert table["burst"][[0, -1]].tolist() == [[0.0, 0.0], [0.0, 1.0]]
    assert "burst" not in columns_of(Scene(balloon=[Balloon(mesh=BALL)]))
    assert_valid(stage)
    again = {"export": [0, 1], "device": "cpu", "checkpoint_seconds": OFTEN}
    with pytest.raises(RuntimeError):
        run_batch(scene, tmp_path / "stopped", 2, vary, on_frame=stop_after(4), **again)
    run_batch(scene, tmp_path / "stopped", 2, vary, resume=True, **again)
    assert contents(tmp_path / "stopped") == contents(tmp_path / "whole")


def test_the_bundled_scene_pops(device: str):
    simulator = Simulator(load_scene("pop"), device)
    model = simulator.model
    pressure = float("nan")
    for _ in range(84):  # by then both have burst; from there on pieces fall
        before = simulator.state.pressures.numpy()[0].copy()
        whole = simulator.state.bursts.numpy()[0, :, 0] < 0.0
        simulator.step()
        if whole[0] and simulator.state.bursts.numpy()[0, 0, 0] >= 0.0:
            pressure = before[0]
    bursts, torn_faces = simulator.state.bursts.numpy()[0], simulator.state.torn.numpy()[0] >= 0.0
    strength = model.scene.balloon[0].material.strength
    assert bursts[0, 3] == pytest.approx(strength, rel=0.02)
    assert bursts[1, 0] == pytest.approx(0.0735, abs=1e-4)
    stretches = np.linspace(3.0, 6.0, 30001)
    half = 0.5 * 3.3e5 / 1.1
    slopes = 4.0 * half * (stretches - stretches**-5 + 0.1 * (stretches**3 - stretches**-3))
    at = float(np.interp(strength or 0.0, 0.5 * stretches * slopes, stretches))
    mesh = model.shapes[0].mesh
    expected = total_area(mesh) * 2e-4 * np.interp(at, stretches, slopes) / (3.0 * signed_volume(mesh) * at**2)
    assert pressure == pytest.approx(expected, rel=0.02)
    pumped, pierced = torn_faces[: len(torn_faces) // 2].mean(), torn_faces[len(torn_faces) // 2 :].mean()
    assert 0.01 < pierced < pumped < 0.1  # along two arms, or three, each a face wide
    assert (simulator.state.pressures.numpy() == 0.0).all()
    assert all(np.isfinite(array.numpy()).all() for array in simulator.state.arrays.values())
