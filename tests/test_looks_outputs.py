"""Looks of a mesh's own file in outputs: the stage, pictures, and files of other kinds."""

# A mesh may have no looks: these have some, or the test fails.
# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from painted import SIDES, color_in, seen_sides, write_obj_cube, write_painted
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade, UsdValidation

from balloon_warp import InputError, export_stage, load_scene
from balloon_warp.mesh.load import load_mesh
from balloon_warp.model import build_model, plan_model
from balloon_warp.outputs.render import render_stage
from balloon_warp.outputs.usd import StageWriter
from balloon_warp.outputs.usd.grid import GridGroup, GridWriter
from balloon_warp.scene.colors import palette_color

SCENE = """
[[balloon]]
mesh = "{mesh}"
holes = "keep"
"""
MATERIALS = "newmtl 0\nKd 0.9 0.1 0.1\nnewmtl 1\nKd 0.1 0.9 0.1\nnewmtl paint\nmap_Kd images/the atlas.png\n"


def written(mesh: Path, more: str = "", suffix: str = "usda") -> Path:
    """Return a stage of a scene before anything moves, in a folder of its own."""
    folder = mesh.parent / "out"
    folder.mkdir(exist_ok=True)
    scene = mesh.parent / "scene.toml"
    scene.write_text(SCENE.format(mesh=mesh.name) + more)
    with StageWriter(folder / f"stage.{suffix}", build_model(load_scene(scene), "cpu")) as writer:
        writer.stage.SetEndTimeCode(0)
    return folder / f"stage.{suffix}"


def moved(stage: Path) -> Path:
    """Return the stage moved to another folder with the files beside it, and nothing left behind."""
    for path in stage.parent.parent.iterdir():
        if path != stage.parent:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return stage.parent.rename(stage.parent.with_name("moved")) / stage.name


def assert_valid(path: Path) -> None:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))


def assert_sides(path: Path, prim: str | None = None) -> None:
    """Require that each face of a mesh has its side's color in a file that is read again."""
    found = seen_sides(load_mesh(path, prim))
    assert {side for side, _ in found} == set(range(6))
    for side, color in found:
        assert color == SIDES[side]


@pytest.mark.parametrize("kind", ["glb", "obj", "usda"])
def test_the_stage_has_the_image_and_where_it_lies(kind: str, tmp_path):
    path = moved(written(write_painted(tmp_path, kind)))
    stage = Usd.Stage.Open(str(path))
    cube = stage.GetPrimAtPath("/World/cube")
    assert UsdGeom.PrimvarsAPI(cube).GetPrimvar("st").GetInterpolation() == UsdGeom.Tokens.faceVarying
    material, _ = UsdShade.MaterialBindingAPI(cube).ComputeBoundMaterial()
    [texture] = [
        each for each in material.GetPrim().GetChildren() if UsdShade.Shader(each).GetIdAttr().Get() == "UsdUVTexture"
    ]
    file = UsdShade.Shader(texture).GetInput("file").Get()
    assert file.path.startswith("./textures/")
    assert Path(file.resolvedPath).is_file()
    assert_sides(path)
    assert_valid(path)


def seen_from(path: Path, azimuth: float) -> np.ndarray:
    """Return the mean color in the middle of a picture, from 0 to 255."""
    picture = path.with_suffix(".png")
    render_stage(path, picture, size=(64, 48), samples=1, device="cpu", azimuth=azimuth, elevation=0.0)
    return np.asarray(Image.open(picture).convert("RGB"))[18:30, 26:38].mean(axis=(0, 1))


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_pictures_show_each_side_in_its_color(kind: str, tmp_path):
    path = written(write_painted(tmp_path, kind))
    for azimuth, side in ((0.0, 5), (90.0, 1), (180.0, 4), (270.0, 0)):
        seen, color = seen_from(path, azimuth), np.array(SIDES[side])
        # Light and gloss change how bright it is, not which channels are strong.
        assert seen[color > 150].min() > 1.5 * seen[color < 80].max()


def test_a_glb_has_the_image_and_where_it_lies(tmp_path):
    stage = written(write_painted(tmp_path, "obj"))
    export_stage(stage, tmp_path / "out.glb")
    [cube] = trimesh.load(tmp_path / "out.glb", process=False).geometry.values()
    for face, normal in zip(cube.faces, cube.face_normals, strict=True):
        side = 2 * int(np.abs(normal).argmax()) + int(normal.sum() > 0.0)
        assert color_in(cube.visual.material.baseColorTexture, cube.visual.uv[face].mean(axis=0)) == SIDES[side]
    assert_sides(tmp_path / "out.glb")


def test_a_package_has_its_image_in_it(tmp_path):
    export_stage(written(write_painted(tmp_path, "glb")), tmp_path / "cube.usdz")
    assert sum(name.endswith(".png") for name in zipfile.ZipFile(tmp_path / "cube.usdz").namelist()) == 1
    (tmp_path / "alone").mkdir()
    path = (tmp_path / "cube.usdz").rename(tmp_path / "alone/cube.usdz")
    assert_sides(path)


