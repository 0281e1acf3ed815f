"""Free bodies in frames, in the stage, in pictures of it and in checkpoints."""

from pathlib import Path

import numpy as np
import pytest
from meshes import grid, quad_sphere
from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation
from scipy.spatial.transform import Rotation

from balloon_warp import Body, Scene, Simulator, animate
from balloon_warp.outputs.render.stage_reader import RenderStage
from balloon_warp.scene import Balloon, Ground
from balloon_warp.scene.load import load_scene
from balloon_warp.scene.write import scene_toml

FRAMES = 4
PATHS = ("/World/Bodies/box", "/World/Bodies/rod", "/World/Bodies/mesh", "/World/Bodies/mesh_1")


def everything(**fields) -> Scene:
    """Return a small balloon beside one body of each shape, turning."""
    bodies = [
        Body(size=(0.2, 0.3, 0.4), position=(2, 1, 0), angular_velocity=(1, 2, 3), mass=2.5, color=(0.1, 0.2, 0.3)),
        Body(radius=0.1, length=0.5, position=(-2, 1, 0), rotation=(40, 0, 20), name="rod", velocity=(0, 1, 0)),
        Body(mesh=quad_sphere(3, 0.5), scale=0.5, position=(0, 3, 0), density=100.0, rotation=(0, 30, 0)),
        Body(mesh=grid(2, 3), position=(0, 5, 0), thickness=0.05),
    ]
    table = {"balloon": [Balloon(mesh=quad_sphere(3, 0.5))], "body": bodies, "frames": FRAMES, "frames_per_second": 30}
    return Scene(**table | fields)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "bodies.usdc"
    animate(everything(), path, device="cpu")
    return path


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_every_validator_passes(tmp_path, up_axis: str):
    path = tmp_path / "stage.usda"
    animate(everything(up_axis=up_axis), path, device="cpu")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    assert [error.GetMessage() for error in errors] == []


def test_the_stage_has_the_poses_of_the_simulation(written: Path):
    """Place and turn agree in every frame, about the centers of mass."""
    stage, simulator = Usd.Stage.Open(str(written)), Simulator(everything(), "cpu")
    for number in range(FRAMES + 1):
        poses = simulator.read_frame().body_poses
        assert poses.shape == (4, 7)
        for path, pose in zip(PATHS, poses, strict=True):
            prim = stage.GetPrimAtPath(path)
            found = np.array(UsdGeom.XformCache(number).GetLocalToWorldTransform(prim)).T
            scale = UsdGeom.Xformable(prim).GetOrderedXformOps()[2:]
            size = np.array(scale[0].Get()) if scale else np.ones(3)
            np.testing.assert_allclose(found[:3, 3], pose[:3], atol=1e-6)
            np.testing.assert_allclose(found[:3, :3] / size, Rotation.from_quat(pose[3:]).as_matrix(), atol=5e-6)
        simulator.step()


def test_the_stage_says_what_they_weigh(written: Path):
    stage = Usd.Stage.Open(str(written))
    box = UsdPhysics.MassAPI(stage.GetPrimAtPath(PATHS[0]))
    assert box.GetMassAttr().Get() == 2.5
    sides = 2.5 / 12.0 * np.array([0.3**2 + 0.4**2, 0.2**2 + 0.4**2, 0.2**2 + 0.3**2])
    np.testing.assert_allclose(sorted(box.GetDiagonalInertiaAttr().Get()), sorted(sides), rtol=1e-6)
    q = box.GetPrincipalAxesAttr().Get()
    axes = Rotation.from_quat([*q.GetImaginary(), q.GetReal()]).as_matrix()
    tensor = axes @ np.diag(box.GetDiagonalInertiaAttr().Get()) @ axes.T
    np.testing.assert_allclose(tensor, np.diag(sides), atol=1e-6)


def test_pictures_have_them_at_their_places(written: Path):
    """Sides of the box and ends of the capsule are where the poses put them, in every frame that is drawn."""
    reader, simulator = RenderStage(written), Simulator(everything(), "cpu")
    reader.read_prims(0)
    for number in range(FRAMES + 1):
        box, rod = simulator.read_frame().body_poses[:2].astype(float)
        own = Rotation.from_quat(box[3:]).inv().apply(reader.points(number)[1] - box[:3])
        np.testing.assert_allclose([-own.min(axis=0), own.max(axis=0)], np.tile([0.1, 0.15, 0.2], (2, 1)), atol=1e-6)
        (begin,), (end,), (radius,) = reader.capsules(number)
        up = Rotation.from_quat(rod[3:]).apply((0, 0.25, 0))
        np.testing.assert_allclose([begin, end], [rod[:3] - up, rod[:3] + up], atol=1e-6)
        assert radius == pytest.approx(0.1)
        simulator.step()


def test_a_scene_with_bodies_is_written_and_read_again(tmp_path):
    scene = everything(body=[Body(size=(0.2, 0.3, 0.4), position=(2, 1, 0), mass=2.5, friction=0.1)])
    balloon = scene.balloon[0].model_copy(update={"mesh": Path("ball.obj")})
    path = tmp_path / "scene.toml"
    path.write_text(scene_toml(scene.model_copy(update={"balloon": [balloon]}), tmp_path))
    assert load_scene(path, {"body.0.mass": 7.0}).body[0] == scene.body[0].model_copy(update={"mass": 7.0})


def test_they_go_on_from_a_checkpoint_bit_for_bit():
    scene = everything(ground=Ground(height=0.5), frames=30)
    first, again = Simulator(scene, "cpu"), Simulator(scene, "cpu")
    for _ in range(10):
        first.step()
    again.restore({name: np.array(array.numpy()) for name, array in first.state.arrays.items()})
    for _ in range(10):
        first.step()
        again.step()
    np.testing.assert_array_equal(first.read_frame().body_poses, again.read_frame().body_poses)
