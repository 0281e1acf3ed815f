"""Images on surfaces: what a material's texture is, and where on the mesh it goes."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import Ar, Usd, UsdGeom, UsdShade

from balloon_warp.errors import InputError
from balloon_warp.outputs.render.shutter import LINEAR

LARGEST = 2048
"""texels to a side: a larger image is made smaller"""


@dataclass(frozen=True)
class Print:
    """An image, and where each corner of a mesh's faces is in it."""

    texels: NDArray[np.float32]
    """linear RGB, rows from the top, shape (height, width, 3)"""
    places: NDArray[np.float32]
    """from 0 to 1 to the right and up, shape (corner_count, 2)"""


def read_print(mesh: UsdGeom.Mesh, surface: UsdShade.Shader | None, indices: NDArray[np.int32]) -> Print | None:
    """What a material's image has for a mesh; None where it has no image, or the mesh no texture coordinates.

    Args:
        surface: the mesh's UsdPreviewSurface.
        indices: the mesh's points at the corners of its faces, shape (corner_count,).

    Raises:
        InputError: the image cannot be read.
    """
    texture = _feeding(surface, "diffuseColor", "UsdUVTexture")
    file = texture.GetInput("file").Get() if texture and texture.GetInput("file") else None
    if not texture or not file or not file.resolvedPath:
        return None
    reader = _feeding(texture, "st", "UsdPrimvarReader_float2")
    name = reader.GetInput("varname").Get() if reader and reader.GetInput("varname") else None
    places = _places(mesh, str(name or "st"), indices)
    space = texture.GetInput("sourceColorSpace")
    raw = bool(space) and space.Get() == "raw"
    return None if places is None else Print(_texels(file.resolvedPath, raw, mesh.GetPrim()), places)


def _feeding(shader: UsdShade.Shader | None, name: str, kind: str) -> UsdShade.Shader | None:
    """The shader of a kind that an input is connected to."""
    given = shader.GetInput(name) if shader else None
    for attribute in given.GetValueProducingAttributes() if given else []:
        source = UsdShade.Shader(attribute.GetPrim())
        if source and source.GetIdAttr().Get() == kind:
            return source
    return None


def _places(mesh: UsdGeom.Mesh, name: str, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """Texture coordinates of a name, at each corner."""
    primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
    authored: Any = primvar.ComputeFlattened() if primvar else None
    places = np.asarray([] if authored is None else authored, np.float32).reshape(-1, 2)
    if not len(places) or not np.isfinite(places).all():
        return None
    if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying:
        return places if len(places) == len(indices) else None
    return places[indices] if len(places) > indices.max(initial=-1) else None


def _texels(path: str, raw: bool, prim: Usd.Prim) -> NDArray[np.float32]:
    try:
        resolver: Any = Ar.GetResolver()
        asset = resolver.OpenAsset(Ar.ResolvedPath(path))
        with Image.open(io.BytesIO(bytes(asset.GetBuffer()))) as image:
            image.thumbnail((LARGEST, LARGEST))
            pixels = np.asarray(image.convert("RGB"))
    except (OSError, ValueError, AttributeError, Image.DecompressionBombError):
        raise InputError(f"{prim.GetPath()}: its texture {path} cannot be read; expected an image") from None
    return (pixels / np.float32(255.0) if raw else LINEAR[pixels]).astype(np.float32)
