"""Look of a prim's faces, by the materials bound to it and to its subsets, or its display colors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.mesh.usd_surfaces import bound_surface, owners_of_faces
from balloon_warp.outputs.render.appearance import Finish, read_corner_colors, read_finish
from balloon_warp.outputs.render.printed import Texture, find_texture, mean_color


@dataclass(frozen=True)
class Cover:
    """A material of a drawn prim: its finish and its image."""

    name: str
    finish: Finish
    texture: Texture | None = None
    """Image in place of colors"""


@dataclass(frozen=True)
class Covering:
    """Materials of a drawn prim, and the one of each face."""

    covers: tuple[Cover, ...]
    of_faces: NDArray[np.int32]
    """Number of the material of each face, shape (face_count,)"""
    colors: NDArray[np.float32]
    """Linear RGB at each corner, shape (corner_count, 3)"""

    @property
    def places(self) -> NDArray[np.float32] | None:
        """Image coordinates of each corner, shape (corner_count, 2); None where there is no image."""
        return next((cover.texture.places for cover in self.covers if cover.texture), None)


def read_covering(
    mesh: UsdGeom.Mesh,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
    whole: NDArray[np.bool_],
) -> Covering:
    """Read the materials of a mesh.

    Args:
        whole: of which faces, shape (len(counts),).
    """
    prims, of_faces = owners_of_faces(mesh.GetPrim(), len(counts))
    of_corners = np.repeat(of_faces, counts)
    colors = np.zeros((len(indices), 3), np.float32)
    covers, places = [], np.zeros((len(indices), 2), np.float32)
    for number, prim in enumerate(prims):
        here, surface = of_corners == number, bound_surface(prim)
        if here.any():
            colors[here] = read_corner_colors(mesh, surface, counts, indices, point_count)[here]
        texture = find_texture(mesh, surface, indices) if here.any() else None
        if texture is not None:
            places[here] = texture.places[here]
        elif here.any() and (mean := mean_color(surface)) is not None:  # the mesh does not say how the image lies
            colors[here] = mean
        name = surface.GetPrim().GetParent().GetName() if surface and number else ""
        covers.append((name, read_finish(prim), texture))
    corners = np.repeat(whole, counts)
    shared = places[corners]
    made = (Cover(name, finish, texture and texture.at(shared)) for name, finish, texture in covers)
    return _of_used(tuple(made), of_faces[whole], colors[corners])


def plain_covering(prim: Usd.Prim, color: NDArray[np.float32], face_count: int, corner_count: int) -> Covering:
    """Return the covering of a prim of one color."""
    return Covering((Cover("", read_finish(prim)),), np.zeros(face_count, np.int32), np.tile(color, (corner_count, 1)))


def _of_used(covers: tuple[Cover, ...], of_faces: NDArray[np.int32], colors: NDArray[np.float32]) -> Covering:
    """Drop materials that no face has; the first stays where there is no face."""
    used, numbers = np.unique(of_faces, return_inverse=True)
    kept = used.tolist() or [0]
    return Covering(tuple(covers[number] for number in kept), numbers.ravel().astype(np.int32), colors)
