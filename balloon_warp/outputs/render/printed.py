"""Images on surfaces: a material's texture, and its places on the mesh."""

import io
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import UsdGeom, UsdShade

from balloon_warp.errors import InputError
from balloon_warp.mesh.pictures import Pictures
from balloon_warp.mesh.usd_surfaces import content_of, image_of, places_of
from balloon_warp.outputs.render.shutter import LINEAR

LARGEST = 2048
"""Largest side of an image [texels]: a larger one is scaled down"""
KINDS = {"PNG": "image/png", "JPEG": "image/jpeg"}
"""Kinds of images that glTF takes"""
UNREADABLE = (OSError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True)
class Texture:
    """Image of a material, before it is read."""

    path: str
    """Path as USD resolves it"""
    raw: bool
    """Whether its numbers are linear light"""
    tint: tuple[float, float, float]
    """Factor on its linear RGB"""
    places: NDArray[np.float32]
    """Texture coordinates of each corner of a mesh's faces, from 0 to 1 to the right and up, shape (corner_count, 2)"""
    owner: str
    """Path of the mesh's prim"""

    def at(self, places: NDArray[np.float32]) -> "Texture":
        """Return the image with other places."""
        return replace(self, places=places)

    def load(self) -> bytes:
        """Return the file's content.

        Raises:
            InputError: there is no image in it.
        """
        data = content_of(self.path)
        if data is None:
            raise self.unreadable()
        return data

    def unreadable(self) -> InputError:
        """Return the error for a file without a readable image."""
        return InputError(f"{self.owner}: its texture {self.path} cannot be read; expected an image")


def find_texture(mesh: UsdGeom.Mesh, surface: UsdShade.Shader | None, indices: NDArray[np.int32]) -> Texture | None:
    """Return the texture of a material for a mesh, or None.

    There is none without an image, or without texture coordinates of the mesh.

    Args:
        surface: A UsdPreviewSurface.
        indices: Points of the mesh at the corners of its faces, shape (corner_count,).
    """
    image = image_of(surface)
    places = places_of(mesh, image, indices) if image and image.path else None
    if image is None or places is None:
        return None
    return Texture(image.path, image.raw, image.scale, places, str(mesh.GetPath()))


def mean_color(surface: UsdShade.Shader | None) -> NDArray[np.float64] | None:
    """Return the mean linear RGB of a material's image, shape (3,); None without one that can be read."""
    image = image_of(surface)
    data = content_of(image.path) if image and image.path else None
    picture = Pictures(image.path).of_bytes(image.named, data) if image and data else None
    return np.multiply(picture.mean, image.scale) if image and picture else None


def read_texels(texture: Texture) -> NDArray[np.float32]:
    """Return the linear RGB, rows from the top, shape (height, width, 3).

    Raises:
        InputError: the image cannot be read.
    """
    try:
        with _small(texture) as image:
            pixels = np.asarray(image.convert("RGB"))
    except UNREADABLE:
        raise texture.unreadable() from None
    light = pixels / np.float32(255.0) if texture.raw else LINEAR[pixels]
    return (light * np.array(texture.tint)).astype(np.float32)


def packed_image(texture: Texture) -> tuple[bytes, str]:
    """Return an image as a file's bytes for embedding, and its kind.

    It is unchanged if it is PNG or JPEG and not too large, else PNG.

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
    """Return an image no larger than `LARGEST`."""
    image = Image.open(io.BytesIO(texture.load()))
    image.thumbnail((LARGEST, LARGEST))
    return image
