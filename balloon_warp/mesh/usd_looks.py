"""Materials, base colors and textures of a mesh of a USD stage."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Gf, Usd, UsdGeom, UsdShade

from balloon_warp.mesh.check import Pictures
from balloon_warp.mesh.polygon_mesh import Color, Look, Looks, Picture, looks_of


def bound_surface(prim: Usd.Prim) -> UsdShade.Shader | None:
    """Return the UsdPreviewSurface of a prim's material."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    return shader if shader and shader.GetIdAttr().Get() == "UsdPreviewSurface" else None


def constant_of(surface: UsdShade.Shader, name: str) -> Any:
    """Return the value of an input, through connections to the material's own inputs; None where a texture feeds it."""
    shader_input = surface.GetInput(name)
    for attribute in shader_input.GetValueProducingAttributes() if shader_input else []:
        if UsdShade.Utils.GetType(attribute.GetName()) != UsdShade.AttributeType.Output:
            return attribute.Get()
    return None


def owners_of_faces(prim: Usd.Prim, face_count: int) -> tuple[list[Usd.Prim], NDArray[np.int32]]:
    """Return the prims with the looks of faces, and the number of each face's prim, shape (face_count,).

    They are the mesh and then its subsets that have a material.
    """
    owners, numbers = [prim], np.zeros(face_count, np.int32)
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if UsdGeom.Mesh(prim) else []:
        faces = np.asarray(subset.GetIndicesAttr().Get() or (), np.int64)
        numbers[faces[(faces >= 0) & (faces < face_count)]] = len(owners)
        owners.append(subset.GetPrim())
    return owners, numbers


class Image(NamedTuple):
    """A texture that gives a surface its color."""

    named: str
    """Path as the stage names it"""
    path: str
    """Path as USD resolves it; empty where it is missing"""
    raw: bool
    """Whether its numbers are linear light"""
    scale: tuple[float, float, float]
    """Factor on its numbers"""
    coordinates: str
    """Primvar with the texture coordinates"""
    transform: NDArray[np.float64]
    """Transform of texture coordinates: rows of a matrix, shape (2, 3)"""


def image_of(surface: UsdShade.Shader | None) -> Image | None:
    """Return the texture that feeds a surface's color, if one does."""
    texture = _feeding(surface, "diffuseColor", "UsdUVTexture")
    file = constant_of(texture, "file") if texture else None
    if texture is None or not file or not file.path:
        return None
    transform, reader = np.eye(3)[:2], _feeding(texture, "st", "UsdPrimvarReader_float2")
    if placed := _feeding(texture, "st", "UsdTransform2d"):
        reader, transform = _feeding(placed, "in", "UsdPrimvarReader_float2"), _transform(placed)
    name = constant_of(reader, "varname") if reader else None
    scale = constant_of(texture, "scale")
    red, green, blue, _ = np.array(Gf.Vec4f(1.0) if scale is None else scale, np.float64).tolist()
    raw = constant_of(texture, "sourceColorSpace") == "raw"
    return Image(file.path, file.resolvedPath, raw, (red, green, blue), str(name or "st"), transform)


def missing_image(prim: Usd.Prim) -> str:
    """Return the file that a texture's prim names if it is not there, else nothing."""
    shader = UsdShade.Shader(prim)
    file = constant_of(shader, "file") if shader and shader.GetIdAttr().Get() == "UsdUVTexture" else None
    return file.path if file and not file.resolvedPath else ""


def content_of(path: str) -> bytes | None:
    """Return the content of a file that USD has resolved, such as one in a package; None if it cannot be read."""
    resolver: Any = Ar.GetResolver()
    try:
        return bytes(resolver.OpenAsset(Ar.ResolvedPath(path)).GetBuffer())
    except AttributeError:  # USD hands out nothing
        return None


