"""Looks of a mesh's own file in the stage: a material for each of its own, bound to the faces that have it."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import face_starts
from balloon_warp.mesh.looks import Color, Looks, Picture
from balloon_warp.model import Model, ModelPlan
from balloon_warp.outputs.usd.material import bind, color_from, define_material, put_image
from balloon_warp.scene.colors import looks_of_file


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
