"""Small stages to render, and stages as the renderer reads them."""

from pathlib import Path

import meshes
import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from balloon_warp.studio.render import render_stage
from balloon_warp.studio.render.stage_reader import RenderStage

LATEX = {"roughness": 0.2, "opacity": 0.92, "clearcoat": 1.0}


def new_stage(path: Path, up_axis: str = "Y", frames: int = 1) -> Usd.Stage:
    """Return an empty stage with /World, whose frames are 0 to frames - 1."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(stage, up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(frames - 1)
    return stage


def before_camera(path: Path, frames: int = 1) -> Usd.Stage:
    """Return an empty stage with a camera 10 away, whose square picture is 4 wide at the origin."""
    stage = new_stage(path, frames=frames)
    add_camera(stage, distance=10.0, focal_length=60.0)
    return stage


def read_stage(path: Path, frame: int = 0) -> RenderStage:
    stage = RenderStage(path)
    stage.read_prims(frame)
    return stage


def picture(stage: Usd.Stage, **options) -> np.ndarray:
    """Return the stage's picture, sRGB, shape (height, width, 3 or 4), which lies beside it."""
    stage.GetRootLayer().Save()
    path = Path(stage.GetRootLayer().realPath)
    render_stage(path, path.with_suffix(".png"), **{"size": (200, 200), "device": "cpu"} | options)
    return np.asarray(Image.open(path.with_suffix(".png"))).astype(int)


def upright(stage: Usd.Stage, points) -> np.ndarray:
    """Return points given with Y up in the axes of the stage."""
    points = np.asarray(points, np.float32).reshape(-1, 3)
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        points = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    return points


def add_mesh(stage: Usd.Stage, name: str, points, counts, indices, color, **finish: float) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{name}")
    mesh.CreatePointsAttr(upright(stage, points))
    mesh.CreateFaceVertexCountsAttr(np.asarray(counts, np.int32))
    mesh.CreateFaceVertexIndicesAttr(np.asarray(indices, np.int32))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    paint(mesh, color, **finish)
    return mesh


def add_ground(stage: Usd.Stage, height: float = 0.0, half: float = 50.0, color=(0.72, 0.70, 0.66)) -> UsdGeom.Mesh:
    corners = [(-half, height, half), (half, height, half), (half, height, -half), (-half, height, -half)]
    return add_mesh(stage, "Ground", corners, [4], [0, 1, 2, 3], color, roughness=0.9)


def add_sphere(stage: Usd.Stage, name: str, center, radius: float, color, **finish: float) -> UsdGeom.Sphere:
    """Add a sphere; several centers are its places at frames 0, 1, ..."""
    sphere = UsdGeom.Sphere.Define(stage, f"/World/{name}")
    sphere.CreateRadiusAttr(radius)
    translate = sphere.AddTranslateOp()
    centers = upright(stage, center).astype(float)
    for frame, place in enumerate(centers):
        translate.Set(Gf.Vec3d(*place.tolist()), Usd.TimeCode(frame) if len(centers) > 1 else Usd.TimeCode.Default())
    paint(sphere, color, **finish)
    return sphere


def add_curves(stage: Usd.Stage, name: str, points, counts, width: float, colors) -> UsdGeom.BasisCurves:
    """Add linear curves without a material; one color, or one a curve."""
    curves = UsdGeom.BasisCurves.Define(stage, f"/World/{name}")
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreatePointsAttr(upright(stage, points))
    curves.CreateCurveVertexCountsAttr(list(counts))
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform if len(colors) > 1 else UsdGeom.Tokens.constant).Set(
        [Gf.Vec3f(*color) for color in colors]
    )
    return curves


def add_camera(stage: Usd.Stage, distance: float, focal_length: float, aperture: float = 24.0) -> UsdGeom.Camera:
    """Add a camera on the Z axis of a stage with Y up, that looks at the origin; square aperture."""
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(focal_length)
    camera.CreateHorizontalApertureAttr(aperture)
    camera.CreateVerticalApertureAttr(aperture)
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, distance))
    return camera


def paint(gprim: UsdGeom.Gprim, color, **finish: float) -> None:
    gprim.CreateDisplayColorAttr([Gf.Vec3f(*color)])
    stage = gprim.GetPrim().GetStage()
    material = UsdShade.Material.Define(stage, f"/World/Looks/{gprim.GetPrim().GetName()}")
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    for name, value in finish.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(gprim.GetPrim()).Bind(material)


def quad_sphere(cells: int, radius: float = 1.0, center=(0.0, 0.0, 0.0)):
    """Return points, face counts and face indices of a cube of cells x cells quads a side, projected to a sphere."""
    mesh = meshes.at(meshes.quad_sphere(cells, radius), center)
    return mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices


def small_world(path: Path, up_axis: str = "Y") -> Usd.Stage:
    """Write rubber before rubber, foil, a sphere and a string on the ground: one of each kind of thing in pictures."""
    stage = new_stage(path, up_axis)
    add_ground(stage)
    add_mesh(stage, "Red", *quad_sphere(6, 0.5, (-0.7, 0.9, 0.4)), (0.8, 0.05, 0.05), **LATEX)
    add_mesh(stage, "Blue", *quad_sphere(6, 0.5, (-0.2, 0.6, -0.5)), (0.05, 0.3, 0.75), **LATEX)
    add_mesh(stage, "Foil", *quad_sphere(6, 0.5, (0.8, 0.6, 0.0)), (0.9, 0.6, 0.1), roughness=0.12, metallic=1.0)
    add_sphere(stage, "Ball", (0.3, 0.2, 0.7), 0.2, (0.02, 0.5, 0.1), roughness=0.3)
    add_curves(stage, "String", [(-0.7, 0.4, 0.4), (-0.6, 0.0, 0.5)], [2], 0.01, [(0.2, 0.2, 0.2)])
    stage.GetRootLayer().Save()
    return stage
