"""Strings in the stage: their curves, and the meshes around these."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube, quad_sphere
from pxr import Sdf, Usd, UsdGeom, UsdShade

from balloon_warp import Scene, animate
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.outputs.usd.strand import points_around
from balloon_warp.outputs.usd.string_curve import string_curve
from balloon_warp.scene import Balloon, String

FRAMES = 6


@pytest.fixture(scope="module")
def stage(tmp_path_factory) -> Usd.Stage:
    """Return a stage of a ball that rises on a string."""
    path: Path = tmp_path_factory.mktemp("stage") / "string.usdc"
    ball = Balloon(mesh=quad_sphere(3), name="ball", position=(0, 2, 0), helium=20.0)
    scene = Scene(balloon=[ball], string=[String(anchor=(0, 0, 0), length=2.0)], frames=FRAMES)
    animate(scene, path, device="cpu")
    return Usd.Stage.Open(str(path))


def test_strings_go_from_anchor_to_particle(stage: Usd.Stage):
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Strings/String_0"))
    ball = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    held = int(quad_sphere(3).points[:, 1].argmin())
    assert curve.GetTypeAttr().Get() == "linear"
    for time in range(FRAMES + 1):
        points = np.array(curve.GetPointsAttr().Get(time))
        np.testing.assert_array_equal(points[0], 0.0)
        np.testing.assert_allclose(points[-1], ball.GetPointsAttr().Get(time)[held], atol=1e-6)


def test_a_string_on_the_second_balloon_ends_at_its_particle(tmp_path):
    balloons = [Balloon(mesh=cube(), name="first"), Balloon(mesh=quad_sphere(3), name="second", position=(5, 3, 0))]
    scene = Scene(balloon=balloons, string=[String(anchor=(5, 0, 0), balloon=1)], frames=3)
    animate(scene, tmp_path / "two.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "two.usda"))
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Strings/String_0"))
    second = UsdGeom.Mesh(stage.GetPrimAtPath("/World/second"))
    held = int(quad_sphere(3).points[:, 1].argmin())
    for time in range(4):
        np.testing.assert_allclose(
            curve.GetPointsAttr().Get(time)[-1], second.GetPointsAttr().Get(time)[held], atol=1e-6
        )


def test_a_slack_string_hangs_by_its_length_and_a_taut_one_is_straight():
    """A slack string hangs as a parabola, with a length error of the series: 2 % at a slack of 10 %."""
    taut = string_curve((0, 1, 0), (2, 1, 0), 2.0, (0, 1, 0), -np.inf)
    np.testing.assert_allclose(taut[:, 1], 1.0, atol=1e-6)
    slack = string_curve((0, 1, 0), (2, 1, 0), 2.2, (0, 1, 0), -np.inf)
    assert np.linalg.norm(np.diff(slack, axis=0), axis=1).sum() == pytest.approx(2.2, rel=0.02)
    assert slack[:, 1].min() < 0.8
    assert string_curve((0, 1, 0), (2, 1, 0), 9.0, (0, 1, 0), 0.5)[:, 1].min() == pytest.approx(0.5)
    assert np.isfinite(string_curve((0, 0, 0), (0, 0, 0), 1.0, (0, 1, 0), 0.0)).all()


def test_a_mesh_goes_around_each_string(stage: Usd.Stage):
    """A mesh surrounds each string, of its thickness and wound outward, for programs that give curves no material."""
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Strings/String_0"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Strings/String_0_Mesh"))
    assert UsdGeom.Imageable(curve).GetPurposeAttr().Get() == "proxy"
    prim, purpose = mesh.ComputeProxyPrim()
    assert (prim, purpose.GetName()) == (curve.GetPrim(), "String_0_Mesh")
    assert mesh.GetPurposeAttr().Get() == "render"
    paths = [UsdShade.MaterialBindingAPI(each).ComputeBoundMaterial()[0].GetPath() for each in (curve, mesh)]
    assert paths[0] == paths[1] != Sdf.Path()
    (width,) = curve.GetWidthsAttr().Get()
    middle = around = np.empty((0, 3))
    for time in range(FRAMES + 1):
        middle = np.array(curve.GetPointsAttr().Get(time))
        around = np.array(mesh.GetPointsAttr().Get(time)).reshape(len(middle), -1, 3)
        # float32 has 1e-7 of the places, about a meter from the origin
        np.testing.assert_allclose(around.mean(axis=1), middle, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(around - middle[:, None], axis=2), 0.5 * width, atol=1e-6)
    counts, indices = mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
    # a hexagon's prism has 3 sqrt(3) / 2 r^2 of its length; its ends are open, and so it is measured from its middle
    points = around.reshape(-1, 3) - middle.mean(axis=0)
    volume = signed_volume(PolygonMesh(points, np.array(counts), np.array(indices)))
    length = np.linalg.norm(np.diff(middle, axis=0), axis=1).sum()
    assert 0.0 < volume < 1.5 * 3.0**0.5 * (0.5 * width) ** 2 * length


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_points_around_a_curve_lie_across_it(bend: float):
    """Rings around a curve are perpendicular to it, straight or bent, and where points coincide."""
    along = np.linspace(0.0, 1.0, 17)
    curve = np.stack([along, bend * along * (1.0 - along), 0.0 * along], axis=1).astype(np.float32)
    around = points_around(curve, 0.01).reshape(17, -1, 3) - curve[:, None]
    np.testing.assert_allclose(np.linalg.norm(around, axis=2), 0.01, atol=1e-6)
    direction = np.gradient(curve, axis=0)
    # the curve's places have 1e-7, the radius is 1e-2: a direction so has 1e-5
    assert np.abs(np.einsum("pij,pj->pi", around, direction / np.linalg.norm(direction, axis=1)[:, None])).max() < 1e-6
    assert np.isfinite(points_around(np.zeros((17, 3), np.float32), 0.01)).all()
