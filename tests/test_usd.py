"""Stage as it is read back, its lights and camera; glTF at its default pose; names in any script."""

import base64
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import FRAMES, animated, assert_valid, assert_velocities_are_those_of_the_points, at_start, scene
from meshes import cube, quad_sphere, tetrahedron
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from render_stages import read_stage
from test_resume import SCENE as RESUMED_SCENE
from test_resume import crash, gone_on, stop

from balloon_warp import InputError, PolygonMesh, Scene, Simulator, StageWriter, animate, load_mesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Obstacle, Sphere, Water
from balloon_warp.scene.scene import Picture
from balloon_warp.studio.parts import Animation
from balloon_warp.usd.balloon import string_curve


def everything(**fields) -> Scene:
    """Return a small scene with one of each: two balloons, spheres, a string, a ground, net forces."""
    inflating = Inflation(k_normal=[[0.0, 0.0], [0.05, 2.0]])
    balloons = [
        Balloon(mesh=quad_sphere(3), name="ball", position=(0, 2, 0), helium=20.0, inflation=inflating),
        Balloon(mesh=cube(), name="ball", position=(4, 1, 0), color=(0.1, 0.2, 0.3)),
    ]
    spheres = [Sphere(position=(0, 4, 0), radius=0.3), Sphere(position=(1, 5, 0), radius=0.1)]
    apart = {"ground": Ground(height=-0.5), "net_forces": True}
    said = {"description": "one of each", "picture_frame": 4}
    return scene(**{"balloon": balloons, "sphere": spheres, **apart, **said} | fields)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "everything.usdc"
    animate(everything(), path, device="cpu")
    return path


@pytest.fixture
def stage(written: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(written))


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usd"])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_every_validator_passes(tmp_path, suffix: str, up_axis: str):
    assert_valid(animated(everything(up_axis=up_axis, frames=4), tmp_path / f"stage{suffix}"))


def test_the_stage_says_what_it_is_and_measures_its_shape(stage: Usd.Stage):
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES)
    assert stage.GetRootLayer().comment == "one of each"
    assert stage.GetRootLayer().customLayerData["balloonWarp"]["pictureFrame"] == 4
    prim = stage.GetPrimAtPath("/World/ball")
    volume, pressure = prim.GetAttribute("userProperties:volume"), prim.GetAttribute("userProperties:pressure")
    assert volume.Get(0) == pytest.approx(signed_volume(quad_sphere(3)), rel=1e-6)
    assert volume.Get(FRAMES) > 1.01 * volume.Get(0)
    area = prim.GetAttribute("userProperties:area").Get(FRAMES)
    # each particle of this quad sphere is pushed by 100 k_normal A_p / A: together 100 k_normal, its 56 particles
    # having the areas of 54 faces counted a little unevenly
    assert pressure.Get(FRAMES) == pytest.approx(200.0 / area, rel=0.1)


def test_balloons_are_the_frames_of_the_simulation(stage: Usd.Stage):
    paths, meshes = ["/World/ball", "/World/ball_1"], [quad_sphere(3), cube()]
    for path, mesh in zip(paths, meshes, strict=True):
        prim = UsdGeom.Mesh(stage.GetPrimAtPath(path))
        np.testing.assert_array_equal(prim.GetFaceVertexCountsAttr().Get(), mesh.face_vertex_counts)
        np.testing.assert_array_equal(prim.GetFaceVertexIndicesAttr().Get(), mesh.face_vertex_indices)
        assert prim.GetFaceVertexCountsAttr().GetNumTimeSamples() == 0
        assert prim.GetSubdivisionSchemeAttr().Get() == "catmullClark"
        assert prim.GetPointsAttr().GetTimeSamples() == list(range(FRAMES + 1))
    for frame in Simulator(everything(), "cpu").run():
        for number, path in enumerate(paths):
            prim = UsdGeom.Mesh(stage.GetPrimAtPath(path))
            np.testing.assert_array_equal(prim.GetPointsAttr().Get(frame.number), frame.points[number])
    for path in paths:
        assert_velocities_are_those_of_the_points(UsdGeom.Mesh(stage.GetPrimAtPath(path)), 30.0)


