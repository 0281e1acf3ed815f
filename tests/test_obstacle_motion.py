"""Obstacles with the motion of a USD stage."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation

from balloon_warp import Balloon, InputError, Obstacle, Scene, Simulator
from balloon_warp.model import plan_model
from balloon_warp.model.obstacle_motion import obstacle_motion

pytestmark = pytest.mark.physics


def stage_of(path: Path, up_axis: str = "Z", scales: bool = False) -> Path:
    """Write a cube of a meter in a stage of centimeters, under a parent: in a second it goes by a meter along x, while
    the parent turns by a quarter about the up axis."""
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
    """Return the cube's corners in USD at a time code, in meters, y up."""
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
    """An obstacle's corners are where USD has them, in its own unit and axes; after the last sample it rests."""
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
        InputError, match=r"block\.usda: /turntable/block changes its size while moving; expected a rigid obstacle$"
    ):
        obstacle_motion(scene_with(path))


def clock(path: Path) -> Path:
    """Write a still dial and two hands, each turned by its own samples; one by points that turn, one by a transform."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetTimeCodesPerSecond(24)
    for number, name in enumerate(("dial", "hours", "minutes")):
        mesh = UsdGeom.Mesh.Define(stage, f"/clock/{name}")
        points = (cube().points - 0.5) * [0.2, 1.0, 0.2] + [2.0 * number, 0.0, 0.0]
        mesh.CreatePointsAttr(points)
        mesh.CreateFaceVertexCountsAttr([4] * 6)
        mesh.CreateFaceVertexIndicesAttr(cube().face_vertex_indices)
        turns = Rotation.from_euler("z", np.linspace(0.0, 90.0, 25)[:, None], degrees=True)
        if name == "hours":
            turn = mesh.AddRotateZOp()
            turn.Set(0.0, 0)
            turn.Set(60.0, 24)
        elif name == "minutes":
            for code, way in enumerate(turns):
                mesh.GetPointsAttr().Set(way.apply(points), code)
    stage.GetRootLayer().Save()
    return path


def test_each_part_of_a_stage_moves_by_its_own_samples(tmp_path: Path):
    """Moving parts become obstacles of their own, behind the others, with the same values."""
    scene = scene_with(clock(tmp_path / "clock.usda"), friction=0.25, name="clock")
    scene = scene.model_copy(update={"obstacle": [*scene.obstacle, Obstacle(position=(0.0, -9.0, 0.0))]})
    plan = plan_model(scene)
    assert [obstacle.name for obstacle in plan.scene.obstacle] == ["clock_dial", "", "clock_hours", "clock_minutes"]
    assert [obstacle.friction for obstacle in plan.scene.obstacle] == [0.25, 0.5, 0.25, 0.25]
    motion = obstacle_motion(plan.scene)
    turned = Rotation.from_quat(motion[60].reshape(-1, 7)[:, 3:]).magnitude()
    np.testing.assert_allclose(np.degrees(turned), [0.0, 0.0, 60.0, 90.0], atol=1e-4)  # points are in float32
    assert np.degrees(Rotation.from_quat(motion[30, 3, 3:]).magnitude()) == pytest.approx(45.0, abs=0.05)  # a chord
    shape = plan.obstacles[3]
    assert shape.mesh
    pose = motion[60, 3]
    np.testing.assert_allclose(  # about the stage's origin
        Rotation.from_quat(pose[3:]).apply(shape.mesh.points) + pose[:3],
        Rotation.from_euler("z", 90.0, degrees=True).apply(shape.mesh.points),
        atol=1e-5,
    )
    again = plan_model(plan.scene)  # as a worker of a batch has it
    assert len(again.scene.obstacle) == 4


def test_a_part_that_bends_is_refused_by_name(tmp_path: Path):
    path = clock(tmp_path / "clock.usda")
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/clock/minutes")).GetPointsAttr()
    bent = np.array(points.Get(12))
    bent[0] += 0.1
    points.Set(bent, 12)
    stage.GetRootLayer().Save()
    plan = plan_model(scene_with(path, prim="/clock/hours"))
    assert len(plan.scene.obstacle) == 1
    with pytest.raises(InputError, match=r"clock\.usda: /clock/minutes deforms by its points, skin or blend"):
        obstacle_motion(plan_model(scene_with(path)).scene)


def skinned(path: Path, weights: tuple[float, float]) -> Path:
    """Write a cube held by two joints, of which the second rises by a meter in a second."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(24)
    UsdSkel.Root.Define(stage, "/root")
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/bones")
    still = Vt.Matrix4dArray([Gf.Matrix4d(1.0)] * 2)
    skeleton.CreateJointsAttr(["still", "rising"])
    skeleton.CreateBindTransformsAttr(still)
    skeleton.CreateRestTransformsAttr(still)
    animation = UsdSkel.Animation.Define(stage, "/root/bones/rise")
    animation.CreateJointsAttr(["still", "rising"])
    animation.CreateRotationsAttr([Gf.Quatf(1.0)] * 2)
    animation.CreateScalesAttr([Gf.Vec3h(1.0)] * 2)
    moves = animation.CreateTranslationsAttr()
    for code in (0, 24):
        moves.Set([Gf.Vec3f(0.0), Gf.Vec3f(0.0, code / 24.0, 0.0)], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    mesh = UsdGeom.Mesh.Define(stage, "/root/block")
    mesh.CreatePointsAttr(cube().points)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(cube().face_vertex_indices)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    top = cube().points[:, 1] > 0.5
    binding.CreateJointIndicesPrimvar(False, 1).Set([int(each) for each in np.where(top, *weights)])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8)
    stage.GetRootLayer().Save()
    return path


def test_a_skin_is_followed_where_it_is_rigid(tmp_path: Path):
    """A skin held by one joint is followed as a rigid block; one held by two joints stretches and is refused."""
    motion = obstacle_motion(plan_model(scene_with(skinned(tmp_path / "whole.usda", (1, 1)))).scene)
    np.testing.assert_allclose(motion[[0, 30, 60], 0, :3], [[0, 0, 0], [0, 0.5, 0], [0, 1, 0]], atol=1e-6)
    with pytest.raises(InputError, match="/root/block deforms"):
        obstacle_motion(plan_model(scene_with(skinned(tmp_path / "top.usda", (1, 0)))).scene)
