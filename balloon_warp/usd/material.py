"""Names, visibility, materials and colors of prims; colliders and rigid bodies of `UsdPhysics` for other simulators.

Kinematic bodies move by their time samples.
"""

import itertools
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.polygon_mesh import Color, Looks, Picture
from balloon_warp.mesh.topology import face_starts
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.materials import INCOMPRESSIBLE, law_of, sheet_of_springs, youngs_modulus
from balloon_warp.scene import Scene, Sphere, String
from balloon_warp.scene.around import looks_of_file
from balloon_warp.scene.load import is_there
from balloon_warp.system.files import legible, whole_path

HOME = Sdf.Path("/World/Physics")
"""Path of prims for simulators alone"""
SURFACE = ("friction", "restitution")
"""Suffixes of the parameters that `make_collider` takes"""


def substance_of(prim: Usd.Prim) -> tuple[Usd.Prim, UsdPhysics.MaterialAPI]:
    """Define a material for the purpose of physics and bind it to a prim of the stage's /World."""
    path = HOME.AppendPath(prim.GetPath().MakeRelativePath(HOME.GetParentPath()))
    material = UsdShade.Material.Define(prim.GetStage(), path)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, UsdShade.Tokens.fallbackStrength, "physics")
    return material.GetPrim(), UsdPhysics.MaterialAPI.Apply(material.GetPrim())


def make_collider(prim: Usd.Prim, friction: float, restitution: float) -> None:
    """Make a prim a collider; it stays where it is, unless it is a body."""
    UsdPhysics.CollisionAPI.Apply(prim)
    _, surface = substance_of(prim)
    surface.CreateStaticFrictionAttr(friction)
    surface.CreateDynamicFrictionAttr(friction)
    surface.CreateRestitutionAttr(restitution)


def make_kinematic(prim: Usd.Prim) -> None:
    """Make a prim kinematic: it moves by its time samples, whatever pushes it."""
    UsdPhysics.RigidBodyAPI.Apply(prim).CreateKinematicEnabledAttr(True)


def make_free_body(prim: Usd.Prim, velocity: NDArray[np.floating], spin: NDArray[np.floating]) -> None:
    """Make a prim a free body.

    Args:
        velocity: Velocity at the start, along the prim's own axes, as in UsdPhysics [m/s], shape (3,).
        spin: Angular velocity likewise [rad/s], shape (3,).
    """
    body = UsdPhysics.RigidBodyAPI.Apply(prim)
    body.CreateVelocityAttr(Gf.Vec3f(*velocity.tolist()))
    body.CreateAngularVelocityAttr(Gf.Vec3f(*np.degrees(spin).tolist()))


RESERVED = (
    *("Ground", "Floor", "Water", "Pool", "Looks", "Spheres", "Strings", "Obstacles", "NetForces", "Prototypes"),
    *("Studio", "Physics"),
)
"""Names that no balloon gets"""


def composed(name: str) -> str:
    """Return a name in Unicode's composed form, so that two names that look the same are the same."""
    return unicodedata.normalize("NFC", legible(name))


def identifier(name: str) -> str:
    """Return a name as USD takes it: letters and digits of any script stay, all else becomes _."""
    kept = "".join(letter if Sdf.Path.IsValidIdentifier(f"_{letter}") else "_" for letter in composed(name))
    return kept if Sdf.Path.IsValidIdentifier(kept) else f"_{kept[1:]}"


def prim_names(names: Iterable[str], taken: Collection[str] = ()) -> list[str]:
    """Return a valid prim name for each name, all different, and none of those that are taken."""
    chosen: list[str] = []
    for name in map(identifier, names):
        numbered = (f"{name}_{number}" for number in itertools.count(1))
        chosen.append(
            next(free for free in itertools.chain([name], numbered) if free not in (*RESERVED, *taken, *chosen))
        )
    return chosen


def show_names(layer: Sdf.Layer, paths: Iterable[Sdf.Path], names: Iterable[str]) -> None:
    """Write the names that programs are to show of prims, where their own are others."""
    for path, name in zip(paths, map(composed, names), strict=True):
        if name and name != path.name:
            layer.GetPrimAtPath(path).SetInfo("displayName", name)


def is_called(prim: Usd.Prim, name: str) -> bool:
    """Return whether a prim is the one that somebody means by a name: its own, or the one that programs show."""
    return composed(name) in (composed(prim.GetName()), composed(prim.GetDisplayName()))


PAIRED = "balloonWarpPair"
"""Key of the custom data of a curve and of the mesh around it: pictures and exports of ours take the curve"""
BACKDROP = "balloonWarpBackdrop"
"""Key of the custom data of a backdrop: pictures of ours bring their own, and exports have none"""
SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
"""Purposes of visible prims"""


def is_shown(prim: Usd.Prim) -> bool:
    """Return whether a prim is visible in pictures and exports; of a curve and its mesh, the curve."""
    if prim.HasCustomDataKey(BACKDROP):
        return False
    return (UsdGeom.Imageable(prim).ComputePurpose() in SHOWN) != prim.HasCustomDataKey(PAIRED)


def show_while_there(prim: UsdGeom.Imageable, scene: Scene, lasting: Sphere | String, frame: int) -> None:
    """Write whether a prim is to be seen at a frame, where that changes at all."""
    if lasting.start > 0.0 or lasting.end is not None:
        seen = UsdGeom.Tokens.inherited if is_there(scene, lasting, frame) else UsdGeom.Tokens.invisible
        prim.CreateVisibilityAttr().Set(seen, frame)