def test_extents_hold_at_every_sample(stage: Usd.Stage):
    """Each extent is the one that USD computes from the prim itself: the validators do not check it."""
    checked = 0
    for prim in stage.Traverse():
        boundable = UsdGeom.Boundable(prim)
        if not boundable or prim.IsA(UsdLux.RectLight):
            continue
        still = ("Ground", "Water", "Backdrop", "String_0_Knot", "box")
        animated = not prim.IsA(UsdGeom.Sphere) and prim.GetName() not in still
        times = range(FRAMES + 1) if animated else [Usd.TimeCode.Default()]
        assert not animated or boundable.GetExtentAttr().GetTimeSamples() == list(range(FRAMES + 1))
        for time in times:
            computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode(time))
            np.testing.assert_allclose(boundable.GetExtentAttr().Get(time), computed, atol=1e-6)
            checked += 1
    # balloons, net forces, string and mesh; knot, spheres, ground, backdrop, water, obstacle
    assert checked == 6 * (FRAMES + 1) + 7


def test_spheres_and_net_forces_are_those_of_the_simulation(stage: Usd.Stage):
    frames = list(Simulator(everything(), "cpu").run())
    for frame in frames:
        for number, radius in enumerate((0.3, 0.1)):
            sphere = UsdGeom.Sphere(stage.GetPrimAtPath(f"/World/Spheres/Sphere_{number}"))
            assert sphere.GetRadiusAttr().Get() == radius
            moved = UsdGeom.XformCache(frame.number).GetLocalToWorldTransform(sphere.GetPrim()).ExtractTranslation()
            np.testing.assert_array_equal(moved, frame.sphere_positions[number])
        curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/NetForces/ball"))
        scale = curves.GetPrim().GetAttribute("userProperties:metersPerNewton").Get()
        points = np.array(curves.GetPointsAttr().Get(frame.number))
        assert list(curves.GetCurveVertexCountsAttr().Get()) == [2] * 56
        np.testing.assert_array_equal(points[::2], frame.points[0])
        np.testing.assert_allclose(points[1::2] - points[::2], scale * frame.net_forces[0], atol=1e-5)
    assert np.linalg.norm(frames[-1].net_forces[0], axis=1).max() > 0.1


@pytest.mark.parametrize(
    ("fields", "gravity", "length"),
    [
        # each of 8 corners weighs an eighth: the mean weight is drawn a twentieth long
        ({"mass": 4.0, "inflation": Inflation(k_normal=0.0)}, 9.81, 0.05),
        # each corner is pushed by a sixth of 100 k_normal, its face being a sixth of the area; the mean is an eighth
        ({"inflation": Inflation(k_normal=3.0)}, 0.0, 0.05 * 8 / 6),
    ],
)
def test_a_net_force_as_large_as_the_mean_is_a_twentieth_of_the_size_long(tmp_path, fields, gravity, length):
    balloon = Balloon(mesh=cube(), name="box", scale=2.0, **fields)
    stage = animated(Scene(balloon=[balloon], gravity=gravity, net_forces=True, frames=1), tmp_path / "f.usda")
    points = np.array(UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/NetForces/box")).GetPointsAttr().Get(0))
    lengths = np.linalg.norm(points[1::2] - points[::2], axis=1)
    np.testing.assert_allclose(lengths, 2.0 * length, rtol=1e-4)  # a side of 2 m; float32 ends some 3 m from the origin


@pytest.mark.full
@pytest.mark.parametrize(("name", "height"), [("Ground", -0.5), ("Water", 0.25)])
@pytest.mark.parametrize(("up_axis", "up"), [("Y", 1), ("Z", 2)])
def test_ground_and_water_are_level_and_face_up(tmp_path, up_axis: str, up: int, name: str, height: float):
    water = Water(level=0.25, density=1.0)
    scene = everything(up_axis=up_axis, frames=1, picture_frame=0, water=water)
    stage = animated(scene, tmp_path / "planes.usda")
    prim = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}"))
    corners = np.array(prim.GetPointsAttr().Get())[list(prim.GetFaceVertexIndicesAttr().Get())]
    assert prim.GetOrientationAttr().Get() == "rightHanded"
    np.testing.assert_allclose(corners[:, up], height)
    for corner in range(4):  # each turn is to the left, seen from above
        before, here, after = corners[corner - 1], corners[corner], corners[(corner + 1) % 4]
        normal = np.cross(here - before, after - here)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), np.eye(3)[up], atol=1e-6)


