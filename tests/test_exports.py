"""Stages as files of other kinds, read back by programs that are not ours; images on balloons; names in any script."""

import itertools
import re
import subprocess
import sys
import unicodedata
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from unittest.mock import Mock

import h5py
import meshio
import numpy as np
import pytest
import trimesh
import xarray
from exported import BALL, FRAMES, RATE, STRING, animated, assert_valid, at_start, points, scene, turned
from meshes import cube
from painted import Glb, show_image
from PIL import Image
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from render_stages import add_camera, add_mesh, new_stage
from scipy.spatial.distance import cdist
from test_resume import FRAMES as RESUMED_FRAMES
from test_resume import SCENE as RESUMED_SCENE
from test_resume import press_ctrl_c, stop

from balloon_warp import Body, InputError, MissingExtraError, PolygonMesh, Scene, animate, export_stage
from balloon_warp.scene import Balloon, Ground, Obstacle, load_scene
from balloon_warp.studio import export, parts
from balloon_warp.studio.render import render_stage, stage_reader
from balloon_warp.system import files as arrays
from balloon_warp.usd.material import identifier
from balloon_warp.usd.solids import AROUND, PROFILE, tube_points, tube_topology

never = Mock(side_effect=AssertionError("is not to be called"))
READ_ALEMBIC = """
import sys
import bpy
import numpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.alembic_import(filepath=sys.argv[1], as_background_job=False)
bpy.context.scene.frame_set(int(sys.argv[3]))
ball = bpy.data.objects["ball"].evaluated_get(bpy.context.evaluated_depsgraph_get())
numpy.save(sys.argv[2], [ball.matrix_world @ vertex.co for vertex in ball.data.vertices])
"""
"""in a process of its own, as Blender writes it"""


@pytest.fixture(scope="module", params=["Y", "Z"])
def written(request, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("exports") / "stage.usdc"
    animate(scene(up_axis=request.param), path, device="cpu")
    return path


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_a_file_for_each_frame_in_meters_with_y_up(written: Path, tmp_path, suffix: str):
    export_stage(written, tmp_path / f"out.####{suffix}")
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"out.{frame:04d}{suffix}" for frame in range(FRAMES + 1)]
    for frame, name in enumerate(names):
        found = trimesh.load(tmp_path / name, process=False, group_material=False)
        here = found.to_geometry() if isinstance(found, trimesh.Scene) else found
        for prim in ("ball", "box"):
            assert cdist(here.vertices, points(written, f"/World/{prim}", frame)).min(axis=0).max() < 1e-6
        assert here.vertices[:, 1].max() < 6.0  # no ground of many meters
        spheres = (1 + (frame >= 2)) * 6 * 12 * 12  # cubes, blown up; the second one appears in the third frame
        string, knot = 6 * 16, AROUND * (len(PROFILE) - 2) + AROUND // 2
        obstacle = 6 * 9 * 9  # its edges are round
        assert len(here.faces) == 2 * (54 + 6 + obstacle + string + knot + spheres)


