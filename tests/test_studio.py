"""Studio of a stage: lights that face the subject, a backdrop that fills the picture, and a camera."""

from pathlib import Path

import numpy as np
import pytest
from exported import FRAMES, scene
from meshes import tetrahedron
from motion import assert_valid
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade
from render_stages import read_stage
from test_resume import SCENE as RESUMED_SCENE
from test_resume import crash, stop

from balloon_warp import InputError, Scene, animate
from balloon_warp.outputs.exports.parts import Animation
from balloon_warp.scene import Balloon, Ground, Obstacle
from balloon_warp.scene.schema import Picture


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_camera_has_all_that_moves_in_view(tmp_path, up_axis: str):
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


def test_pictures_and_exports_find_their_own_camera_and_backdrop(tmp_path):
    animate(scene(frames=2), tmp_path / "out.usda", device="cpu")
    stage = read_stage(tmp_path / "out.usda")
    assert stage.camera(0, 16 / 9) is None
    own = Usd.Stage.Open(str(tmp_path / "out.usda"))
    UsdGeom.Camera.Define(own, "/World/Mine")
    own.Save()
    stage = read_stage(tmp_path / "out.usda")
    assert stage.camera(0, 16 / 9) is not None
    staged(tmp_path)
    animate(scene(frames=2), tmp_path / "plain.usdc", device="cpu", lights=False)
    drawn = [read_stage(tmp_path / name) for name in ("out.usdc", "plain.usdc")]
    assert len(drawn[0].meshes) == len(drawn[1].meshes)
    assert "Backdrop" not in {part.name for part in Animation(tmp_path / "out.usdc").parts}


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
    assert_valid(few)


@pytest.mark.full
def test_a_run_without_ground_goes_on_without_it(tmp_path):
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


SIDES = [None, Picture(azimuth=200.0, elevation=0.0), Picture(azimuth=-70.0, elevation=50.0, zoom=2.0)]
SOFTBOXES = ("Key", "Rim", "Top")


def staged(tmp_path: Path, name: str = "out.usdc", **fields) -> Usd.Stage:
    animate(scene(frames=2, **fields), tmp_path / name, device="cpu")
    return Usd.Stage.Open(str(tmp_path / name))


def backdrop_of(stage: Usd.Stage) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles in the world, shape (n, 3, 3), and their unit normals as authored, shape (n, 3)."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Studio/Backdrop"))
    matrix = np.array(UsdGeom.XformCache(0).GetLocalToWorldTransform(mesh.GetPrim()))
    points = np.array(mesh.GetPointsAttr().Get()) @ matrix[:3, :3] + matrix[3, :3]
    normals = np.array(mesh.GetNormalsAttr().Get()) @ matrix[:3, :3]
    indices, first, triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()), 0, []
    for count in mesh.GetFaceVertexCountsAttr().Get():
        triangles += [indices[[first, first + k, first + k + 1]] for k in range(1, count - 1)]
        first += count
    return points[np.array(triangles)], normals[np.array(triangles)].mean(axis=1)