@pytest.mark.full
def test_a_plane_moves_where_its_height_changes(tmp_path):
    path = tmp_path / "tide.usda"
    tide = [Change(time=2 / 30, set={"water.level": 0.75})]
    stage = animated(everything(water=Water(level=0.25, density=1.0), change=tide), path)
    water, ground = (UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}")) for name in ("Water", "Ground"))
    levels = [water.GetPointsAttr().Get(frame)[0][1] for frame in range(FRAMES + 1)]
    assert levels == [0.25, 0.25, 0.25, 0.75, 0.75, 0.75, 0.75]
    assert ground.GetPointsAttr().GetNumTimeSamples() == 0
    for frame in range(FRAMES + 1):
        computed = UsdGeom.Boundable.ComputeExtentFromPlugins(water, Usd.TimeCode(frame))
        np.testing.assert_array_equal(water.GetExtentAttr().Get(frame), np.array(computed))
    reader = read_stage(path)
    assert [reader.heights(frame) for frame in (2, 3)] == [(-0.5, 0.25), (-0.5, 0.75)]


def test_materials_are_bound_and_colored(stage: Usd.Stage):
    gprims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Gprim)]
    assert len(gprims) == 13
    for prim in gprims:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader = material.ComputeSurfaceSource()[0]
        assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
        (display,) = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
        assert shader.GetInput("diffuseColor").Get() == display
    chosen = UsdGeom.Gprim(stage.GetPrimAtPath("/World/ball_1")).GetDisplayColorAttr().Get()[0]
    assert Gf.IsClose(chosen, Gf.Vec3f(0.1, 0.2, 0.3), 1e-6)


def test_blender_reads_the_stage(written: Path):
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(written))
    meshes = {
        each.name.partition(".")[0]: each for each in bpy.data.objects if each.type == "MESH"
    }  # beside net forces
    ball, string = meshes["ball"], meshes["String_0_Mesh"]
    assert [each.active_material.name for each in (ball, string)] == ["ball", "Strings_String_0"]
    assert bpy.data.objects["Camera"].data.lens == pytest.approx(50.0)
    assert "String_0" not in bpy.data.objects  # the curve, which would be gray
    mesh = quad_sphere(3)
    assert [len(polygon.vertices) for polygon in ball.data.polygons] == mesh.face_vertex_counts.tolist()
    bpy.context.scene.frame_set(FRAMES)
    shown = ball.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.array([ball.matrix_world @ vertex.co for vertex in shown.vertices])
    stage = Usd.Stage.Open(str(written))
    expected = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball")).GetPointsAttr().Get(FRAMES))
    expected = expected[:, [0, 2, 1]] * [1, -1, 1]  # Blender's up axis is Z
    np.testing.assert_allclose(points, expected, atol=1e-4)


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


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_camera_has_all_that_moves_in_view(tmp_path, up_axis: str):
    stage = animated(scene(up_axis=up_axis), tmp_path / "out.usdc")
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


