"""Obstacles that move as a USD stage has them."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from pxr import Gf, Usd, UsdGeom
from scipy.spatial.transform import Rotation

from balloon_warp import Balloon, InputError, Obstacle, Scene, Simulator
from balloon_warp.model.obstacle_motion import obstacle_motion


def stage_of(path: Path, up_axis: str = "Z", scales: bool = False) -> Path:
    """A cube of a meter in a stage of centimeters, under a parent: in a second it goes by a meter along x, while the
    parent turns by a quarter about the up axis."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, up_axis)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(12)
    stage.SetEndTimeCode(36)
    parent = UsdGeom.Xform.Define(stage, "/turntable")
    turn = parent.AddRotateZOp() if up_axis == "Z" else parent.AddRotateYOp()
    mesh = UsdGeom.Mesh.Define(stage, "/turntable/block")
    mesh.CreatePointsAttr(100.0 * (cube().points - 0.5))
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(cube().face_vertex_indices)
    move = mesh.AddTranslateOp()
    for code, part in ((12, 0.0), (36, 1.0)):
        turn.Set(90.0 * part, code)
        move.Set(Gf.Vec3d(100.0 * part, 0.0, 0.0), code)
    if scales:
        grow = mesh.AddScaleOp()
        grow.Set(Gf.Vec3f(1.0), 12)
        grow.Set(Gf.Vec3f(2.0), 36)
    stage.GetRootLayer().Save()
    return path


def corners_of(path: Path, code: float) -> np.ndarray:
    """Where USD has the cube's corners at a time code, in meters, y up."""
    stage = Usd.Stage.Open(str(path))
    matrix = np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/turntable/block")).ComputeLocalToWorldTransform(code))
    local = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/turntable/block")).GetPointsAttr().Get())
    world = 0.01 * (local @ matrix[:3, :3] + matrix[3, :3])
    return world if UsdGeom.GetStageUpAxis(stage) == "Y" else world[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def scene_with(path: Path, **fields) -> Scene:
    return Scene(
        balloon=[Balloon(mesh=cube(), position=(0.0, 9.0, 0.0))],
        obstacle=[Obstacle(mesh=path, **fields)],
        frames_per_second=60.0,
        frames=70,
    )


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_an_obstacle_goes_where_its_stage_says(tmp_path: Path, up_axis: str):
    """Its corners are where USD has them at that time, in its own unit and axes; after the last sample it rests."""
    path = stage_of(tmp_path / "block.usda", up_axis)
    simulator = Simulator(scene_with(path, position=(0.0, 2.0, 0.0)), "cpu", schedule="gather")
    mesh = simulator.model.obstacles[0].mesh
    assert mesh
    for frame in simulator.run():
        pose = frame.obstacle_poses[0]
        placed = Rotation.from_quat(pose[3:]).apply(mesh.points) + pose[:3]
        code = 12 + min(frame.time, 1.0) * 24
        # a quaternion in float32, of a place two meters away
        np.testing.assert_allclose(placed, corners_of(path, code) + [0.0, 2.0, 0.0], atol=2e-6)


def test_keyframes_take_the_place_of_a_stages_motion(tmp_path: Path):
    path = stage_of(tmp_path / "block.usda")
    scene = scene_with(path, motion=[(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 3.0))])
    np.testing.assert_allclose(obstacle_motion(scene)[60, 0], [0, 0, 3, 0, 0, 0, 1], atol=1e-12)


def test_an_obstacle_that_grows_is_refused(tmp_path: Path):
    path = stage_of(tmp_path / "block.usda", scales=True)
    with pytest.raises(
        InputError, match=r"block\.usda: /turntable/block changes its size as it moves; expected .* rigid$"
    ):
        obstacle_motion(scene_with(path))
