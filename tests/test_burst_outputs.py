"""What is seen of balloons that burst: stages, pictures, tables, and the scene that shows them."""

from pathlib import Path

import numpy as np
import pytest
from meshes import mesh_of, quad_sphere
from pxr import Usd, UsdGeom, UsdValidation
from test_bursting import BALL, filled, scene_of

from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.outputs.render.stage_reader import RenderStage
from balloon_warp.outputs.usd import StageWriter
from balloon_warp.scene import Balloon, Scene, load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.recorder import Recorder, columns_of


def test_the_stage_loses_the_faces_that_tear(tmp_path: Path, device: str):
    """Their corners come to be at one vertex; validators take it, areas and volumes are of what is left, and pictures
    show no more of them."""
    scene = scene_of(quad_sphere(4, 0.1), needle_time=1e-3, tear_strength=1e6)
    simulator = filled(scene, 2.0, device)
    path = tmp_path / "burst.usdc"
    with StageWriter(path, simulator.model) as writer:
        frame = simulator.read_frame()
        writer.write(frame)
        for _ in range(7):
            simulator.step()
            frame = simulator.read_frame()
            writer.write(frame)
    stage = Usd.Stage.Open(str(path))
    (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    corners = [np.array(mesh.GetFaceVertexIndicesAttr().Get(number)).reshape(-1, 4) for number in range(8)]
    gone = [(each == each[:, :1]).all(axis=1) for each in corners]
    assert gone[0].sum() == 0
    assert gone[-1].sum() == frame.torn[0].sum() > 1
    np.testing.assert_array_equal(gone[-1], frame.torn[0])
    assert frame.volumes[0] == 0.0
    whole = simulator.model.shapes[0].mesh.face_vertex_indices.reshape(-1, 4)[~frame.torn[0]]
    left = mesh_of(frame.points[0].astype(np.float64), whole.tolist())
    assert frame.areas[0] == pytest.approx(total_area(left), rel=1e-5)
    errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(
        stage
    )
    assert not errors, [error.GetMessage() for error in errors]
    drawn = RenderStage(path)
    drawn.read_prims(0)
    first, last = drawn.gone(0), drawn.gone(7)
    assert first is not None
    assert last is not None
    assert first.sum() == 0 < last.sum()
    assert last.mean() == pytest.approx(gone[-1].mean())


def test_the_table_of_a_batch_says_which_worlds_burst(device: str):
    times = {"balloon.material.needle_time": [1e9, 1e-3]}
    scene = scene_of(quad_sphere(3, 0.1)).model_copy(update={"frames_per_second": 1000.0})
    simulator = Simulator(scene, device, 2, times)
    recorder = Recorder(simulator, np.zeros(0, dtype=np.int64))
    column = columns_of(scene).index("burst")
    assert recorder.read().measures[:, column].tolist() == [0.0, 0.0]
    for _ in range(3):
        simulator.step()
    assert recorder.read().measures[:, column].tolist() == [0.0, 1.0]
    assert "burst" not in columns_of(Scene(balloon=[Balloon(mesh=BALL)]))


def test_the_bundled_scene_pops(device: str):
    """One balloon bursts by itself at the strength, to pieces; a needle opens the other along one tear."""
    simulator = Simulator(load_scene("pop"), device)
    model = simulator.model
    pressure = float("nan")
    for _ in range(model.scene.frames):
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
    assert 0.3 < pumped < 0.6
    assert 0.01 < pierced < 0.25 * pumped
    assert (simulator.state.pressures.numpy() == 0.0).all()
    assert all(np.isfinite(array.numpy()).all() for array in vars(simulator.state).values())