@pytest.mark.full
def test_pictures_and_exports_find_their_own_camera_and_backdrop(tmp_path):
    own = animated(scene(frames=2), tmp_path / "out.usda")
    assert read_stage(tmp_path / "out.usda").camera(0, 16 / 9) is None
    UsdGeom.Camera.Define(own, "/World/Mine")
    own.Save()
    assert read_stage(tmp_path / "out.usda").camera(0, 16 / 9) is not None
    staged(tmp_path)
    animate(scene(frames=2), tmp_path / "plain.usdc", device="cpu", lights=False)
    drawn = [read_stage(tmp_path / name) for name in ("out.usdc", "plain.usdc")]
    assert len(drawn[0].meshes) == len(drawn[1].meshes)
    assert "Backdrop" not in {part.name for part in Animation(tmp_path / "out.usdc").parts}


@pytest.mark.full
def test_lights_and_ground_can_be_left_out(tmp_path):
    everything = animated(scene(frames=2), tmp_path / "all.usda")
    few = animated(scene(frames=2), tmp_path / "few.usda", lights=False, ground=False)
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
    output = tmp_path / "out.usdc"
    folder = stop(RESUMED_SCENE, output, crash, device="cpu", ground=False)
    assert not Usd.Stage.Open(str(folder / "frames.usda")).GetPrimAtPath("/World/Ground")
    with pytest.raises(InputError, match="leftOut"):
        animate(RESUMED_SCENE, output, device="cpu", resume=True)
    gone_on(RESUMED_SCENE, output, device="cpu", ground=False)
    assert not Usd.Stage.Open(str(output)).GetPrimAtPath("/World/Ground")


def test_triangles_are_refined_smoothly(tmp_path):
    stage = at_start(Scene(balloon=[Balloon(mesh=tetrahedron())]), tmp_path / "out.usda")
    mesh = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    assert mesh.GetTriangleSubdivisionRuleAttr().Get() == "smooth"


SIDES = [None, Picture(azimuth=200.0, elevation=0.0), Picture(azimuth=-70.0, elevation=50.0, zoom=2.0)]
SOFTBOXES = ("Key", "Rim", "Top")


def staged(tmp_path: Path, name: str = "out.usdc", **fields) -> Usd.Stage:
    return animated(scene(frames=2, **fields), tmp_path / name)


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


@pytest.mark.full
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
    shares = []
    for scale in (1.0, 30.0):
        small = Scene(balloon=[Balloon(mesh=tetrahedron(), scale=scale)])
        stage = at_start(small, tmp_path / f"{scale}.usda")
        bound = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World").GetChildren()[0])
        shares.append([])
        for name in SOFTBOXES:
            prim = stage.GetPrimAtPath(f"/World/Studio/{name}")
            place = UsdGeom.XformCache(0).GetLocalToWorldTransform(prim).ExtractTranslation()
            distance = (place - bound.ComputeCentroid()).GetLength()
            shares[-1].append(UsdLux.LightAPI(prim).GetIntensityAttr().Get() / distance**2)
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_camera_looks_from_where_the_scene_says(up_axis: str, tmp_path):
    stage = staged(tmp_path, up_axis=up_axis, picture=Picture(azimuth=90.0, elevation=30.0))
    direction = UsdGeom.Camera(stage.GetPrimAtPath("/World/Studio/Camera")).GetCamera(0).frustum.ComputeViewDirection()
    expected = np.zeros(3)
    expected[[0, "XYZ".index(up_axis)]] = -np.cos(np.radians(30.0)), -0.5
    assert np.allclose(direction, expected, atol=1e-6)


@pytest.mark.full
def test_the_scene_may_look_nearer(tmp_path):
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


