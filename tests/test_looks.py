"""Looks of a mesh's own file: as they are read, after mesh preparation, and in outputs."""

# A mesh may have no looks: these have some, or the test fails.
# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import base64
import io
import json
import shutil
import struct
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import painted
import pytest
import trimesh
from exported import assert_valid
from painted import CORNERS, QUADS, SIDES, atlas, linear, places, seen_sides, write_obj_cube, write_painted
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from balloon_warp import InputError, PolygonMesh, StageWriter, export_stage, load_mesh, load_scene, render_stage
from balloon_warp.mesh.load import Treatment, prepared
from balloon_warp.model import build_model, plan_model
from balloon_warp.studio.parts import Animation
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.usd.grid import GridGroup, GridWriter

KINDS = ["glb", "gltf", "obj", "usda"]


def assert_painted(mesh: PolygonMesh) -> None:
    """Require that each face has the color of its side, and that there are some of each."""
    found = seen_sides(mesh)
    assert {side for side, _ in found} == set(range(6))
    for side, color in found:
        assert color == SIDES[side]


def torn_up(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh of loose faces in another order, one reversed, one duplicated and one of zero area."""
    corners = mesh.face_vertex_indices.reshape(mesh.face_count, -1)
    order = np.random.default_rng(1).permutation(mesh.face_count)
    numbers = np.arange(corners.size).reshape(corners.shape)[order]
    numbers[0] = numbers[0, ::-1]
    numbers = np.concatenate([np.full_like(numbers[:1], numbers[2, 0]), numbers, numbers[-1:]])
    own = np.arange(numbers.size, dtype=np.int32)
    return replace(
        mesh,
        points=mesh.points[mesh.face_vertex_indices[numbers.ravel()]],
        face_vertex_counts=np.full(len(numbers), corners.shape[1], np.int32),
        face_vertex_indices=np.where(own < numbers.shape[1], np.int32(0), own),
        texture_coordinates=mesh.texture_coordinates[numbers.ravel()],
        looks=mesh.looks.at(numbers.ravel()),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_lies_on_each_side_as_its_file_says_whatever_its_faces_are_like(kind: str, tmp_path):
    whole = load_mesh(write_painted(tmp_path, kind))
    assert_painted(whole)
    assert whole.warnings == ()
    assert whole.looks.materials[0].picture.data[:4] == b"\x89PNG"
    mended = prepared(torn_up(whole), "cube", Treatment())
    assert_painted(mended)
    assert len(np.unique(mended.face_vertex_indices)) == 8


def test_a_lid_has_the_material_of_what_is_around_it(tmp_path):
    ball = trimesh.creation.icosphere(2)
    upper = ball.triangles_center[:, 1] > 0.0
    top = int(ball.triangles_center[:, 1].argmax())
    lines = ["mtllib ball.mtl", *(f"v {x} {y} {z}" for x, y, z in ball.vertices)]
    for name, some in (("high", upper), ("low", ~upper)):
        kept = [face + 1 for number, face in enumerate(ball.faces) if some[number] and number != top]
        lines += [f"usemtl {name}", *(f"f {a} {b} {c}" for a, b, c in kept)]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    (tmp_path / "ball.mtl").write_text("newmtl high\nKd 1 0 0\nnewmtl low\nKd 0 0 1\n")
    mesh = prepared(load_mesh(tmp_path / "ball.obj"), "ball", Treatment())
    colors = mesh.looks.color_at_corners((0, 0, 0)).reshape(-1, 3, 3)
    assert len(colors) == mesh.face_count == len(ball.faces)
    assert (colors[-1] == (1, 0, 0)).all()


def test_materials_of_an_obj_stay_on_their_faces(tmp_path):
    path = write_obj_cube(
        tmp_path, painted.PLAIN.replace("newmtl 3\nKd 0.3 0.5 0.25", "newmtl 3\nmap_Kd images/the atlas.png")
    )
    for mesh in (load_mesh(path), prepared(torn_up(load_mesh(path)), "cube", Treatment())):
        for side, color in seen_sides(mesh):
            expected = SIDES[3] if side == 3 else (0.1 * side, 0.5, 0.25)
            np.testing.assert_allclose(color, expected, atol=1e-6)


def test_faces_without_places_stand_beside_some_with_an_image(tmp_path):
    with_image = painted.PLAIN.replace("newmtl 0\n", "newmtl paint\nmap_Kd images/the atlas.png\nnewmtl no\n")
    path = write_obj_cube(tmp_path, with_image)
    lines = path.read_text().splitlines()
    bare = [" ".join(word.split("/")[0] for word in line.split(" ")) for line in lines[35:]]
    path.write_text("\n".join(lines[:35] + bare))
    mesh = load_mesh(path)
    assert mesh.texture_coordinates.shape == (24, 2)
    np.testing.assert_allclose(mesh.texture_coordinates[:4], places()[0], atol=1e-6)
    assert dict(seen_sides(mesh))[0] == SIDES[0]


ATLAS_MEAN = linear(SIDES).mean(axis=0)


def without_places(path: Path) -> Path:
    """Take the texture coordinates from a painted cube."""
    if path.suffix == ".obj":
        path.write_text(path.read_text().replace("vt 0", "vt nan", 1))
    elif path.suffix == ".usda":
        stage = Usd.Stage.Open(str(path))
        stage.GetPrimAtPath("/cube").RemoveProperty("primvars:uv")
        stage.GetPrimAtPath("/paint/t").RemoveProperty("inputs:st")
        stage.Save()
    else:
        data = path.read_bytes()
        other = b"TEXCOORD_9" if b"_9" not in data else b"_EXCOORD_0"
        path.write_bytes(data.replace(b"TEXCOORD_0", other))
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_without_places_gives_its_mean_color_and_is_named(kind: str, tmp_path):
    mesh = load_mesh(without_places(write_painted(tmp_path, kind)))
    assert mesh.texture_coordinates is None
    [look] = mesh.looks.materials
    assert look.picture is None
    np.testing.assert_allclose(look.color, ATLAS_MEAN, atol=0.02)
    (sentence,) = mesh.warnings
    assert "has no coordinates on the mesh; its mean color is taken" in sentence
    if kind == "usda":  # which pictures and exports read, too
        np.testing.assert_allclose(Animation(tmp_path / "cube.usda").parts[0].color, ATLAS_MEAN, atol=0.02)


def test_the_only_texture_coordinates_of_a_mesh_count_whatever_their_name(tmp_path):
    path = write_painted(tmp_path, "usda")
    path.write_text(path.read_text().replace('inputs:varname = "uv"', 'inputs:varname = "UVMap"'))
    assert_painted(load_mesh(path))


def test_an_image_that_is_missing_is_named_by_pictures(tmp_path):
    path = write_painted(tmp_path, "usda")
    (tmp_path / "atlas.png").unlink()
    notes: list[str] = []
    RenderStage(path, on_note=notes.append)
    assert notes == ["Missing images: /paint/t (@atlas.png@)."]


@pytest.mark.parametrize(
    "line", ["images\\the atlas.png", "-s 1 1 1 -clamp on images/the atlas.png", "C:\\mine\\images\\other.png"]
)
def test_names_of_images_are_understood(line: str, tmp_path):
    atlas().save(tmp_path / "other.png")
    assert_painted(load_mesh(write_obj_cube(tmp_path, f"newmtl paint\nmap_Kd {line}\n")))


@pytest.mark.parametrize(("data", "said"), [(None, "is missing"), (b"hello", "cannot be read as an image")])
@pytest.mark.parametrize("kind", ["gltf", "obj", "usda"])
def test_an_image_that_cannot_be_had_is_one_sentence(kind: str, data: bytes | None, said: str, tmp_path):
    path = write_painted(tmp_path, kind)
    for image in tmp_path.rglob("*.png"):
        image.unlink() if data is None else image.write_bytes(data)
    mesh = load_mesh(path)
    assert len(mesh.warnings) == 1
    assert str(path) in mesh.warnings[0]
    assert said in mesh.warnings[0]
    assert mesh.looks is None or not mesh.looks.pictures


def test_a_cut_off_image_is_no_image(tmp_path):
    path = write_painted(tmp_path, "obj")
    image = tmp_path / "images/the atlas.png"
    big = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(big).save(image, "JPEG")
    image.write_bytes(image.read_bytes()[:900])
    assert load_mesh(path).warnings[0].endswith("cannot be read as an image; it is left out.")


def test_parts_of_a_glb_keep_their_colors(tmp_path):
    ball = trimesh.creation.icosphere(0)
    parts = []
    for number in range(3):
        part = ball.copy()
        part.apply_translation((3.0 * number, 0.0, 0.0))
        if number == 0:
            part.visual.vertex_colors = np.tile([[51, 102, 153, 255]], (len(part.vertices), 1))
        elif number == 1:
            material = trimesh.visual.material.PBRMaterial(baseColorFactor=[0, 255, 51, 255])
            part.visual = trimesh.visual.TextureVisuals(material=material)
        parts.append(part)
    trimesh.Scene(parts).export(tmp_path / "parts.glb")
    mesh = load_mesh(tmp_path / "parts.glb")
    part = np.round(mesh.points[mesh.face_vertex_indices][:, 0] / 3.0).astype(int)
    colors = mesh.looks.color_at_corners((0.0, 0.0, 0.5))
    # glTF's numbers are linear: bytes over 255.
    for number, color in enumerate([(0.2, 0.4, 0.6), (0.0, 1.0, 0.2), (0.0, 0.0, 0.5)]):
        np.testing.assert_allclose(colors[part == number], np.tile(color, ((part == number).sum(), 1)), atol=1e-6)


def test_a_texture_transform_moves_the_places(tmp_path):
    path = write_painted(tmp_path, "glb")
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    large = np.zeros((64, 96, 3), np.uint8)
    large[32:, 48:] = np.asarray(atlas())
    with io.BytesIO() as file:
        Image.fromarray(large).save(file, "PNG")
        tree["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()}]
    [material] = tree["materials"]
    transform = {"KHR_texture_transform": {"offset": [0.5, 0.5], "scale": [0.5, 0.5]}}
    material["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = transform
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    header = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(header + text + rest)
    assert_painted(load_mesh(path))


PLACES = ["materials", "textures", "images", "attributes", "TEXCOORD_0", "baseColorTexture", "material"]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("wrong", [None, -1, 99, "x", [], {}, [None, None, None]])
def test_a_gltf_that_says_nonsense_of_its_looks_is_a_mesh_or_a_sentence(place: str, wrong: object, tmp_path):
    path = write_painted(tmp_path, "gltf")
    tree = json.loads(path.read_text())
    primitive = tree["meshes"][0]["primitives"][0]
    homes = {"TEXCOORD_0": primitive["attributes"], "attributes": primitive, "material": primitive}
    homes["baseColorTexture"] = tree["materials"][0]["pbrMetallicRoughness"]
    homes.get(place, tree)[place] = wrong
    path.write_text(json.dumps(tree))
    with suppress(InputError):
        assert load_mesh(path).face_count == 12


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_colors_of_vertices_are_taken(kind: str, tmp_path):
    ball = trimesh.creation.icosphere(1)
    ball.visual.vertex_colors = np.tile([[200, 100, 0, 255]], (len(ball.vertices), 1))
    ball.export(tmp_path / f"ball.{kind}")
    mesh = prepared(load_mesh(tmp_path / f"ball.{kind}"), "ball", Treatment())
    # In eight bits, which the linear value rises by at most 2 / 255 a step of.
    np.testing.assert_allclose(mesh.looks.color_at_corners((0, 0, 0))[0], linear((200, 100, 0)), atol=0.01)


def test_a_mesh_of_trimesh_keeps_its_looks(tmp_path):
    assert_painted(load_mesh(trimesh.load(write_painted(tmp_path, "glb"), process=False).to_mesh()))
    ball = trimesh.creation.icosphere(1)
    assert load_mesh(ball).looks is None
    ball.visual.face_colors = np.tile([[200, 100, 0, 255]], (len(ball.faces), 1))
    colors = load_mesh(ball).looks.color_at_corners((0, 0, 0))
    np.testing.assert_allclose(colors, np.tile(linear((200, 100, 0)), (len(colors), 1)), atol=1e-6)


def usd_cube(folder: Path, interpolation: str = "", colors=()) -> tuple[Usd.Stage, UsdGeom.Mesh]:
    stage = Usd.Stage.CreateNew(str(folder / "plain.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/cube")
    mesh.CreatePointsAttr(CORNERS)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(QUADS.ravel().tolist())
    if interpolation:
        mesh.CreateDisplayColorPrimvar(interpolation).Set([Gf.Vec3f(*color) for color in colors])
    return stage, mesh


def test_display_colors_are_taken(tmp_path):
    sides = np.array(SIDES) / 255.0
    for interpolation, colors in (("constant", sides[:1]), ("uniform", sides), ("vertex", CORNERS / 2.0 + 0.5)):
        (tmp_path / interpolation).mkdir()
        usd_cube(tmp_path / interpolation, interpolation, colors.tolist())[0].Save()
        mesh = load_mesh(tmp_path / interpolation / "plain.usda")
        expected = {"constant": colors[np.zeros(24, int)], "uniform": colors.repeat(4, axis=0)}
        expected = expected.get(interpolation, colors[QUADS.ravel()] if interpolation == "vertex" else None)
        np.testing.assert_allclose(mesh.looks.color_at_corners((0, 0, 0)), expected, atol=1e-6)


def test_subsets_of_usd_keep_their_materials(tmp_path):
    stage, cube = usd_cube(tmp_path, "constant", [(0.3, 0.4, 0.5)])
    for name, faces, color in (("a", [1, 4], (0.9, 0.1, 0.1)), ("b", [2], (0.1, 0.9, 0.1))):
        material = UsdShade.Material.Define(stage, f"/{name}")
        surface = UsdShade.Shader.Define(stage, f"/{name}/surface")
        surface.CreateIdAttr("UsdPreviewSurface")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
        subset = UsdShade.MaterialBindingAPI.Apply(cube.GetPrim()).CreateMaterialBindSubset(name, faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    stage.Save()
    colors = load_mesh(tmp_path / "plain.usda").looks.color_at_corners((0, 0, 0))[::4]
    expected = np.tile([(0.3, 0.4, 0.5)], (6, 1))
    expected[[1, 4]], expected[2] = (0.9, 0.1, 0.1), (0.1, 0.9, 0.1)
    np.testing.assert_allclose(colors, expected, atol=1e-6)


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


@pytest.mark.parametrize("kind", ["glb", "obj", "usda"])
def test_the_stage_has_the_image_and_where_it_lies(kind: str, tmp_path):
    path = moved(written(write_painted(tmp_path, kind)))
    stage = Usd.Stage.Open(str(path))
    cube = stage.GetPrimAtPath("/World/cube")
    assert UsdGeom.PrimvarsAPI(cube).GetPrimvar("st").GetInterpolation() == UsdGeom.Tokens.faceVarying
    material, _ = UsdShade.MaterialBindingAPI(cube).ComputeBoundMaterial()
    shaders = map(UsdShade.Shader, material.GetPrim().GetChildren())
    [texture] = [each for each in shaders if each.GetIdAttr().Get() == "UsdUVTexture"]
    file = texture.GetInput("file").Get()
    assert file.path.startswith("./textures/")
    assert Path(file.resolvedPath).is_file()
    assert_painted(load_mesh(path))
    assert_valid(Usd.Stage.Open(str(path)))


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


@pytest.mark.parametrize(("suffix", "images"), [("glb", 0), ("usdz", 0), ("usda", 1)])
def test_what_a_stage_is_converted_to_has_the_image(suffix: str, images: int, tmp_path):
    stage = written(write_painted(tmp_path, "obj"))
    export_stage(stage, stage.parent / f"other.{suffix}")
    stage.unlink()
    if not images:
        shutil.rmtree(stage.parent / "textures")
    other = moved(stage.with_name(f"other.{suffix}"))
    assert len(list(other.parent.rglob("*.png"))) == images
    assert_painted(load_mesh(other))


def test_several_materials_are_subsets_that_share_out_the_faces(tmp_path):
    path = written(write_obj_cube(tmp_path, MATERIALS))
    stage = Usd.Stage.Open(str(path))
    subsets = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/cube")).GetMaterialBindSubsets()
    faces = {subset.GetPrim().GetName(): list(subset.GetIndicesAttr().Get()) for subset in subsets}
    assert sorted(face for some in faces.values() for face in some) == list(range(6))
    assert_valid(Usd.Stage.Open(str(path)))
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
    assert_valid(Usd.Stage.Open(str(path)))
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
    for prim in ("/World/Obstacles/mesh", "/World/Bodies/mesh"):
        assert_painted(load_mesh(path, prim))
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
    trimesh.creation.icosphere(1).export(tmp_path / "ball.stl")
    path = written(tmp_path / "ball.stl", SCENE.format(mesh="ball.stl"))
    for name, color in (("ball", (0.80, 0.07, 0.06)), ("ball_1", (0.05, 0.30, 0.75))):
        looks = load_mesh(path, f"/World/{name}").looks
        np.testing.assert_allclose(looks.color_at_corners((0, 0, 0))[0], color, atol=1e-6)
