"""Paper and light of a scene's picture: they are those of the stage, of our pictures, and of what Blender imports."""

from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdShade

from balloon_warp import Balloon, Ground, Scene, animate, render_stage

PAPER = (0.10, 0.30, 0.32)


def staged(folder: Path, **picture: object) -> Path:
    """Return the stage of a ball above the ground."""
    ball = Balloon(mesh=quad_sphere(6, 0.5), color=(0.5, 0.02, 0.02))
    scene = Scene(balloon=[ball], gravity=0.0, frames=1, ground=Ground(height=-1.0), picture=picture)
    animate(scene, folder / "ball.usdc", device="cpu")
    return folder / "ball.usdc"


def test_ground_and_backdrop_are_of_the_paper(tmp_path: Path):
    stage = Usd.Stage.Open(str(staged(tmp_path, paper=PAPER)))
    for path in ("/World/Ground", "/World/Studio/Backdrop"):
        prim = stage.GetPrimAtPath(path)
        assert np.allclose(UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()[0], PAPER)
        material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0]
        assert np.allclose(surface.GetInput("diffuseColor").Get(), PAPER)
    render_stage(staged(tmp_path, paper=PAPER), tmp_path / "ball.png", size=(64, 36), device="cpu")
    corner = np.asarray(Image.open(tmp_path / "ball.png"))[0, 0].astype(float)
    shown = (corner / 255.0) ** 2.2
    assert shown / shown.max() == pytest.approx(np.array(PAPER) / max(PAPER), abs=0.15)


@pytest.mark.parametrize("light", [-120.0, -45.0, 40.0, 120.0])
def test_the_main_light_comes_from_its_azimuth(light: float, tmp_path: Path):
    """The lamp is there in the stage, and a picture's highlight is on that side of the ball."""
    path = staged(tmp_path, light=light, azimuth=20.0, elevation=10.0)
    stage = Usd.Stage.Open(str(path))
    matrix = UsdGeom.XformCache(0).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Studio/Key"))
    assert matrix.GetDeterminant3() == pytest.approx(1.0)
    x, _, z = np.array(matrix.ExtractTranslation())  # the ball is at the origin
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(20.0 + light, abs=1.0)
    assert Gf.Vec3d(*matrix.GetRow3(2)) * Gf.Vec3d(x, 0.0, z) > 0.0  # a RectLight shines along its -Z
    if abs(light) < 90.0:  # else the strip light is in front
        render_stage(path, tmp_path / "ball.png", size=(160, 90), device="cpu")
        ball = np.asarray(Image.open(tmp_path / "ball.png").convert("L")).astype(float)[20:70, 45:115]
        left, right = ball[:, 10:34].mean(), ball[:, 36:60].mean()
        assert (right > left) == (light > 0.0)
