"""Images on balloons in the page. viser's meshes have no texture coordinates, so page_files/look.js puts images on.

For that, two things that nobody sees hang below a balloon's node: the image, and a mesh of places. Each of its points
is (right, up, twin) for a point of the balloon: where it is in the image, and the first point at the same place.
"""

import io
from pathlib import Path
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Balloon
from balloon_warp.scene.colors import looks_of_file
from balloon_warp.viewer.smooth import Plain, Smooth

LARGEST = 1024
"""Largest side of an image [texels]: a larger one is scaled down"""


class Printed:
    """A surface, cut along the seams of an image: each of its points has one place there.

    Args:
        surface: of a balloon.
        mesh: of the same balloon, with texture coordinates.
    """

    def __init__(self, surface: Plain | Smooth, mesh: PolygonMesh):
        corners = surface.spread(np.asarray(mesh.texture_coordinates, dtype=np.float64)).reshape(-1, 2)
        keys = np.column_stack([surface.triangles.reshape(-1), corners])
        kept, numbers = np.unique(keys, axis=0, return_inverse=True)
        self._surface, self._points = surface, kept[:, 0].astype(np.int64)
        _, firsts, points = np.unique(self._points, return_index=True, return_inverse=True)
        self.triangles = numbers.reshape(-1, 3)
        """Triangles, shape (n, 3)"""
        self.triangle_faces = surface.triangle_faces
        """Face of the mesh of each triangle, shape (n,)"""
        self.places = np.column_stack([kept[:, 1:], firsts[points]]).astype(np.float32)
        """Texture coordinates to the right and up, and twin of each point, shape (n, 3)"""

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the surface from those of the mesh; shape (n, 3)."""
        return self._surface.points(points)[self._points]


def only_picture(mesh: PolygonMesh, said: Balloon) -> io.BytesIO | None:
    """Return the image of a mesh's file, where it is on all of its faces and the scene says no color."""
    looks = looks_of_file(mesh, said)
    if looks is None or len(looks.pictures) != len(looks.materials) or len(looks.materials) != 1:
        return None
    return io.BytesIO(looks.pictures[0].data) if (looks.of_corners == 0).all() else None


def image_of(file: Path | io.BytesIO | None) -> NDArray[np.uint8] | None:
    """Return a print as the page gets it, shape (height, width, 3); None where there is none, or it cannot be read."""
    if file is None:
        return None
    try:
        with Image.open(file) as image:
            image.thumbnail((LARGEST, LARGEST))
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def hang(scene: viser.SceneApi, balloon: str, surface: Printed, image: NDArray[np.uint8]) -> list[Any]:
    """Add a print below a balloon's node, too small to be hit by a pointer.

    Args:
        balloon: Name of its node.
    """
    nothing = np.zeros((1, 3), np.uint32)
    return [
        scene.add_mesh_simple(f"{balloon}/places", surface.places, nothing, cast_shadow=False, visible=False),
        scene.add_image(f"{balloon}/print", image, 1e-9, 1e-9, format="png", cast_shadow=False, visible=False),
    ]