def test_a_ply_has_normals_and_colors(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.##.ply")
    found = trimesh.load(tmp_path / "out.00.ply", process=False)
    ball, box = points(written, "/World/ball", 0), points(written, "/World/box", 0)
    of_ball, of_box = (cdist(found.vertices, each).min(axis=1) < 1e-5 for each in (ball, box))
    assert of_ball.sum() == len(ball)
    outward = found.vertices[of_ball] - ball.mean(axis=0)
    assert ((found.vertex_normals[of_ball] * outward).sum(axis=1) > 0.9 * np.linalg.norm(outward, axis=1)).all()
    linear = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(found.visual.vertex_colors[of_box][0, :3], 255 * linear ** (1 / 2.2), atol=4.0)


def test_what_is_left_of_a_longer_sequence_is_named(written: Path, tmp_path):
    (tmp_path / "out.0099.ply").write_text("old")
    told: list[str] = []
    export_stage(written, tmp_path / "out.####.ply", on_note=told.append)
    assert told == ["out.0099.ply: from an earlier sequence of that name; kept"]
    assert (tmp_path / "out.0099.ply").read_text() == "old"


def test_a_package_passes_every_validator(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.usdz")
    assert_valid(Usd.Stage.Open(str(tmp_path / "out.usdz")))
    _, assets, unresolved = UsdUtils.ComputeAllDependencies(str(tmp_path / "out.usdz"))
    assert (len(assets), len(unresolved)) == (0, 0)
    for frame in range(FRAMES + 1):
        packed, original = (points(file, "/World/ball", frame) for file in (tmp_path / "out.usdz", written))
        np.testing.assert_array_equal(packed, original)


@pytest.mark.parametrize("name", ["out.glb", "out.h5", "out.pvd", "out.####.obj", "out.usda", "out.usdz"])
def test_no_kind_of_file_tells_where_it_was_made(name: str, written: Path, tmp_path):
    """USD would name the folder in a comment."""
    export_stage(written, tmp_path / name)
    said = [path.read_bytes() for path in tmp_path.iterdir()]
    if name == "out.usdz":
        stage = Usd.Stage.Open(str(tmp_path / name))
        said.append(stage.GetRootLayer().ExportToString().encode())
    for folder in (tmp_path, written.parent):
        assert not any(str(folder).encode() in content for content in said)


@pytest.mark.full
@pytest.mark.parametrize("kind", ["glb", "usdz", "usda"])
def test_run_writes_what_convert_makes_of_its_stage(tmp_path, kind: str):
    small, names = scene(frames=2), [f"out.{kind}", "points.h5"]
    animate(small, tmp_path / "stage.usdc", device="cpu")
    (folder := tmp_path / "run").mkdir()
    output, points_file, picture = (folder / name for name in (*names, "out.png"))
    summary = animate(small, output, picture=picture, save_points=points_file, device="cpu")
    assert (summary.output, summary.points) == (str(output), str(points_file))
    assert {path.name for path in folder.iterdir()} == {*names, "out.png"}
    for name in names:
        export_stage(tmp_path / "stage.usdc", tmp_path / name)
        if name in ("out.glb", "points.h5"):  # the others say which command made them
            assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.full
def test_a_run_that_is_stopped_goes_on_to_the_same_glb(tmp_path):
    whole, output = tmp_path / "whole.glb", tmp_path / "out.glb"
    animate(RESUMED_SCENE, whole, device="cpu")
    output.write_bytes(b"good")
    folder = stop(RESUMED_SCENE, output, press_ctrl_c, device="cpu")
    assert folder.name == "out.glb.partial"
    assert output.read_bytes() == b"good"
    assert 0 < animate(RESUMED_SCENE, output, device="cpu", resume=True).begin < RESUMED_FRAMES
    assert output.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.glb", "whole.glb"]


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("out.fbx", r"cannot write \.fbx; expected \.usdc, .*\.glb, .*\.abc"),
        ("out", r"out: cannot write a file without a suffix; expected"),
        ("out.obj", r"is one file for all frames; expected #### in the name for the frame .*, such as out\.####\.obj"),
        ("missing/out.glb", "the folder .* does not exist"),
        ("stage.usdc", "is the input stage"),
    ],
)
def test_mistakes_are_told_before_any_work(written: Path, tmp_path, name: str, complaint: str):
    (tmp_path / "stage.usdc").write_bytes(written.read_bytes())
    with pytest.raises(InputError, match=complaint):
        export_stage(tmp_path / "stage.usdc", tmp_path / name)
    if name != "stage.usdc":
        with pytest.raises(InputError, match=complaint):
            animate(scene(), tmp_path / name, device="cpu", on_frame=never)


def test_an_empty_stage_has_nothing_to_export(tmp_path):
    (tmp_path / "empty.usda").write_text("#usda 1.0\n")
    with pytest.raises(InputError, match=r"empty\.usda: has no mesh, solid shape or linear curves to export"):
        export_stage(tmp_path / "empty.usda", tmp_path / "out.glb")


def test_alembic_needs_blenders_module(written: Path, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"an \.abc needs Blender's Python module: pip install bpy"):
        export_stage(written, tmp_path / "out.abc")