def places_of(mesh: UsdGeom.Mesh, image: Image, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """Return the place of each corner in an image, from 0 to 1 to the right and up, shape (corner_count, 2).

    The mesh's only texture coordinates count under any name. None where it does not say it.
    """
    places = texture_coordinates(mesh, image.coordinates, indices)
    if places is None:
        named = [each.GetPrimvarName() for each in UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance()]
        others = [other for name in named if (other := texture_coordinates(mesh, name, indices)) is not None]
        places = others[0] if len(others) == 1 else None
    if places is None or np.array_equal(image.transform, np.eye(3)[:2]):
        return places
    whole = np.column_stack([places, np.ones(len(places))])
    return (whole @ image.transform.T).astype(np.float32)


def texture_coordinates(mesh: UsdGeom.Mesh, name: str, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """Return the texture coordinates of a name at each corner, shape (corner_count, 2).

    None without them, or where they do not fit the mesh.
    """
    primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
    authored: Any = primvar.ComputeFlattened() if primvar and primvar.HasValue() else None
    places = np.asarray([] if authored is None else authored, np.float32)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        return None
    if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying:
        return places if len(places) == len(indices) else None
    of_points = primvar.GetInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
    return places[indices] if of_points and len(places) > indices.max(initial=-1) else None


def display_colors(gprim: UsdGeom.Gprim) -> tuple[NDArray[np.float32], str]:
    """Return display colors, shape (n, 3), and their interpolation."""
    display = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance("displayColor")
    authored: Any = display.ComputeFlattened() if display else None
    colors = np.asarray([] if authored is None else authored, np.float32).reshape(-1, 3)
    return colors, display.GetInterpolation() if display else UsdGeom.Tokens.constant


def at_corners(
    colors: NDArray[np.float32],
    interpolation: str,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
) -> NDArray[np.float32] | None:
    """Display colors at each corner of a mesh's faces, shape (len(indices), 3); None where they are one color, or none.

    They are laid out as their interpolation says; where their number is another's, as that one has it.
    """
    places = {
        UsdGeom.Tokens.faceVarying: (len(indices), np.arange(len(indices))),
        UsdGeom.Tokens.vertex: (point_count, indices),
        UsdGeom.Tokens.varying: (point_count, indices),
        UsdGeom.Tokens.uniform: (len(counts), np.repeat(np.arange(len(counts)), counts)),
    }
    if len(colors) > 1:
        for name in (interpolation, *places):
            if name in places and places[name][0] == len(colors):
                return colors[places[name][1]]
    return None


def _feeding(shader: UsdShade.Shader | None, name: str, kind: str) -> UsdShade.Shader | None:
    """Return the shader of a kind that an input is connected to."""
    given = shader.GetInput(name) if shader else None
    for attribute in given.GetValueProducingAttributes() if given else []:
        source = UsdShade.Shader(attribute.GetPrim())
        if source and source.GetIdAttr().Get() == kind:
            return source
    return None


def _transform(shader: UsdShade.Shader) -> NDArray[np.float64]:
    """Return the matrix of a UsdTransform2d: scaled, then turned, then moved."""
    scale, turn, move = (constant_of(shader, name) for name in ("scale", "rotation", "translation"))
    wide, high = (1.0, 1.0) if scale is None else scale
    x, y = (0.0, 0.0) if move is None else move
    angle = np.radians(turn or 0.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * wide, -s * high, x], [s * wide, c * high, y]])


class Seen(NamedTuple):
    """Looks and texture coordinates that were read of a mesh."""

    texture_coordinates: NDArray[np.float32] | None
    looks: Looks | None


def read_looks(
    geometry: UsdGeom.Mesh, counts: NDArray[np.int32], indices: NDArray[np.int32], pictures: Pictures
) -> Seen:
    """Read the looks of a mesh from the materials bound to it and to its subsets, else from its display colors."""
    prim = geometry.GetPrim()
    owners, of_faces = owners_of_faces(prim, len(counts))
    of_corners = np.repeat(of_faces, counts)
    places = texture_coordinates(geometry, "st", indices)
    looks: list[Look | None] = []
    for number, owner in enumerate(owners):
        surface = bound_surface(owner)
        image = image_of(surface)
        here = of_corners == number
        own = places_of(geometry, image, indices) if image else None
        picture = _read(image, pictures) if image and here.any() else None
        name = surface.GetPrim().GetParent().GetName() if surface else owner.GetName()
        if image and picture:
            look = Look(name, image.scale, picture)
            if own is None:
                look = pictures.mean_of(look, f"{image.named} of {prim.GetPath()}")
            else:
                places = np.zeros((len(indices), 2), np.float32) if places is None else places
                places = np.where(here[:, None], own, places)
            looks.append(look)
        else:
            color = constant_of(surface, "diffuseColor") if surface and _is_said(surface) else None
            looks.append(None if color is None else Look(name, _color(color)))
    return Seen(places, _with_display_colors(geometry, looks, counts, indices, of_corners))


def _with_display_colors(
    geometry: UsdGeom.Mesh,
    looks: list[Look | None],
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    of_corners: NDArray[np.int32],
) -> Looks | None:
    """Add display colors where no material says a color."""
    silent = np.array([look is None for look in looks])[of_corners]
    colors, interpolation = display_colors(geometry)
    if not silent.any() or not len(colors) or not np.isfinite(colors).all():
        return looks_of(looks, of_corners)
    points: Any = geometry.GetPointsAttr().Get() or geometry.GetPointsAttr().Get(Usd.TimeCode.EarliestTime())
    shades = at_corners(colors, interpolation, counts, indices, len(points))
    if shades is None:
        one = Look("displayColor", _color(colors.mean(axis=0)))
        return looks_of([*looks, one], np.where(silent, len(looks), of_corners))
    materials = looks_of(looks, of_corners)
    said = Looks((), np.full(len(indices), -1, np.int32)) if materials is None else materials
    return Looks(said.materials, said.of_corners, shades)


def _is_said(surface: Any) -> bool:
    given = surface.GetInput("diffuseColor")
    return bool(given) and (given.GetAttr().HasAuthoredValue() or given.HasConnectedSource())


def _color(value: Any) -> Color:
    red, green, blue = np.clip(np.asarray(value, np.float64), 0.0, 1.0).tolist()
    return red, green, blue


def _read(image: Image, pictures: Pictures) -> Picture | None:
    """Read an image from the package that it is in, or from its file."""
    if not image.path:
        return pictures.of_bytes(image.named, None)
    return pictures.of_bytes(image.named, content_of(image.path) or b"", Path(image.path))