def test_a_stage_of_one_frame_shows_nothing_that_moves(tmp_path: Path):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), "cpu")
    simulator.step()
    with StageWriter(tmp_path / "one.usda", simulator.model) as stage:
        stage.write(simulator.read_frame())
    opened = Usd.Stage.Open(str(tmp_path / "one.usda"))
    velocities = UsdGeom.Mesh(opened.GetPrimAtPath("/World/mesh")).GetVelocitiesAttr()
    assert velocities.GetTimeSamples() == [1.0]
    np.testing.assert_array_equal(velocities.Get(1), np.zeros((8, 3)))


TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
KINDS = {"f4": 5126, "u2": 5123, "u1": 5121}
POINTS = cube().points
TRIANGLES = cube().face_vertex_indices.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].ravel()


class Gltf:
    """A file of cubes from 0 to 1 m, a mesh each."""

    def __init__(self, *nodes: dict[str, Any], **more: Any):
        self._binary = b""
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.tree |= {"nodes": list(nodes), "accessors": [], "bufferViews": [], **more}
        self.points = self.array(POINTS, "f4")
        self.indices = self.array(TRIANGLES[:, None], "u2")
        self.tree["meshes"] = [self.mesh(name="Cube")]

    def mesh(self, **more: Any) -> dict[str, Any]:
        return {"primitives": [{"attributes": {"POSITION": self.points}, "indices": self.indices}], **more}

    def array(self, rows: Any, kind: str, **more: Any) -> int:
        """Add an accessor."""
        data = np.atleast_2d(np.asarray(rows)).astype(f"<{kind}")
        accessor = {"bufferView": self.view(data), "componentType": KINDS[kind], "count": len(data)}
        self.tree["accessors"].append(accessor | {"type": TYPES[data.shape[1]], **more})
        return len(self.tree["accessors"]) - 1

    def view(self, data: NDArray[Any]) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self._binary), "byteLength": data.nbytes})
        self._binary += data.tobytes()
        return len(self.tree["bufferViews"]) - 1

    def read(self, folder: Path, prim: str | None = None) -> PolygonMesh:
        uri = f"data:application/octet-stream;base64,{base64.b64encode(self._binary).decode()}"
        self.tree["buffers"] = [{"byteLength": len(self._binary), "uri": uri}]
        (folder / "mesh.gltf").write_text(json.dumps(self.tree))
        return load_mesh(folder / "mesh.gltf", prim)


def box(mesh: PolygonMesh) -> list[list[float]]:
    """Return the lower and the upper corner of a mesh."""
    return [mesh.points.min(axis=0).round(6).tolist(), mesh.points.max(axis=0).round(6).tolist()]


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "size"),
    [
        pytest.param(None, None, 1.0, id="no weights"),
        pytest.param([1.0], None, 2.0, id="the mesh's"),
        pytest.param([1.0], [0.5], 1.5, id="the node's before the mesh's"),
        pytest.param([0.5], [0.0], 1.0, id="the node's are 0"),
    ],
)
@pytest.mark.parametrize("sparse", [False, True])
def test_morph_weights_are_applied(tmp_path: Path, of_mesh: Any, of_node: Any, size: float, sparse: bool):
    file = Gltf({"mesh": 0, **({"weights": of_node} if of_node else {})})
    target = file.array(POINTS, "f4")
    if sparse:  # as Blender writes a shape key that moves only some points
        moved = np.flatnonzero(POINTS.any(axis=1))
        indices, values = file.view(moved.astype("<u2")), file.view(POINTS[moved].astype("<f4"))
        accessor = file.tree["accessors"][target]
        del accessor["bufferView"]
        where = {"bufferView": indices, "componentType": 5123}
        accessor["sparse"] = {"count": len(moved), "indices": where, "values": {"bufferView": values}}
    [primitive] = file.tree["meshes"][0]["primitives"]
    primitive["targets"] = [{"POSITION": target}]
    if of_mesh:
        file.tree["meshes"][0]["weights"] = of_mesh
    mesh = file.read(tmp_path)
    assert box(mesh) == [[0.0] * 3, [size] * 3]
    assert mesh.warnings == ()


