"""Images on balloons: of any stage's materials, and of a scene's prints."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from glb_files import Glb
from motion import animated, assert_valid
from painted import show_image
from PIL import Image
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from render_stages import add_camera, add_mesh, new_stage

from balloon_warp import InputError, animate, export_stage, load_scene
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.scene.write import write_scene
from balloon_warp.scenes.model_print import dots
from balloon_warp.studio.render import render_stage, stage_reader

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


def test_an_image_in_a_package_is_found(image: Path, tmp_path: Path):
    square(tmp_path / "stage.usda", image.name)
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "stage.usda"), str(tmp_path / "stage.usdz"))
    image.unlink()
    _, red, *_ = quadrants(tmp_path / "stage.usdz")
    assert red.argmax() == 0
    assert red[0] > 2.0 * red[2]


def test_what_is_no_image_gets_a_sentence(tmp_path: Path):
    """A surface without its image has its own color."""
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
    assert_valid(animated(load_scene(printed_scene(tmp_path)), tmp_path / "out.usdc"))
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


@pytest.mark.parametrize("interpolation", ["faceVarying", "vertex"])
def test_a_glb_has_the_image_in_it(image: Path, tmp_path: Path, interpolation: str):
    square(tmp_path / "stage.usda", image.name, interpolation)
    export_stage(tmp_path / "stage.usda", tmp_path / "out.glb")
    assert image.read_bytes() in (tmp_path / "out.glb").read_bytes()
    image.unlink()
    assert_printed(tmp_path / "out.glb", 4)


def test_a_glb_has_images_as_glb_takes_them(image: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Images in a .glb are PNG or JPEG of bounded size: another kind is converted, and a large one reduced."""
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


def test_balloons_of_one_print_share_it_in_a_glb(image: Path, tmp_path: Path):
    image.write_bytes(image.read_bytes() + bytes(1 + -len(image.read_bytes()) % 4))  # the next buffer is still aligned
    scene = printed_scene(tmp_path)
    other = '[[balloon]]\nmesh = "cloth.obj"\nprint = "image.png"\nposition = [4.0, 0.0, 0.0]\n'
    foil = '[[balloon]]\nmesh = "cloth.obj"\nlook = "foil"\nposition = [8.0, 0.0, 0.0]\n'
    scene.write_text(scene.read_text() + other + foil)
    animate(load_scene(scene), tmp_path / "out.usdc", device="cpu")
    export_stage(tmp_path / "out.usdc", tmp_path / "out.glb")
    file = Glb(tmp_path / "out.glb")
    first, second, plain = (material["pbrMetallicRoughness"] for material in file.said["materials"])
    assert first["baseColorTexture"] == second["baseColorTexture"] == {"index": 0}
    assert file.said["textures"] == [{"source": 0}]
    assert len(file.said["images"]) == 1
    assert not any(view["byteOffset"] % 4 for view in file.said["bufferViews"])
    assert "baseColorTexture" not in plain
    assert (first["metallicFactor"], plain["metallicFactor"]) == (0.0, 1.0)


def test_a_scene_is_copied_with_its_print(tmp_path: Path):
    kept = load_scene("pillow_on_water").balloon[0].print
    assert kept is not None
    written = write_scene(load_scene("pillow_on_water"), tmp_path / "mine.toml")
    assert [path.name for path in written] == ["mine.toml", "pillow.obj", "pillow.png"]
    assert load_scene(tmp_path / "mine.toml").balloon[0].print == tmp_path / "pillow.png"
    assert (tmp_path / "pillow.png").read_bytes() == kept.read_bytes()
    # It is the script's output; other machines round square roots their own way.
    assert np.abs(np.asarray(Image.open(kept)).astype(int) - dots()).max() <= 2


def test_texture_coordinates_are_written(tmp_path: Path):
    (tmp_path / "cloth.obj").write_text(CLOTH)
    mesh = read_obj(tmp_path / "cloth.obj")
    write_obj(tmp_path / "again.obj", mesh)
    again = read_obj(tmp_path / "again.obj")
    np.testing.assert_array_equal(again.texture_coordinates, mesh.texture_coordinates)
    np.testing.assert_array_equal(again.points, mesh.points)
