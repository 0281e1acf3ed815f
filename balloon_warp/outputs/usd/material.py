"""Materials and colors: every gprim gets a display color, and a bound UsdPreviewSurface of the same color."""

from pxr import Gf, Sdf, UsdGeom, UsdShade

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


def paint(
    gprim: UsdGeom.Gprim, color: Color, roughness: float = 0.5, opacity: float = 1.0, clearcoat: float = 0.0
) -> None:
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
    for name, value in (("roughness", roughness), ("opacity", opacity), ("clearcoat", clearcoat)):
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(gprim.GetPrim()).Bind(material)