def skinned(*, weights: Any = ((1.0, 0.0, 0.0, 0.0),) * 8, bound: bool = True) -> Gltf:
    """Return a cube whose node is elsewhere, and two joints, of which the second stands 3 m above."""
    file = Gltf(
        {"children": [1, 2]},
        {"mesh": 0, "skin": 0, "translation": [100.0, 0.0, 0.0]},
        {"translation": [0.0, 1.0, 0.0], "children": [3]},
        {"translation": [0.0, 2.0, 0.0]},
    )
    file.tree["skins"] = [{"joints": [2, 3]}]
    if bound:
        inverse = np.tile(np.eye(4), (2, 1, 1))
        inverse[:, 3, 1] = -1.0  # columns come first
        file.tree["skins"][0]["inverseBindMatrices"] = file.array(inverse.reshape(2, 16), "f4")
    [primitive] = file.tree["meshes"][0]["primitives"]
    primitive["attributes"]["JOINTS_0"] = file.array([[0, 1, 0, 0]] * 8, "u1")
    primitive["attributes"]["WEIGHTS_0"] = file.array(255.0 * np.array(weights), "u1", normalized=True)
    return file


def test_skins_go_where_their_joints_are(tmp_path: Path):
    assert box(skinned().read(tmp_path)) == [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    assert box(skinned(bound=False).read(tmp_path)) == [[0.0, 1.0, 0.0], [1.0, 2.0, 1.0]]
    upper = [(0.0, 1.0, 0.0, 0.0) if y else (1.0, 0.0, 0.0, 0.0) for _, y, _ in POINTS]
    assert box(skinned(weights=upper).read(tmp_path)) == [[0.0, 0.0, 0.0], [1.0, 3.0, 1.0]]


def test_a_skin_that_cannot_be_read_is_named(tmp_path: Path):
    file = skinned()
    file.tree["skins"][0]["joints"] = [2, 77]
    file.tree["nodes"][1]["name"] = "Body"
    (sentence,) = file.read(tmp_path).warnings
    assert sentence.startswith("The skin of Body cannot be read")


def test_instances_that_are_used_but_not_required_are_placed(tmp_path: Path):
    extension = "EXT_mesh_gpu_instancing"
    node = {"mesh": 0, "translation": [10.0, 0.0, 0.0], "extensions": {extension: {"attributes": {}}}}
    file = Gltf(node, extensionsUsed=[extension])
    attributes = node["extensions"][extension]["attributes"]
    attributes["TRANSLATION"] = file.array([(0, 0, 0), (5, 0, 0)], "f4")
    attributes["SCALE"] = file.array([(1, 1, 1), (1, 2, 1)], "f4")
    mesh = file.read(tmp_path)
    assert (mesh.vertex_count, mesh.warnings) == (16, ())
    assert box(mesh) == [[10.0, 0.0, 0.0], [16.0, 2.0, 1.0]]
    attributes["TRANSLATION"] = 77
    (sentence,) = file.read(tmp_path).warnings
    assert "instances of node 0 cannot be read (EXT_mesh_gpu_instancing)" in sentence


@pytest.mark.parametrize(
    ("extension", "named"), [("ACME_points", True), ("KHR_materials_ior", False), ("EXT_meshopt_compression", False)]
)
def test_an_extension_that_may_change_the_shape_is_named(tmp_path: Path, extension: str, named: bool):
    warnings = Gltf({"mesh": 0}, extensionsUsed=[extension]).read(tmp_path).warnings
    assert warnings == ((f"Uses the extension {extension}, which is passed over.",) if named else ())


ASIDE = {"mesh": 0, "translation": [2.0, 0.0, 0.0]}
HIDDEN = {"extensions": {"KHR_node_visibility": {"visible": False}}}


@pytest.mark.parametrize(
    ("first", "second", "end"),
    [
        pytest.param({"camera": 0, "translation": [5.0, 0.0, 0.0]}, ASIDE, 8.0, id="what is below a camera"),
        pytest.param({}, ASIDE | HIDDEN, 1.0, id="what is not visible is left out"),
    ],
)
def test_each_is_where_its_nodes_say(tmp_path: Path, first: dict[str, Any], second: dict[str, Any], end: float):
    file = Gltf({"mesh": 0, "children": [1], **first}, second)
    file.tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    assert box(file.read(tmp_path)) == [first.get("translation", [0.0] * 3), [end, 1.0, 1.0]]


def test_a_chain_of_nodes_takes_no_longer_than_a_list(tmp_path: Path):
    nodes = [{"children": [number + 1], "translation": [1.0, 0.0, 0.0]} for number in range(20_000)]
    assert box(Gltf(*nodes, {"mesh": 0}).read(tmp_path))[0] == [20_000.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("deep.gltf", '{"asset":{"version":"2.0"},"x":' + "[" * 100_000, r"cannot be read as GLTF \(it is nested too"),
        ("digits.gltf", '{"asset":' + "9" * 5_000 + "}", r"cannot be read as GLTF \(Exceeds the limit"),
        ("circle.gltf", '{"nodes":[{"children":[0]}],"scenes":[{"nodes":[7]}]}', r"it has no list index"),
        ("pipe.gltf", '{"buffers":[{"byteLength":36,"uri":"pipe.bin"}]}', r"pipe\.bin: is not a regular file"),
        ("gone.gltf", '{"buffers":[{"byteLength":36,"uri":"gone.bin"}]}', r"gone\.bin: cannot be read \(No such"),
    ],
)
def test_hostile_files_get_a_sentence(tmp_path: Path, name: str, text: str, said: str):
    os.mkfifo(tmp_path / "pipe.bin")
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        load_mesh(tmp_path / name)


