"""Materials and colors: every gprim gets a display color, and a bound UsdPreviewSurface of the same color."""

from pathlib import Path

from pxr import Gf, Sdf, UsdGeom, UsdShade

from balloon_warp.scene import Scene

Color = tuple[float, float, float]
"""linear RGB"""

BALLOON_COLORS: list[Color] = [(0.80, 0.07, 0.06), (0.05, 0.30, 0.75), (0.95, 0.50, 0.03), (0.10, 0.50, 0.16)]
SPHERE_COLORS: list[Color] = [(0.06, 0.16, 0.45), (0.85, 0.60, 0.05), (0.08, 0.40, 0.35), (0.45, 0.10, 0.35)]
BODY_COLORS: list[Color] = [(0.50, 0.28, 0.10), (0.30, 0.34, 0.40), (0.42, 0.42, 0.16), (0.40, 0.16, 0.12)]
STRING_COLOR: Color = (0.25, 0.20, 0.16)
OBSTACLE_COLOR: Color = (0.45, 0.45, 0.47)
FORCE_COLOR: Color = (0.02, 0.30, 0.10)
GROUND_COLOR: Color = (0.72, 0.70, 0.66)
WATER_COLOR: Color = (0.06, 0.40, 0.52)
LATEX = {"subsurface_weight": 0.6, "specular_roughness": 0.25, "coat_weight": 0.8, "coat_roughness": 0.08}
"""of a rubber balloon, as OpenPBR names it: of thin walls, the subsurface's weight is of light that comes through"""


def balloon_color(scene: Scene, number: int) -> Color:
    """Of a balloon: its own, or the palette's for its number."""
    return scene.balloon[number].color or BALLOON_COLORS[number % len(BALLOON_COLORS)]


def paint(
    gprim: UsdGeom.Gprim,
    color: Color,
    roughness: float = 0.5,
    opacity: float = 1.0,
    clearcoat: float = 0.0,
    metallic: float = 0.0,
) -> UsdShade.Material:
    """Give a gprim its color and a material of its own, under the stage's /World/Looks."""
    gprim.CreateDisplayColorAttr([Gf.Vec3f(*color)])
    stage = gprim.GetPrim().GetStage()
    looks = UsdGeom.Scope.Define(stage, "/World/Looks")
    material = UsdShade.Material.Define(
        stage, looks.GetPath().AppendChild("_".join(gprim.GetPath().pathString.split("/")[2:]))
    )
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    finish = {"roughness": roughness, "opacity": opacity, "clearcoat": clearcoat}
    if metallic:
        finish["metallic"] = metallic
    for name, value in finish.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(gprim.GetPrim()).Bind(material)
    return material


def print_on(material: UsdShade.Material, image: Path) -> None:
    """Put an image in place of the color, where the primvar `st` says. It is named by its whole path."""
    stage, path = material.GetPrim().GetStage(), material.GetPath()
    places = UsdShade.Shader.Define(stage, path.AppendChild("Places"))
    places.CreateIdAttr("UsdPrimvarReader_float2")
    places.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Print"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(image.resolve().as_posix())
    for name in ("wrapS", "wrapT"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set("repeat")
    here = places.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(here)
    color = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface = UsdShade.Shader(stage.GetPrimAtPath(path.AppendChild("Surface")))
    surface.GetInput("diffuseColor").ConnectToSource(color)


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