def test_blender_writes_alembic_and_reads_it_back(written: Path, tmp_path):
    pytest.importorskip("bpy")
    export_stage(written, tmp_path / "out.abc")
    assert (tmp_path / "out.abc").read_bytes()[:5] == b"Ogawa"
    command = [sys.executable, "-c", READ_ALEMBIC, str(tmp_path / "out.abc"), str(tmp_path / "ball.npy"), str(FRAMES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    expected = points(written, "/World/ball", FRAMES)[:, [0, 2, 1]] * [1, -1, 1]
    np.testing.assert_allclose(np.load(tmp_path / "ball.npy"), expected, atol=1e-5)


def test_tubes_follow_their_curves():
    turn = np.linspace(0.0, np.pi, 200)
    curve = np.stack([np.cos(turn), np.sin(turn), np.zeros(200)], axis=1)
    lengths = np.array([200, 2], np.int32)
    centers = np.concatenate([curve, [[5.0, 0, 0], [5.0, 1.0, 0]]])
    places = tube_points(centers, lengths, 0.1)
    counts, indices = tube_topology(lengths)
    assert len(counts) == 6 * (199 + 1)
    distance = np.linalg.norm(places.reshape(-1, 6, 3) - centers[:, None], axis=-1)
    np.testing.assert_allclose(distance, 0.1, atol=1e-9)
    a, b, _, d = places[indices.reshape(-1, 4)[:6]].swapaxes(0, 1)
    assert ((a - centers[0]) * np.cross(b - a, d - a)).sum(axis=1).min() > 0.0  # outward
    assert PolygonMesh(places, counts, indices).face_count == len(counts)


@pytest.mark.full
def test_morph_targets_are_the_frames(written: Path, tmp_path):
    """The weights of each keyframe give that frame's points; the root turns them so that Y is up."""
    export_stage(written, tmp_path / "out.glb")
    file = Glb(tmp_path / "out.glb")
    root = file.nodes["World"]
    stage = Usd.Stage.Open(str(written))
    half = np.sqrt(0.5)
    assert root.get("rotation") == (None if (turned(stage) == np.eye(3)).all() else pytest.approx([-half, 0, 0, half]))
    for name in ("ball", "box"):
        shapes = file.shapes(name)
        times, _, _ = file.channels(name)["weights"]
        np.testing.assert_allclose(times, np.arange(FRAMES + 1) / RATE, rtol=1e-6)
        assert len(shapes) == FRAMES + 1
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}"))
        for frame, shape in enumerate(shapes):
            expected = np.array(mesh.GetPointsAttr().Get(frame), np.float64)
            distance = np.linalg.norm(shape[:, None] - expected, axis=-1)
            assert distance.min(axis=1).max() < 1e-6  # a difference of two float32 near 3 is rounded by 1e-7
            assert distance.min(axis=0).max() < 1e-6  # all are there: texture coordinates split vertices
        normals = file.shapes(name, "NORMAL")
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
        outward = (normals * (shapes - shapes.mean(axis=1, keepdims=True))).sum(axis=-1)
        assert (outward > 0.0).all()


def test_what_is_rigid_moves_as_a_node(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.glb")
    file, stage = Glb(tmp_path / "out.glb"), Usd.Stage.Open(str(written))
    rigid = {"Sphere_0": "/World/Spheres/Sphere_0", "String_0_Knot": "/World/Strings/String_0_Knot"}
    for name, path in (rigid | {"Obstacles_box": "/World/Obstacles/box"}).items():
        prim = stage.GetPrimAtPath(path)
        assert "targets" not in file.primitive(name)
        moves = file.channels(name)
        matrices = [np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)) for frame in range(FRAMES + 1)]
        np.testing.assert_allclose(moves["translation"][1], [matrix[3, :3] for matrix in matrices], atol=1e-6)
        if name == "Obstacles_box":
            x, y, z, w = moves["rotation"][1].T
            first = np.stack([1 - 2 * (y**2 + z**2), 2 * (x * y + z * w), 2 * (x * z - y * w)], axis=1)
            expected = [matrix[0, :3] / np.linalg.norm(matrix[0, :3]) for matrix in matrices]
            np.testing.assert_allclose(first, expected, atol=1e-6)
            assert np.abs(first[-1] - first[0]).max() > 0.9
    _, sizes, how = file.channels("Sphere_1")["scale"]
    assert how == "STEP"
    np.testing.assert_array_equal(sizes[:, 0], [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0])