def meets(origin: np.ndarray, direction: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the triangles that a ray hits, after Moller and Trumbore."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, ac)
    area = np.einsum("ij,ij->i", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", origin - a, p) / area
        q = np.cross(origin - a, ab)
        v, t = q @ direction / area, np.einsum("ij,ij->i", ac, q) / area
        return (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1.0 + 1e-6) & (t > 0.0)


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("ground", [None, Ground(height=-3.0)])
def test_the_backdrop_is_all_that_is_behind(up_axis: str, side: Picture | None, ground: Ground | None, tmp_path):
    """Rays from the picture's corners and the middles of its edges hit the backdrop's inside."""
    stage = staged(tmp_path, up_axis=up_axis, picture=side, ground=ground)
    triangles, normals = backdrop_of(stage)
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")).GetCamera(0).frustum
    for x in (-1.0, 0.0, 1.0):
        for y in (-1.0, 0.0, 1.0):
            ray = frustum.ComputePickRay(Gf.Vec2d(x, y)) if (x or y) else frustum.ComputePickRay(Gf.Vec2d(0.01, 0.01))
            direction = np.array(ray.direction) / np.linalg.norm(ray.direction)
            met = meets(np.array(ray.startPoint), direction, triangles)
            assert met.any(), (x, y)
            assert (normals[met] @ direction).max() < 0.0, (x, y)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_ground_lies_on_the_backdrop_and_gives_as_much_light(up_axis: str, tmp_path):
    stage = staged(tmp_path, up_axis=up_axis, ground=Ground(height=-3.0))
    up = "XYZ".index(up_axis)
    lowest = backdrop_of(stage)[0][:, :, up].min()
    assert -3.1 < lowest < -3.0
    glows = []
    for path in ("/World/Ground", "/World/Studio/Backdrop"):
        material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0]
        source = surface.GetInput("emissiveColor").GetConnectedSources()[0]
        if source:
            glows.append(UsdShade.Shader(source[0].source.GetPrim()).GetInput("fallback").Get())
            primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("glow")
            assert np.allclose(primvar.Get()[0], glows[-1])  # its middle is floor
        else:
            glows.append(surface.GetInput("emissiveColor").Get())
    assert 0.0 < max(glows[0]) < 1.0
    assert np.allclose(*glows)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("side", SIDES)
def test_softboxes_shine_at_the_subject_and_are_not_seen(up_axis: str, side: Picture | None, tmp_path):
    """Softboxes face the subject, out of view: the key on the camera's left, the rim on its right, the top above."""
    stage = staged(tmp_path, up_axis=up_axis, picture=side)
    cache, up = UsdGeom.XformCache(0), np.eye(3)["XYZ".index(up_axis)]
    subject = UsdGeom.BBoxCache(0, ["default"])
    center = np.array(subject.ComputeWorldBound(stage.GetPrimAtPath("/World/ball")).ComputeCentroid())
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")).GetCamera(0).frustum
    view = np.array(frustum.ComputeViewMatrix())[:3, :3]
    places = {}
    for name in SOFTBOXES:
        prim = stage.GetPrimAtPath(f"/World/Studio/{name}")
        matrix = np.array(cache.GetLocalToWorldTransform(prim))
        places[name] = matrix[3, :3] - center
        distance = np.linalg.norm(places[name])
        assert -matrix[2, :3] @ -places[name] > 0.8 * distance  # a RectLight shines along its -Z
        assert not frustum.Intersects(Gf.Vec3d(*matrix[3, :3].tolist()))
        assert UsdLux.LightAPI(prim).GetNormalizeAttr().Get()
    right = {name: (place @ view)[0] / np.linalg.norm(place) for name, place in places.items()}
    assert right["Key"] < -0.2 < 0.2 < right["Rim"]
    assert places["Top"] @ up > 0.9 * np.linalg.norm(places["Top"])
    assert all(place @ up > 0.0 for place in places.values())


def test_a_large_subject_is_as_bright_as_a_small_one(tmp_path):
    """Power over distance squared is that of a small subject."""
    shares = []
    for scale in (1.0, 30.0):
        small = Scene(balloon=[Balloon(mesh=tetrahedron(), scale=scale)], frames=1, gravity=0.0)
        animate(small, tmp_path / "out.usda", device="cpu")
        stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
        bound = UsdGeom.BBoxCache(1, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World").GetChildren()[0])
        shares.append([])
        for name in SOFTBOXES:
            prim = stage.GetPrimAtPath(f"/World/Studio/{name}")
            place = UsdGeom.XformCache(0).GetLocalToWorldTransform(prim).ExtractTranslation()
            distance = (place - bound.ComputeCentroid()).GetLength()
            shares[-1].append(UsdLux.LightAPI(prim).GetIntensityAttr().Get() / distance**2)
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_camera_looks_from_where_the_scene_says(up_axis: str, tmp_path):
    """A camera at 90 degrees azimuth and 30 elevation looks along -X, and down."""
    stage = staged(tmp_path, up_axis=up_axis, picture=Picture(azimuth=90.0, elevation=30.0))
    direction = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")).GetCamera(0).frustum.ComputeViewDirection()
    expected = np.zeros(3)
    expected[[0, "XYZ".index(up_axis)]] = -np.cos(np.radians(30.0)), -0.5
    assert np.allclose(direction, expected, atol=1e-6)


def test_the_scene_may_look_nearer(tmp_path):
    """A zoom of 2 halves the field of view, around a target of its own, as in the scene's picture."""
    at = (0.5, 0.25, -0.125)
    far, near = (staged(tmp_path, f"{zoom}.usdc", picture=Picture(zoom=zoom, look_at=at)) for zoom in (1.0, 2.0))
    cameras = [UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")) for stage in (far, near)]
    heights = [camera.GetVerticalApertureAttr().Get() / camera.GetFocalLengthAttr().Get() for camera in cameras]
    assert heights[0] == pytest.approx(2.0 * heights[1])
    frustum = cameras[1].GetCamera(0).frustum
    middle = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(Gf.Vec3d(*at))
    assert np.allclose(middle[:2], 0.0, atol=1e-6)


@pytest.mark.full
def test_a_picture_zooms_into_all_that_is_shown(tmp_path):
    sees, far = [], Obstacle(name="box", position=(-12.0, 1.0, 0.0))
    for picture in (None, Picture()):
        stage = staged(tmp_path, f"{picture is None}.usdc", picture=picture, obstacle=[far])
        frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")).GetCamera(0).frustum
        box = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World/Obstacles/box"))
        project = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        corners = [project.Transform(box.ComputeAlignedRange().GetCorner(number)) for number in range(8)]
        sees.append(np.abs(np.array(corners)[:, :2]).max() < 1.0)
    assert sees == [False, True]
