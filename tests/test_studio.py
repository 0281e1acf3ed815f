"""Lights and a camera in the stage, in a group that can be omitted, and a subdivision surface without facets."""

import numpy as np
import pytest
from exported import FRAMES, scene
from meshes import tetrahedron
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdValidation
from test_resume import SCENE as RESUMED_SCENE
from test_resume import crash, stop

from balloon_warp import InputError, Scene, animate
from balloon_warp.outputs.render.stage_reader import RenderStage
from balloon_warp.scene import Balloon


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_camera_has_all_that_moves_in_view(tmp_path, up_axis: str):
    """The camera sees every point of balloons and every sphere, in every frame; they fill half of the view."""
    animate(scene(up_axis=up_axis), tmp_path / "out.usdc", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera"))
    frustum = camera.GetCamera(0).frustum
    project = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    seen = []
    for frame in range(FRAMES + 1):
        cache = UsdGeom.XformCache(frame)
        for path in ("/World/ball", "/World/box"):
            points = UsdGeom.Mesh(stage.GetPrimAtPath(path)).GetPointsAttr().Get(frame)
            seen += [project.Transform(Gf.Vec3d(point)) for point in points]
        for number in range(2):
            place = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(f"/World/Spheres/Sphere_{number}"))
            seen.append(project.Transform(place.ExtractTranslation()))
    seen = np.array(seen)
    assert np.abs(seen[:, :2]).max() < 1.0
    assert seen[:, 2].max() < 1.0  # between the clipping planes
    assert seen[:, 2].min() > -1.0
    assert np.ptp(seen[:, :2], axis=0).max() > 1.0
    up = frustum.ComputeUpVector()
    assert up["XYZ".index(up_axis)] > 0.9


def test_pictures_find_their_own_camera(tmp_path):
    """Pictures ignore the stage's own camera, which takes in all of the run, and use one of the user's."""
    animate(scene(frames=2), tmp_path / "out.usda", device="cpu")
    stage = RenderStage(tmp_path / "out.usda")
    stage.read_prims(0)
    assert stage.camera(0, 16 / 9) is None
    own = Usd.Stage.Open(str(tmp_path / "out.usda"))
    UsdGeom.Camera.Define(own, "/World/Mine")
    own.Save()
    stage = RenderStage(tmp_path / "out.usda")
    stage.read_prims(0)
    assert stage.camera(0, 16 / 9) is not None


def test_lights_and_ground_can_be_left_out(tmp_path):
    animate(scene(frames=2), tmp_path / "all.usda", device="cpu")
    animate(scene(frames=2), tmp_path / "few.usda", device="cpu", lights=False, ground=False)
    everything, few = (Usd.Stage.Open(str(tmp_path / name)) for name in ("all.usda", "few.usda"))
    paths = [{str(prim.GetPath()) for prim in stage.Traverse()} for stage in (everything, few)]
    assert {str(p) for p in paths[0] - paths[1] if not {"Looks", "Physics"} & {*p.split("/")}} == {
        *("/World/Studio", "/World/Ground"),
        *(f"/World/Studio/{name}" for name in ("Sky", "Key", "Rim", "Top", "Camera", "Backdrop")),
    }
    assert UsdLux.DomeLight(everything.GetPrimAtPath("/World/Studio/Sky"))
    bound = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(few.GetPrimAtPath("/World/ball"))
    assert bound.ComputeAlignedRange().GetSize()[0] < 3.0
    assert few.GetRootLayer().customLayerData["balloonWarp"]["leftOut"] == "lights ground"
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(few)


@pytest.mark.full
def test_a_run_without_ground_goes_on_without_it(tmp_path):
    """A run without ground resumes without it, as its ground would move. With ground it is another run."""
    whole, output = tmp_path / "whole.usdc", tmp_path / "out.usdc"
    animate(RESUMED_SCENE, whole, device="cpu", ground=False)
    folder = stop(RESUMED_SCENE, output, crash, device="cpu", ground=False)
    assert not Usd.Stage.Open(str(folder / "frames.usda")).GetPrimAtPath("/World/Ground")
    with pytest.raises(InputError, match="leftOut"):
        animate(RESUMED_SCENE, output, device="cpu", resume=True)
    animate(RESUMED_SCENE, output, device="cpu", resume=True, ground=False)
    assert output.read_bytes() == whole.read_bytes()
    assert not Usd.Stage.Open(str(output)).GetPrimAtPath("/World/Ground")


def test_triangles_are_refined_smoothly(tmp_path):
    few = Scene(balloon=[Balloon(mesh=tetrahedron())], frames=1)
    animate(few, tmp_path / "out.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    mesh = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    assert mesh.GetTriangleSubdivisionRuleAttr().Get() == "smooth"
