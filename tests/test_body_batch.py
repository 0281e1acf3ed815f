"""Free bodies in a batch: the table and the stage of each world agree with the scene run alone."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from pxr import Usd, UsdGeom, UsdPhysics, UsdValidation

from balloon_warp import run_batch
from balloon_warp.scene import Balloon, Body, Ground, Scene, Sphere
from balloon_warp.simulator import Simulator

MASSES = [0.05, 0.4, 2.0]
SCENE = Scene(
    balloon=[Balloon(mesh=cube(), position=(0.0, 0.0, 0.0))],
    sphere=[Sphere(position=(3.0, 2.0, 0.0), radius=0.2)],
    body=[
        Body(name="brick", size=(1.5, 0.3, 1.4), position=(0.4, 1.45, 0.5), velocity=(0.0, -3.0, 0.0)),
        Body(shape="capsule", radius=0.1, length=0.3, position=(-2.0, 1.0, 0.0), rotation=(0.0, 0.0, 40.0)),
    ],
    ground=Ground(height=-1.5),
    frames=8,
)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bodies")
    run_batch(SCENE, folder, 3, {"body.0.mass": MASSES}, export=[0, 2], device="cpu")
    return folder


@pytest.mark.full
def test_table_and_stage_say_where_bodies_are(written):
    stage = Usd.Stage.Open(str(written / "worlds.usdc"))
    with np.load(written / "table.npz") as table:
        heights = {n: table[f"body_{n}_height"].reshape(9, 3) for n in (0, 1)}
        assert list(table)[-4:] == ["sphere_0_height", "body_0_height", "body_1_height", "health"]
    for world, mass in enumerate(MASSES):
        bodies = [SCENE.body[0].model_copy(update={"mass": mass}), SCENE.body[1]]
        simulator = Simulator(SCENE.model_copy(update={"body": bodies}), "cpu")
        weighed = UsdPhysics.MassAPI(stage.GetPrimAtPath(f"/World/World_{world}/brick"))
        if world != 1:
            assert weighed.GetMassAttr().Get() == np.float32(mass)
            moments = mass / 12.0 * np.array([0.3**2 + 1.4**2, 1.5**2 + 1.4**2, 1.5**2 + 0.3**2])
            np.testing.assert_allclose(sorted(weighed.GetDiagonalInertiaAttr().Get()), sorted(moments), rtol=1e-5)
        for frame in simulator.run():
            for number, name in enumerate(("brick", "capsule")):
                assert heights[number][frame.number, world] == frame.body_poses[number, 1]
                prim = UsdGeom.Xformable(stage.GetPrimAtPath(f"/World/World_{world}/{name}"))
                assert bool(prim) == (world != 1)
                if prim:
                    place, turn = (op.Get(frame.number) for op in prim.GetOrderedXformOps()[:2])
                    pose = [*place, *turn.GetImaginary(), turn.GetReal()]
                    np.testing.assert_array_equal(np.float32(pose), frame.body_poses[number])
    assert np.ptp(heights[0][-1]) > 1e-3  # the balloon brakes them differently


def test_the_stage_is_valid(written):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stage = Usd.Stage.Open(str(written / "worlds.usdc"))
    assert UsdValidation.ValidationContext(validators).Validate(stage) == []