def test_a_stage_made_of_another_has_its_image_beside_it(tmp_path):
    stage = written(write_painted(tmp_path, "obj"))
    (tmp_path / "there").mkdir()
    export_stage(stage, tmp_path / "there/other.usda")
    shutil.rmtree(stage.parent)
    shutil.rmtree(tmp_path / "images")
    assert_sides(tmp_path / "there/other.usda")
    assert [path.name for path in (tmp_path / "there").rglob("*.png")] == [
        p.name for p in (tmp_path / "there/textures").iterdir()
    ]


def test_several_materials_are_subsets_that_share_out_the_faces(tmp_path):
    path = written(write_obj_cube(tmp_path, MATERIALS))
    stage = Usd.Stage.Open(str(path))
    subsets = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/cube")).GetMaterialBindSubsets()
    faces = {subset.GetPrim().GetName(): list(subset.GetIndicesAttr().Get()) for subset in subsets}
    assert sorted(face for some in faces.values() for face in some) == list(range(6))
    assert_valid(path)
    export_stage(path, tmp_path / "out.glb")
    for read in (path, tmp_path / "out.glb"):
        found = dict(seen_sides(load_mesh(read)))
        np.testing.assert_allclose((found[0], found[1]), [(0.9, 0.1, 0.1), (0.1, 0.9, 0.1)], atol=1e-6)
        assert [found[side] for side in range(2, 6)] == SIDES[2:]
    red, cyan = seen_from(path, 270.0), seen_from(path, 0.0)
    assert red.argmax() == 0
    assert cyan.argmin() == 0


def test_colors_of_vertices_are_in_all_outputs(tmp_path):
    ball = trimesh.creation.icosphere(2)
    ball.visual.vertex_colors = np.where(ball.vertices[:, :1] > 1e-6, [[230, 20, 20, 255]], [[20, 20, 230, 255]])
    ball.export(tmp_path / "ball.ply")
    path = written(tmp_path / "ball.ply")
    assert_valid(path)
    assert seen_from(path, 90.0).argmax() == 0
    assert seen_from(path, 270.0).argmax() == 2
    export_stage(path, tmp_path / "out.glb")
    for read in (path, tmp_path / "out.glb"):
        mesh = load_mesh(read)
        right = mesh.points[mesh.face_vertex_indices][:, 0] > 1e-6
        colors = mesh.looks.color_at_corners((0, 0, 0))
        assert (colors.argmax(axis=1) == np.where(right, 0, 2)).all()


def test_what_the_scene_says_counts_for_more(tmp_path):
    path = written(write_painted(tmp_path, "obj"), "color = [0.1, 0.2, 0.3]\n")
    assert not (path.parent / "textures").exists()
    looks = load_mesh(path).looks
    np.testing.assert_allclose(looks.color_at_corners((0, 0, 0)), np.tile([(0.1, 0.2, 0.3)], (24, 1)), atol=1e-6)


def test_a_file_in_the_place_of_the_folder_is_found_before_the_work(tmp_path):
    mesh = write_painted(tmp_path, "obj")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/textures").write_text("mine")
    with pytest.raises(InputError, match="textures"):
        written(mesh)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["textures"]


SOLIDS = """
color = [0.5, 0.5, 0.5]
[[obstacle]]
mesh = "cube.obj"
position = [4, 0, 0]
[[body]]
mesh = "cube.obj"
position = [8, 0, 0]
[[body]]
mesh = "cube.obj"
position = [8, 8, 0]
color = [0.5, 0.5, 0.5]
"""


def test_obstacles_and_bodies_keep_their_looks(tmp_path):
    path = written(write_painted(tmp_path, "obj"), SOLIDS)
    assert_sides(path, "/World/Obstacles/mesh")
    assert_sides(path, "/World/Bodies/mesh")
    assert not load_mesh(path, "/World/Bodies/mesh_1").looks.pictures


def test_a_batch_keeps_them(tmp_path):
    mesh = write_painted(tmp_path, "obj")
    written(mesh)
    plan = plan_model(load_scene(tmp_path / "scene.toml"))
    (tmp_path / "batch").mkdir()
    with GridWriter(tmp_path / "batch/worlds.usda", [GridGroup(plan, np.array([0]), np.array([0]))]):
        pass
    stage = Usd.Stage.Open(str(tmp_path / "batch/worlds.usda"))
    [cube] = [prim for prim in stage.Traverse() if UsdGeom.Mesh(prim)]
    material, _ = UsdShade.MaterialBindingAPI(cube).ComputeBoundMaterial()
    assert stage.GetPrimAtPath(material.GetPath().AppendChild("Print"))
    assert UsdGeom.PrimvarsAPI(cube).GetPrimvar("st").HasValue()
    assert [file.suffix for file in (tmp_path / "batch/textures").iterdir()] == [".png"]


def test_without_looks_each_balloon_has_another_color_and_one_is_red(tmp_path):
    colors = np.array([palette_color(number) for number in range(20)])
    apart = np.abs(colors[:, None] - colors).max(axis=2) + np.eye(20)
    assert apart.min() > 0.02
    trimesh.creation.icosphere(1).export(tmp_path / "ball.stl")
    path = written(tmp_path / "ball.stl", SCENE.format(mesh="ball.stl"))
    for name, color in (("ball", (0.80, 0.07, 0.06)), ("ball_1", (0.05, 0.30, 0.75))):
        looks = load_mesh(path, f"/World/{name}").looks
        np.testing.assert_allclose(looks.color_at_corners((0, 0, 0))[0], color, atol=1e-6)