@pytest.mark.parametrize("suffix", [".glb", ".stl", ".ply", ".obj", ".usda", ".usdc"])
def test_a_pipe_or_a_device_is_refused_unread(tmp_path: Path, suffix: str):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(InputError, match=r"is not a regular file"):
            load_mesh(tmp_path / f"{name}{suffix}")


def objects(folder: Path, kind: str) -> Path:
    """Write a table of a top and a leg, beside a balloon."""
    path = folder / f"mesh.{kind}"
    if kind == "obj":
        write_obj(path, cube())
        lines = [line for line in path.read_text().splitlines() if line[0] != "#"]
        path.write_text("\n".join([*lines[:8], "o Top", *lines[8:10], "o Leg", lines[10], "o Balloon", *lines[11:]]))
        return path
    file = Gltf({"name": "Table", "children": [1, 2]}, {"name": "Top", "mesh": 0}, {"name": "Leg", "mesh": 0})
    file.tree["nodes"].append({"name": "Balloon", "mesh": 0, "translation": [9.0, 0.0, 0.0]})
    file.tree["scenes"][0]["nodes"] = [0, 3]
    file.read(folder)
    return folder / "mesh.gltf"


@pytest.mark.parametrize("kind", ["obj", "gltf"])
def test_an_object_is_taken_by_its_name(tmp_path: Path, kind: str):
    path = objects(tmp_path, kind)
    balloon = load_mesh(path, "Balloon")
    whole = 3 if kind == "obj" else 12
    assert (balloon.name, balloon.face_count, balloon.warnings) == ("Balloon", whole, ())
    assert set(balloon.face_vertex_indices.tolist()) == set(range(balloon.vertex_count))
    assert load_mesh(path, ["Top", "/Leg"]).face_count == (3 if kind == "obj" else 24)
    if kind == "gltf":
        assert load_mesh(path, "/Table/Leg").face_count == 12
        assert load_mesh(path, "Table").face_count == 24
    with pytest.raises(InputError, match=r"has no object Baloon \(it has .*Top.*\); did you mean Balloon"):
        load_mesh(path, "Baloon")
