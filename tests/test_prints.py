"""Images that a stage's materials have, in its pictures."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from render_stages import add_camera, add_mesh, new_stage

from balloon_warp.errors import InputError
from balloon_warp.outputs.render import render_stage

WHITE, RED, GREEN, BLUE = (255, 255, 255), (200, 10, 10), (10, 180, 10), (10, 10, 200)


def square(path: Path, image: str, interpolation: str = "faceVarying") -> Usd.Stage:
    """A square from -1 to 1 that is gray, if its image cannot be found; two triangles, so that nothing is refined."""
    stage = new_stage(path)
    corners, indices = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [0, 1, 2, 0, 2, 3]
    mesh = add_mesh(stage, "Square", corners, [3, 3], indices, (0.3, 0.3, 0.3), roughness=1.0)
    places = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    st.Set(places[indices] if interpolation == "faceVarying" else places)
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/Square"))
    texture = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Image"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(image)
    reader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Places"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    shader = UsdShade.Shader(stage.GetPrimAtPath("/World/Looks/Square/Surface"))
    shader.GetInput("diffuseColor").ConnectToSource(texture.ConnectableAPI(), "rgb")
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    stage.GetRootLayer().Save()
    return stage


def quadrants(path: Path) -> list[np.ndarray]:
    """The mean colors of the quarters of the square, rows first, which 100 of 200 pixels show."""
    render_stage(path, path.with_suffix(".png"), size=(200, 200), device="cpu")
    seen = np.asarray(Image.open(path.with_suffix(".png"))).astype(int)
    return [seen[row : row + 30, column : column + 30].mean((0, 1)) for row in (60, 110) for column in (60, 110)]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """White and red above green and blue."""
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


def test_without_its_image_a_surface_has_its_own_color(image: Path, tmp_path: Path):
    square(tmp_path / "stage.usda", "none.png")
    for color in quadrants(tmp_path / "stage.usda"):
        assert np.ptp(color) < 20


def test_what_is_no_image_gets_a_sentence(tmp_path: Path):
    (tmp_path / "image.png").write_text("hello")
    square(tmp_path / "stage.usda", "image.png")
    with pytest.raises(InputError, match=r"/World/Square: its texture .*image\.png cannot be read; expected an image"):
        quadrants(tmp_path / "stage.usda")
