"""Materials and colors: every gprim gets a display color, and a bound UsdPreviewSurface of the same color."""

import itertools
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from balloon_warp.files import whole_path
from balloon_warp.mesh.looks import Color
from balloon_warp.outputs.usd.names import identifier

LATEX = {"subsurface_weight": 0.6, "specular_roughness": 0.25, "coat_weight": 0.8, "coat_roughness": 0.08}
"""Look of a rubber balloon, as OpenPBR names it: for thin walls, the subsurface's weight is of transmitted light"""
PLAIN_FINISH = {"roughness": 0.5, "opacity": 1.0, "clearcoat": 0.0}
"""Inputs of UsdPreviewSurface by default"""


def paint(gprim: UsdGeom.Gprim, color: Color, **finish: float) -> UsdShade.Material:
    """Give a gprim its color and a material of its own, as `define_material`."""
    gprim.CreateDisplayColorAttr([Gf.Vec3f(*color)])
    material = define_material(gprim, color, name=None, **finish)
    bind(gprim.GetPrim(), material)
    return material


def define_material(
    gprim: UsdGeom.Gprim, color: Color, *, name: str | None = None, **finish: float
) -> UsdShade.Material:
    """Define a material for a gprim under the stage's /World/Looks.

    Args:
        name: of one of several.
        finish: inputs of UsdPreviewSurface beside the color: roughness, opacity, clearcoat, metallic.
    """
    stage = gprim.GetPrim().GetStage()
    looks = UsdGeom.Scope.Define(stage, "/World/Looks")
    words = gprim.GetPath().pathString.split("/")[2:]
    own = "_".join(words if name is None else [*words, identifier(name)])
    free = (own if number == 0 else f"{own}_{number}" for number in itertools.count())
    paths = (looks.GetPath().AppendChild(each) for each in free)
    path = next(path for path in paths if name is None or not stage.GetPrimAtPath(path))
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    for each, value in (PLAIN_FINISH | finish).items():
        shader.CreateInput(each, Sdf.ValueTypeNames.Float).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def bind(prim: Usd.Prim, material: UsdShade.Material) -> None:
    """Bind a material to a gprim, or a subset of its faces."""
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def shine_from_within(material: UsdShade.Material) -> UsdShade.Input:
    """Return the input of a material for light that the surface gives off by itself."""
    return _surface_of(material).CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)


def print_on(material: UsdShade.Material, image: Path) -> None:
    """Put an image in place of the color, by the primvar `st`; it is named by its whole path."""
    put_image(material, whole_path(image).as_posix())


def put_image(material: UsdShade.Material, image: str, tint: Color = (1.0, 1.0, 1.0)) -> None:
    """Put an image in place of the color, by the primvar `st`.

    Args:
        image: File of the image, as the stage is to name it.
        tint: Factor on its linear RGB.
    """
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    places = _reader(material, "Places", "UsdPrimvarReader_float2", "st")
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Print"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(image)
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    if tint != (1.0, 1.0, 1.0):
        texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*tint, 1.0))
    for name in ("wrapS", "wrapT"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set("repeat")
    here = places.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(here)
    _color_of(material).ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))


def color_from(material: UsdShade.Material, primvar: str, otherwise: Color) -> None:
    """Connect a material's color to a primvar of its prim."""
    take_from_primvar(_color_of(material), primvar, otherwise)


def take_from_primvar(color: UsdShade.Input, primvar: str, otherwise: Color) -> None:
    """Connect an input of a surface to a color primvar of its prim."""
    material = UsdShade.Material(color.GetPrim().GetParent())
    reader = _reader(material, "Colors", "UsdPrimvarReader_float3", primvar)
    reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*otherwise))
    color.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float3))


def _reader(material: UsdShade.Material, name: str, kind: str, primvar: str) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(material.GetPrim().GetStage(), material.GetPath().AppendChild(name))
    reader.CreateIdAttr(kind)
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    return reader


def _color_of(material: UsdShade.Material) -> UsdShade.Input:
    return _surface_of(material).GetInput("diffuseColor")


def _surface_of(material: UsdShade.Material) -> UsdShade.Shader:
    return UsdShade.Shader(material.GetPrim().GetStage().GetPrimAtPath(material.GetPath().AppendChild("Surface")))


def offer_latex(material: UsdShade.Material, color: Color) -> None:
    """Offer thin-walled latex beside the preview surface: MaterialX's OpenPBR, in the variant "openpbr" of "surface".

    The preview surface is chosen. A USD without MaterialX, such as usd-core, does not know OpenPBR, and its validators
    call a shader that it does not know an error.
    """
    surface = material.GetPrim().GetVariantSets().AddVariantSet("surface")
    surface.AddVariant("preview")
    surface.AddVariant("openpbr")
    surface.SetVariantSelection("openpbr")
    with surface.GetVariantEditContext():
        shader = UsdShade.Shader.Define(material.GetPrim().GetStage(), material.GetPath().AppendChild("Latex"))
        shader.CreateIdAttr("ND_open_pbr_surface_surfaceshader")
        for name in ("base_color", "subsurface_color"):
            shader.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        for name, value in LATEX.items():
            shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
        shader.CreateInput("geometry_thin_walled", Sdf.ValueTypeNames.Bool).Set(True)
        material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.CreateOutput("out", Sdf.ValueTypeNames.Token))
    surface.SetVariantSelection("preview")