SCHEMA = "PhysicsSurfaceDeformableMaterialAPI"


def bind_substance(prim: Usd.Prim, model: Model, number: int) -> None:
    """Give a balloon's prim a physics material of its own.

    It has rubber's and film's moduli and density, or those of the sheet that springs make, and the balloon's friction.
    """
    parameters = {name: values.numpy() for name, values in model.parameters.items()}
    substance, surface = substance_of(prim)
    substance.AddAppliedSchema(SCHEMA)
    if law_of(model.scene, number):
        surface.CreateDensityAttr(float(parameters["initial_density"][0, number]))
    if (friction := model.scene.balloon[number].friction) is not None:
        surface.CreateStaticFrictionAttr(friction)
        surface.CreateDynamicFrictionAttr(friction)
    for name, value in _moduli(model, parameters, number).items():
        substance.CreateAttribute(f"physics:{name}", Sdf.ValueTypeNames.Float, custom=False).Set(value)


def _moduli(model: Model, parameters: Mapping[str, NDArray[Any]], number: int) -> dict[str, float]:
    """Return the moduli by their names in the proposal, in SI, which is the stage's unit system."""
    if law := law_of(model.scene, number):
        return {"youngsModulus": youngs_modulus(law, parameters, number), "poissonsRatio": INCOMPRESSIBLE}
    sheet = sheet_of_springs(model.shapes[number], parameters, number)
    return {f"surface{name.title()}Stiffness": value for name, value in sheet._asdict().items()} if sheet else {}


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


def emission_input(material: UsdShade.Material) -> UsdShade.Input:
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


def define_latex_variant(material: UsdShade.Material, color: Color) -> None:
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


def check_textures(stage: Path, models: Iterable[Model | ModelPlan]) -> None:
    """Make sure, before any work is done, that `write_textures` can write.

    Raises:
        InputError: it cannot.
    """
    for picture in pictures_of(models):
        picture.check_beside(stage)


def write_textures(stage: Path, models: Iterable[Model | ModelPlan]) -> None:
    """Write the images that a stage names into the folder beside it.

    Args:
        models: those in the stage.

    Raises:
        InputError: one cannot be written.
    """
    for picture in pictures_of(models):
        picture.write_beside(stage)


def pictures_of(models: Iterable[Model | ModelPlan]) -> list[Picture]:
    """Return the images that are seen, by their names."""
    pictures = {}
    for model in models:
        scene, solids = model.scene, [*model.obstacles, *(body.solid for body in model.bodies)]
        meshes = [*(shape.mesh for shape in model.shapes), *(solid.mesh for solid in solids)]
        for mesh, said in zip(meshes, (*scene.balloon, *scene.obstacle, *scene.body), strict=True):
            if looks := looks_of_file(mesh, said):
                pictures |= {picture.name: picture for picture in looks.pictures}
    return [pictures[name] for name in sorted(pictures)]


def place_texture(prim: UsdGeom.Mesh, mesh: PolygonMesh) -> None:
    """Give a prim its mesh's texture coordinates, if it has some, as `primvars:st`."""
    if mesh.texture_coordinates is not None:
        kind, each_corner = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", kind, each_corner)
        st.Set(Vt.Vec2fArray.FromNumpy(mesh.texture_coordinates))


def paint_as_file(prim: UsdGeom.Mesh, mesh: PolygonMesh, looks: Looks, otherwise: Color, **finish: float) -> None:
    """Give a prim the looks of its mesh's file: display colors, and materials of one finish.

    Args:
        otherwise: the color of faces of which the file says none.
        finish: of the materials, as `define_material`.
    """
    of_faces = looks.of_corners[face_starts(mesh)]
    used = np.unique(of_faces).tolist()
    _set_display_colors(prim, mesh, looks, otherwise)
    for number in used:
        look = looks.materials[number] if number >= 0 else None
        name = None if len(used) == 1 else (look.name if look else "Other")
        color = look.color if look else otherwise
        material = define_material(prim, color, name=name, **finish)
        if look is not None and look.picture is not None:
            put_image(material, look.picture.path, look.color)
        elif look is None and looks.colors is not None:
            color_from(material, "displayColor", otherwise)
        if number == used[0]:
            bind(prim.GetPrim(), material)
        if len(used) > 1:
            faces = Vt.IntArray.FromNumpy(np.flatnonzero(of_faces == number).astype(np.int32))
            binding = UsdShade.MaterialBindingAPI(prim)
            own = material.GetPrim().GetName().removeprefix("_".join(prim.GetPath().pathString.split("/")[2:]) + "_")
            subset = binding.CreateMaterialBindSubset(own, faces)
            bind(subset.GetPrim(), material)
    if len(used) > 1:
        UsdShade.MaterialBindingAPI(prim).SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)


def _set_display_colors(prim: UsdGeom.Mesh, mesh: PolygonMesh, looks: Looks, otherwise: Color) -> None:
    """Write one display color, or one a face, or one a corner, whichever is the least."""
    colors = looks.color_at_corners(otherwise)
    firsts = colors[face_starts(mesh)]
    if (colors == colors[0]).all():
        prim.CreateDisplayColorAttr([Gf.Vec3f(*colors[0].tolist())])
        return
    by_face = bool((np.repeat(firsts, mesh.face_vertex_counts, axis=0) == colors).all())
    interpolation = UsdGeom.Tokens.uniform if by_face else UsdGeom.Tokens.faceVarying
    primvar = prim.CreateDisplayColorPrimvar(interpolation)
    primvar.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(firsts if by_face else colors)))
