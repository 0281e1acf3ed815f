"""Looks of a mesh in trimesh: colors of vertices and faces, and a material with an image."""

import io
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.looks import Color, Look, Looks, linear, looks_of
from balloon_warp.mesh.pictures import Pictures
from balloon_warp.mesh.polygon_mesh import PolygonMesh

PLAIN = (102, 102, 102, 255)
"""Color of a material of trimesh's without one"""


class Visual(NamedTuple):
    """Texture coordinates and looks, as fields of a `PolygonMesh`."""

    texture_coordinates: NDArray[np.float32] | None
    looks: Looks | None


def read_visual(mesh: PolygonMesh, visual: Any) -> Visual:
    """Read the looks of a mesh from Python; nothing where its `visual` is none of trimesh's."""
    kind, corners = getattr(visual, "kind", None), np.asarray(mesh.face_vertex_indices)
    if not len(corners) or corners.min() < 0 or corners.max() >= mesh.vertex_count:
        return Visual(None, None)  # of a mesh that is refused
    if kind == "texture":
        uv = np.asarray([] if visual.uv is None else visual.uv, np.float64)
        placed = uv.shape == (mesh.vertex_count, 2) and bool(np.isfinite(uv).all())
        look = _look(visual.material, placed, mesh.name)
        looks = looks_of([look], np.zeros(len(corners), np.int32))
        return Visual(uv[corners].astype(np.float32) if placed else None, looks)
    colors = corner_colors(mesh, visual)
    shades = None if colors is None else linear(colors[:, :3] / 255.0)
    return Visual(None, looks_of([], np.full(len(corners), -1, np.int32), shades))


def corner_colors(mesh: PolygonMesh, visual: Any) -> NDArray[np.uint8] | None:
    """Return colors of vertices or faces at all corners, in bytes; None where there are none."""
    kind = getattr(visual, "kind", None)
    if kind == "vertex" and len(visual.vertex_colors) == mesh.vertex_count:
        return np.asarray(visual.vertex_colors)[mesh.face_vertex_indices]
    if kind == "face" and len(visual.face_colors) == mesh.face_count:
        return np.repeat(np.asarray(visual.face_colors), mesh.face_vertex_counts, axis=0)
    return None


def _look(material: Any, placed: bool, name: str) -> Look | None:
    physical = hasattr(material, "baseColorFactor")
    image = getattr(material, "baseColorTexture" if physical else "image", None)
    said = getattr(material, "baseColorFactor" if physical else "diffuse", None)
    color: Color = (1.0, 1.0, 1.0)
    if said is not None and (physical or image is None):
        shares = np.asarray(said, np.float64)[:3] / 255.0
        red, green, blue = (shares if physical else linear(shares)).tolist()
        color = red, green, blue
    if image is not None:
        with io.BytesIO() as file:
            image.convert("RGB").save(file, "PNG")
            look = Look("material", color, Pictures(name).of_bytes(name, file.getvalue()))
            return look if placed else look.plain
    return None if said is None or tuple(said) == PLAIN else Look("material", color)
