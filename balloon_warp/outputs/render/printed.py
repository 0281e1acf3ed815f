"""Images on surfaces: what a material's texture is, and where on the mesh it goes."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import Ar, UsdGeom, UsdShade

from balloon_warp.errors import InputError
from balloon_warp.outputs.render.shutter import LINEAR

LARGEST = 2048
"""texels to a side: a larger image is made smaller"""
KINDS = {"PNG": "image/png", "JPEG": "image/jpeg"}
"""of images that glTF takes"""
UNREADABLE = (OSError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True)
class Print:
    """An image, and where each corner of a mesh's faces is in it."""

    texels: NDArray[np.float32]
    """linear RGB, rows from the top, shape (height, width, 3)"""
    places: NDArray[np.float32]
    """from 0 to 1 to the right and up, shape (corner_count, 2)"""


@dataclass(frozen=True)
class Texture:
    """What a material's image is, before it is read."""

    path: str
    """as USD resolves it"""
    raw: bool
    """whether its numbers are light as they are"""
    places: NDArray[np.float32]
    """as `Print` has them"""
    owner: str
    """path of the mesh's prim"""

    def load(self) -> bytes:
        """The file's content.

        Raises:
            InputError: there is no image in it.
        """
        resolver: Any = Ar.GetResolver()
        try:
            return bytes(resolver.OpenAsset(Ar.ResolvedPath(self.path)).GetBuffer())
        except AttributeError:
            raise self.unreadable() from None

    def unreadable(self) -> InputError:
        """What is said if there is no image in it."""
        return InputError(f"{self.owner}: its texture {self.path} cannot be read; expected an image")


def find_texture(mesh: UsdGeom.Mesh, surface: UsdShade.Shader | None, indices: NDArray[np.int32]) -> Texture | None:
    """What a material has for a mesh; None where it has no image, or the mesh no texture coordinates.

    Args:
        surface: the mesh's UsdPreviewSurface.
        indices: the mesh's points at the corners of its faces, shape (corner_count,).
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
    return None if places is None else Texture(file.resolvedPath, raw, places, str(mesh.GetPath()))


def read_print(mesh: UsdGeom.Mesh, surface: UsdShade.Shader | None, indices: NDArray[np.int32]) -> Print | None:
    """The image of `find_texture`, if there is one; arguments as it has them.

    Raises:
        InputError: the image cannot be read.
    """
    texture = find_texture(mesh, surface, indices)
    if texture is None:
        return None
    try:
        with _small(texture) as image:
            pixels = np.asarray(image.convert("RGB"))
    except UNREADABLE:
        raise texture.unreadable() from None
    return Print((pixels / np.float32(255.0) if texture.raw else LINEAR[pixels]).astype(np.float32), texture.places)


def packed_image(texture: Texture) -> tuple[bytes, str]:
    """An image as a file holds it that has others in it, and its kind: the very same, if it is PNG or JPEG and not too
    large, else PNG.

    Raises:
        InputError: it cannot be read.
    """
    data = texture.load()
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.format in KINDS and max(image.size) <= LARGEST:
                return data, KINDS[image.format]
        with _small(texture) as image, io.BytesIO() as packed:
            image.convert("RGB").save(packed, "PNG")
            return packed.getvalue(), KINDS["PNG"]
    except UNREADABLE:
        raise texture.unreadable() from None


def _small(texture: Texture) -> Image.Image:
    """No larger than `LARGEST`."""
    image = Image.open(io.BytesIO(texture.load()))
    image.thumbnail((LARGEST, LARGEST))
    return image


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
