"""Stage as it is read back: by the validators, by its attributes, and by Blender where that is installed."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, quad_sphere
from motion import assert_valid, assert_velocities_are_those_of_the_points
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade
from render_stages import read_stage

from balloon_warp import Scene, Simulator, animate
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.outputs.usd.strand import points_around
from balloon_warp.outputs.usd.string_curve import string_curve
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Sphere, String, Water

FRAMES = 6


def everything(**fields) -> Scene:
    """Return a small scene with one of each: two balloons (one open), spheres, a string, a ground, net forces."""
    inflating = Inflation(k_normal=[[0.0, 0.0], [0.05, 2.0]])
    balloons = [
        Balloon(mesh=quad_sphere(3), name="ball", position=(0, 2, 0), helium=20.0, inflation=inflating),
        Balloon(mesh=grid(3, 2), name="ball", position=(4, 1, 0), color=(0.1, 0.2, 0.3)),
    ]
    fields = {
        "description": "one of each",
        "balloon": balloons,
        "sphere": [Sphere(position=(0, 4, 0), radius=0.3), Sphere(position=(1, 5, 0), radius=0.1)],
        "string": [String(anchor=(0, 0, 0), length=2.0)],
        "ground": Ground(height=-0.5),
        "net_forces": True,
        "frames": FRAMES,
        "frames_per_second": 30,
        "picture_frame": 4,
    } | fields
    return Scene(**fields)


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
    path = tmp_path / f"stage{suffix}"
    animate(everything(up_axis=up_axis, frames=4), path, device="cpu")
    assert_valid(Usd.Stage.Open(str(path)))


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
    paths, meshes = ["/World/ball", "/World/ball_1"], [quad_sphere(3), grid(3, 2)]
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
    """Each extent is what USD computes from the prim itself: the validators do not check it."""
    checked = 0
    for prim in stage.Traverse():
        boundable = UsdGeom.Boundable(prim)
        if not boundable or prim.IsA(UsdLux.RectLight):
            continue
        animated = not prim.IsA(UsdGeom.Sphere) and prim.GetName() not in ("Ground", "Backdrop", "String_0_Knot")
        times = range(FRAMES + 1) if animated else [Usd.TimeCode.Default()]
        assert not animated or boundable.GetExtentAttr().GetTimeSamples() == list(range(FRAMES + 1))
        for time in times:
            computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode(time))
            np.testing.assert_allclose(boundable.GetExtentAttr().Get(time), computed, atol=1e-6)
            checked += 1
    assert checked == 6 * (FRAMES + 1) + 5  # balloons, net forces, string and mesh; knot, spheres, ground, backdrop


def test_spheres_and_net_forces_are_those_of_the_simulation(stage: Usd.Stage):
    simulator = Simulator(everything(), "cpu")
    for frame in simulator.run():
        for number, radius in enumerate((0.3, 0.1)):
            sphere = UsdGeom.Sphere(stage.GetPrimAtPath(f"/World/Spheres/Sphere_{number}"))
            assert sphere.GetRadiusAttr().Get() == radius
            moved = UsdGeom.XformCache(frame.number).GetLocalToWorldTransform(sphere.GetPrim()).ExtractTranslation()
            np.testing.assert_array_equal(moved, frame.sphere_positions[number])
    frames = list(Simulator(everything(), "cpu").run())
    for frame in frames:
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
    animate(Scene(balloon=[balloon], gravity=gravity, net_forces=True, frames=1), tmp_path / "f.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "f.usda"))
    points = np.array(UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/NetForces/box")).GetPointsAttr().Get(0))
    lengths = np.linalg.norm(points[1::2] - points[::2], axis=1)
    np.testing.assert_allclose(lengths, 2.0 * length, rtol=1e-4)  # a side of 2 m; float32 ends some 3 m from the origin


@pytest.mark.parametrize(("name", "height"), [("Ground", -0.5), ("Water", 0.25)])
@pytest.mark.parametrize(("up_axis", "up"), [("Y", 1), ("Z", 2)])
def test_ground_and_water_are_level_and_face_up(tmp_path, up_axis: str, up: int, name: str, height: float):
    path = tmp_path / "planes.usda"
    water = Water(level=0.25, density=1.0)
    animate(everything(up_axis=up_axis, frames=1, picture_frame=0, water=water), path, device="cpu")
    stage = Usd.Stage.Open(str(path))
    prim = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}"))
    corners = np.array(prim.GetPointsAttr().Get())[list(prim.GetFaceVertexIndicesAttr().Get())]
    assert prim.GetOrientationAttr().Get() == "rightHanded"
    np.testing.assert_allclose(corners[:, up], height)
    for corner in range(4):  # each turn is to the left, seen from above
        before, here, after = corners[corner - 1], corners[corner], corners[(corner + 1) % 4]
        normal = np.cross(here - before, after - here)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), np.eye(3)[up], atol=1e-6)


def test_a_plane_moves_where_its_height_changes(tmp_path):
    path = tmp_path / "tide.usda"
    tide = [Change(time=2 / 30, set={"water.level": 0.75})]
    animate(everything(water=Water(level=0.25, density=1.0), change=tide), path, device="cpu")
    stage = Usd.Stage.Open(str(path))
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
    assert len(gprims) == 11
    for prim in gprims:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader = material.ComputeSurfaceSource()[0]
        assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
        (display,) = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
        assert shader.GetInput("diffuseColor").Get() == display
    chosen = UsdGeom.Gprim(stage.GetPrimAtPath("/World/ball_1")).GetDisplayColorAttr().Get()[0]
    assert Gf.IsClose(chosen, Gf.Vec3f(0.1, 0.2, 0.3), 1e-6)


def test_odd_names_become_prims_of_their_own(tmp_path):
    names = ["a cow!", "a cow?", "Ground", "7", ""]
    balloons = [Balloon(mesh=cube(), name=name, position=(3.0 * n, 0, 0)) for n, name in enumerate(names)]
    animate(Scene(balloon=balloons, frames=1, ground=Ground()), tmp_path / "odd.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "odd.usda"))
    found = [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Mesh)]
    assert len(set(found)) == 6
    assert all(Tf.IsValidIdentifier(name) for name in found)


def test_blender_reads_the_stage(written: Path):
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(written))
    ball, string = bpy.data.objects["ball"], bpy.data.objects["String_0_Mesh"]
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


def test_strings_go_from_anchor_to_particle(stage: Usd.Stage, tmp_path):
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Strings/String_0"))
    ball = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    held = int(quad_sphere(3).points[:, 1].argmin())
    assert curve.GetTypeAttr().Get() == "linear"
    for time in range(FRAMES + 1):
        points = np.array(curve.GetPointsAttr().Get(time))
        np.testing.assert_array_equal(points[0], 0.0)
        np.testing.assert_allclose(points[-1], ball.GetPointsAttr().Get(time)[held], atol=1e-6)
    balloons = [Balloon(mesh=cube(), name="first"), Balloon(mesh=quad_sphere(3), name="second", position=(5, 3, 0))]
    scene = Scene(balloon=balloons, string=[String(anchor=(5, 0, 0), balloon=1)], frames=3)
    animate(scene, tmp_path / "two.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "two.usda"))
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Strings/String_0"))
    second = UsdGeom.Mesh(stage.GetPrimAtPath("/World/second"))
    held = int(quad_sphere(3).points[:, 1].argmin())
    for time in range(4):
        end = curve.GetPointsAttr().Get(time)[-1]
        np.testing.assert_allclose(end, second.GetPointsAttr().Get(time)[held], atol=1e-6)


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


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_points_around_a_curve_lie_across_it(bend: float):
    along = np.linspace(0.0, 1.0, 17)
    curve = np.stack([along, bend * along * (1.0 - along), 0.0 * along], axis=1).astype(np.float32)
    around = points_around(curve, 0.01).reshape(17, -1, 3) - curve[:, None]
    np.testing.assert_allclose(np.linalg.norm(around, axis=2), 0.01, atol=1e-6)
    direction = np.gradient(curve, axis=0)
    # the curve's places have 1e-7, the radius is 1e-2: a direction so has 1e-5
    assert np.abs(np.einsum("pij,pj->pi", around, direction / np.linalg.norm(direction, axis=1)[:, None])).max() < 1e-6
    assert np.isfinite(points_around(np.zeros((17, 3), np.float32), 0.01)).all()