def test_a_glb_is_bounded_and_says_so(written: Path, tmp_path, monkeypatch):
    told: list[str] = []
    export_stage(written, tmp_path / "all.glb", on_note=told.append)
    assert "7 frames of" in told[0]
    assert "MB" in told[0]
    assert "room" not in told[0]
    monkeypatch.setattr(parts, "MOST_TARGETS", 3)
    export_stage(written, tmp_path / "few.glb", on_note=told.append)
    assert "every 2nd of 7 frames, to fit into 3 morph targets" in told[1]
    few = Glb(tmp_path / "few.glb")
    assert len(few.primitive("box")["targets"]) == 3
    np.testing.assert_allclose(few.shapes("box"), Glb(tmp_path / "all.glb").shapes("box")[::2], atol=1e-6)
    monkeypatch.setattr(parts, "MOST_BYTES", 24 * 500)
    with pytest.raises(InputError, match="moving vertices, too many for a"):
        export_stage(written, tmp_path / "none.glb")
    assert not (tmp_path / "none.glb").exists()


PAGE = (Path(__file__).parent.parent / "docs" / "OUTPUTS.md").read_text(encoding="utf-8")


@pytest.mark.full
def test_h5py_reads_all_that_moved(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.h5")
    stage = Usd.Stage.Open(str(written))
    with h5py.File(tmp_path / "out.h5") as file:
        assert set(file) == {"ball", "box", "Sphere_0", "Sphere_1", *STRING, "Obstacles_box"}
        assert file.attrs["up_axis"] == UsdGeom.GetStageUpAxis(stage)
        ball, prim = file["ball"], UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
        assert ball["mesh_pos"].shape == (FRAMES + 1, len(BALL.points), 3)
        np.testing.assert_allclose(ball["time"], np.arange(FRAMES + 1) / RATE)
        for frame in range(FRAMES + 1):
            np.testing.assert_array_equal(ball["mesh_pos"][frame], prim.GetPointsAttr().Get(frame))
            np.testing.assert_array_equal(ball["velocity"][frame], prim.GetVelocitiesAttr().Get(frame))
            assert ball["volume"][frame] == prim.GetPrim().GetAttribute("userProperties:volume").Get(frame)
        np.testing.assert_array_equal(ball["face_vertex_indices"], BALL.face_vertex_indices)
        sphere = UsdGeom.XformCache(3.0).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Spheres/Sphere_0"))
        np.testing.assert_allclose(file["Sphere_0"]["pose"][3], np.array(sphere), rtol=1e-6)


@pytest.fixture(scope="module")
def page_file(tmp_path_factory) -> Path:
    """Write points.h5 of a balloon called "squirrel", as in docs/OUTPUTS.md."""
    folder = tmp_path_factory.mktemp("page")
    animate(scene(balloon=[Balloon(mesh=BALL, name="squirrel")]), folder / "out.usdc", device="cpu")
    export_stage(folder / "out.usdc", folder / "points.h5")
    assert h5py.is_hdf5(folder / "points.h5")
    return folder / "points.h5"


@pytest.mark.full
def test_a_file_has_what_its_page_says(page_file: Path):
    said = {}
    for names, shapes in re.findall(r"^\|( `\w+`.*?)\|( \(.*?)\|", PAGE, re.MULTILINE):
        found = zip(re.findall(r"`(\w+)`", names), itertools.cycle(re.findall(r"\(([^)]*)\)", shapes)))
        said |= {name: [size.strip() for size in shape.split(",") if size.strip()] for name, shape in found}
    assert len(said) >= 10
    sizes: dict[str, int] = {"3": 3, "2": 2, "T": FRAMES + 1, "N": len(BALL.points), "faces": BALL.face_count}
    with h5py.File(page_file) as file:
        assert set(said) == set(file["squirrel"])
        for name, shape in said.items():
            there = file["squirrel"][name].shape
            assert [sizes.setdefault(size, n) for size, n in zip(shape, there, strict=True)] == list(there), name
        for attribute in ("up_axis", "meters_per_unit", "frames_per_second"):
            assert attribute in PAGE
            assert attribute in file.attrs


@pytest.mark.full
def test_xarray_takes_it_and_makes_a_zarr_store_as_its_page_says(page_file: Path, monkeypatch):
    monkeypatch.chdir(page_file.parent)
    (lines,) = re.findall(r"^```text\n(import h5py, xarray.*?)```", PAGE, re.MULTILINE | re.DOTALL)
    (store,) = re.findall(r"^(found\.to_zarr.*)$", PAGE, re.MULTILINE)
    said: dict[str, xarray.Dataset] = {}
    exec(lines + store, said)
    with xarray.open_zarr("squirrel.zarr") as kept:
        for found in (said["found"], kept):
            assert found["mesh_pos"].dims == found["velocity"].dims == ("time", "particle", "axis")
            assert found["edges"].dims == ("edge", "end")
            assert float(found["volume"].sel(time=3.0 / RATE, method="nearest")) > 0.0


def test_a_grid_for_each_frame_and_a_list_of_their_times(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.pvd")
    listed = list(ElementTree.parse(tmp_path / "out.pvd").getroot().iter("DataSet"))
    assert [entry.get("file") for entry in listed] == [f"out.{frame:04d}.vtu" for frame in range(FRAMES + 1)]
    np.testing.assert_allclose([float(entry.get("timestep", -1)) for entry in listed], np.arange(FRAMES + 1) / RATE)
    stage, count, fastest = Usd.Stage.Open(str(written)), BALL.face_count, 0.0
    for frame, entry in enumerate(listed):
        grid = meshio.read(tmp_path / str(entry.get("file")))
        ball = points(written, "/World/ball", frame)
        np.testing.assert_allclose(grid.points[: len(BALL.points)], ball, atol=1e-6)
        [quads] = grid.cells
        assert quads.type == "quad"
        np.testing.assert_array_equal(quads.data[:count], BALL.face_vertex_indices.reshape(-1, 4))
        assert quads.data.max() == len(grid.points) - 1
        pressure, part = (grid.cell_data[name][0] for name in ("pressure", "part"))
        told = stage.GetPrimAtPath("/World/ball").GetAttribute("userProperties:pressure").Get(frame)
        np.testing.assert_allclose(pressure[:count], told, rtol=1e-6)
        assert len(np.unique(part)) == 6 + (frame >= 2)
        fastest = max(fastest, float(np.abs(grid.point_data["velocity"]).max()))
    assert fastest > 0.0


def test_mistakes_of_points_are_told_before_any_work(written: Path, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"points\.npy: cannot hold points; expected \.h5 or \.hdf5"):
        animate(scene(), tmp_path / "out.usdc", save_points=tmp_path / "points.npy", on_frame=never)
    monkeypatch.setattr(arrays, "import_module", Mock(side_effect=ImportError))
    for output, how in (("out.h5", {}), ("out.usdc", {"save_points": tmp_path / "points.h5"})):
        with pytest.raises(MissingExtraError, match=r"an \.h5 needs h5py: pip install 'balloon-warp\[data\]'"):
            animate(scene(), tmp_path / output, on_frame=never, **how)
    assert list(tmp_path.iterdir()) == []


WHITE, RED, GREEN, BLUE = (255, 255, 255), (200, 10, 10), (10, 180, 10), (10, 10, 200)
CLOTH = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def square(path: Path, image: str, interpolation: str = "faceVarying") -> Usd.Stage:
    """Write a square from -1 to 1 that is gray without its image; two triangles, so that nothing is refined."""
    stage = new_stage(path)
    corners, indices = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [0, 1, 2, 0, 2, 3]
    mesh = add_mesh(stage, "Square", corners, [3, 3], indices, (0.3, 0.3, 0.3), roughness=1.0)
    places = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    st.Set(places[indices] if interpolation == "faceVarying" else places)
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/Square"))
    surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Looks/Square/Surface"))
    show_image(material, surface, image, "st")
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    stage.GetRootLayer().Save()
    return stage


def quadrants(path: Path) -> list[np.ndarray]:
    """Return the mean colors of the quarters of the square, rows first, which 100 of 200 pixels show."""
    render_stage(path, path.with_suffix(".png"), size=(200, 200), device="cpu")
    seen = np.asarray(Image.open(path.with_suffix(".png"))).astype(int)
    return [seen[row : row + 30, column : column + 30].mean((0, 1)) for row in (60, 110) for column in (60, 110)]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """Write an image of white and red above green and blue."""
    path = tmp_path / "image.png"
    small = np.array([[WHITE, RED], [GREEN, BLUE]], np.uint8)
    Image.fromarray(small.repeat(32, axis=0).repeat(32, axis=1)).save(path)
    return path


@pytest.mark.parametrize("interpolation", ["faceVarying", "vertex"])
def test_an_image_lies_where_the_texture_coordinates_say(image: Path, tmp_path: Path, interpolation: str):
    square(tmp_path / "stage.usda", image.name, interpolation)
    white, red, green, blue = quadrants(tmp_path / "stage.usda")
    assert white.min() > 0.9 * white.max()
    assert white.min() > max(red.min(), green.min(), blue.min()) + 50
    for channel, color in enumerate((red, green, blue)):
        assert color.argmax() == channel
        assert color[channel] > 2.0 * np.delete(color, channel).max()


def test_what_is_no_image_gets_a_sentence(tmp_path: Path):
    square(tmp_path / "none.usda", "none.png")
    for color in quadrants(tmp_path / "none.usda"):
        assert np.ptp(color) < 20
    (tmp_path / "image.png").write_text("hello")
    square(tmp_path / "stage.usda", "image.png")
    with pytest.raises(InputError, match=NO_IMAGE):
        quadrants(tmp_path / "stage.usda")


def printed_scene(folder: Path, image: str = "image.png") -> Path:
    """Write a scene file of a square of cloth with an image beside it."""
    (folder / "cloth.obj").write_text(CLOTH)
    scene = folder / "scene.toml"
    scene.write_text(f'frames = 1\ngravity = 0.0\n[[balloon]]\nmesh = "cloth.obj"\nprint = "{image}"\n')
    return scene


def test_a_balloon_is_printed_as_its_scene_says(image: Path, tmp_path: Path):
    assert_valid(at_start(load_scene(printed_scene(tmp_path)), tmp_path / "out.usdc"))
    render_stage(tmp_path / "out.usdc", tmp_path / "out.png", size=(200, 200), azimuth=0.0, elevation=0.0, device="cpu")
    seen = np.asarray(Image.open(tmp_path / "out.png")).astype(int)
    _, red, green, blue = (seen[row, column] for row in (60, 140) for column in (60, 140))
    assert (red.argmax(), green.argmax(), blue.argmax()) == (0, 1, 2)


def test_prints_that_cannot_be_get_a_sentence(image: Path, tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.png: no such file; expected an image to print on cloth"):
        animate(load_scene(printed_scene(tmp_path, "none.png")), tmp_path / "out.usdc", device="cpu")
    scene = printed_scene(tmp_path)
    (tmp_path / "cloth.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"cloth\.obj: has no texture coordinates to print image\.png"):
        animate(load_scene(scene), tmp_path / "out.usdc", device="cpu")


NO_IMAGE = r"/World/Square: its texture .*image\.png cannot be read; expected an image"


def assert_printed(path: Path, corners: int) -> None:
    """Require that a square's corners in a .glb have the image's colors, as another program reads it."""
    [cloth] = trimesh.load(path, process=False).geometry.values()
    image = np.asarray(cloth.visual.material.baseColorTexture.convert("RGB")).astype(int)
    assert len(cloth.vertices) == corners
    colors = {(-1, 1): WHITE, (1, 1): RED, (-1, -1): GREEN, (1, -1): BLUE}
    for (x, y, _), (u, v) in zip(np.sign(np.round(cloth.vertices, 3)), cloth.visual.uv, strict=True):
        row, column = (np.clip(np.array([1.0 - v, u]) * image.shape[:2], 0, 63)).astype(int)
        assert np.abs(image[row, column] - colors[x, y]).max() <= 1
    np.testing.assert_array_equal(cloth.visual.material.baseColorFactor[:3], 255)


def test_a_glb_has_images_as_glb_takes_them(image: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    Image.open(image).save(tmp_path / "image.bmp")
    square(tmp_path / "stage.usda", "image.bmp")
    export_stage(tmp_path / "stage.usda", tmp_path / "out.glb")
    assert_printed(tmp_path / "out.glb", 4)
    assert Glb(tmp_path / "out.glb").said["images"][0]["mimeType"] == "image/png"
    monkeypatch.setattr(stage_reader, "LARGEST", 16)
    square(tmp_path / "large.usda", image.name)
    export_stage(tmp_path / "large.usda", tmp_path / "out.glb")
    [cloth] = trimesh.load(tmp_path / "out.glb").geometry.values()
    assert cloth.visual.material.baseColorTexture.size == (16, 16)
    image.write_text("hello")
    with pytest.raises(InputError, match=NO_IMAGE):
        export_stage(tmp_path / "large.usda", tmp_path / "out.glb")


SCRIPTS = ["気球", "шар", "μπαλόνι", "גליל", "गुब्बारा", "풍선", "Ballon_rouge_é", "ßÆ", "_x1"]
HALVES = unicodedata.normalize("NFC", "é"), unicodedata.normalize("NFD", "é")


def named_balloons(*names: str) -> Scene:
    """Return a scene with a balloon of each name, side by side."""
    balloons = [Balloon(mesh=cube(), name=name, position=(3.0 * n, 0, 0)) for n, name in enumerate(names)]
    return Scene(balloon=balloons, frames=1, touch=False)


def meshes_of(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Mesh)]


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        *((name, name) for name in SCRIPTS),
        ("気球 2", "気球_2"),
        ("2気球", "_気球"),
        ("шар🎈", "шар_"),
        ("\udce9t", "_t"),
        ("", "_"),
    ],
)
def test_a_name_that_usd_takes_stays_and_else_only_what_it_does_not_is_replaced(name: str, kept: str):
    assert identifier(name) == kept
    assert Sdf.Path.IsValidIdentifier(kept)


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_balloons_obstacles_and_bodies_are_called_as_they_are(suffix: str, tmp_path: Path):
    things = {"obstacle": [Obstacle(shape="box", name="стена 1", position=(0, -5, 0))]}
    things |= {"body": [Body(shape="box", name="箱", position=(0, 50, 0), mass=1.0)]}
    stage = animated(named_balloons(*SCRIPTS, "Ballon rouge é").model_copy(update=things), tmp_path / f"s{suffix}")
    assert [prim.GetName() for prim in meshes_of(stage)] == [*SCRIPTS, "Ballon_rouge_é_1"]
    assert [prim.GetDisplayName() for prim in meshes_of(stage)] == [""] * len(SCRIPTS) + ["Ballon rouge é"]
    assert stage.GetPrimAtPath("/World/Obstacles/стена_1").GetDisplayName() == "стена 1"
    assert stage.GetPrimAtPath("/World/Bodies/箱").GetDisplayName() == ""


def test_names_that_look_the_same_get_numbers(tmp_path: Path):
    composed, decomposed = HALVES
    named = named_balloons(composed, decomposed, composed, f"{decomposed}_1", "Ground").model_copy(
        update={"ground": Ground()}
    )
    stage = at_start(named, tmp_path / "same.usda")
    prims = meshes_of(stage)
    names = [prim.GetName() for prim in prims]
    assert names == ["é", "é_1", "é_2", "é_1_1", "Ground_1", "Ground"]
    assert all(name == unicodedata.normalize("NFC", name) for name in names)
    assert [prim.GetDisplayName() for prim in prims] == ["", "é", "é", "é_1", "Ground", ""]


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "気球.usdc"
    animate(named_balloons("気球", "Ballon rouge é"), path, device="cpu")
    return path


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".usdz", ".pvd", ".h5", ".ply"])
def test_what_is_made_of_a_stage_has_the_names(suffix: str, stage: Path, tmp_path: Path):
    output = tmp_path / (f"шар.####{suffix}" if suffix in (".obj", ".ply") else f"шар{suffix}")
    export_stage(stage, output)
    files = [path for path in tmp_path.iterdir() if path.stat().st_size]
    assert all(path.name.startswith("шар") for path in files)
    if suffix == ".glb":
        assert {"気球", "Ballon_rouge_é"} <= Glb(output).nodes.keys()
    if suffix == ".obj":
        assert "o 気球\n" in files[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("named", ["気球", "Ballon_rouge_é", "Ballon rouge é", f"Ballon rouge {HALVES[1]}"])
def test_a_picture_looks_at_either_name(named: str, stage: Path, tmp_path: Path):
    render_stage(stage, tmp_path / "picture.png", 1, (64, 64), 1, "cpu", look_at=named)
    assert (tmp_path / "picture.png").stat().st_size > 0
