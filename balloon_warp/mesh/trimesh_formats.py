"""Formats that trimesh reads as triangles, STL, PLY and OFF, and their colors."""

import io
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import legible
from balloon_warp.mesh.check import Pictures, check_mesh
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.gltf_looks import COLORS, GltfMaterials, moved
from balloon_warp.mesh.polygon_mesh import Color, Look, Looks, PolygonMesh, linear, looks_of, together

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


def read_triangles(
    path: Path | str, joined: bool = False, source: BytesIO | None = None, materials: GltfMaterials | None = None
) -> PolygonMesh:
    """Read a mesh through trimesh: all of a scene's parts as one, in its world, polygons split into triangles.

    Vertices keep the file's order. Colors of vertices or faces go along.

    Args:
        joined: make vertices at exactly the same place one.
        source: content to read in place of the file's, with the files beside it.
        materials: of the file, whose numbers are their names in `source`.

    Raises:
        InputError: trimesh cannot read the file, or it has no triangles.
    """
    import trimesh  # only for such a file: it takes a second
    from trimesh.resolvers import FilePathResolver

    path = Path(path)
    try:
        # process=False: trimesh would merge and reorder vertices. Textures stay closed.
        read = trimesh.load_scene(
            source or path,
            file_type=path.suffix[1:].lower(),
            resolver=FilePathResolver(str(path)),
            process=False,
            skip_materials=materials is None,
        )
        parts = [part for part in map(_of_strips, read.dump()) if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # its readers let any exception of the parsing through
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({reason})") from error
    meshes = [_of_part(part, materials) for part in parts]
    points = np.concatenate([np.zeros((0, 3)), *(mesh.points for mesh in meshes)])
    begins = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])
    each = [mesh.face_vertex_indices.astype(np.int64) + begin for mesh, begin in zip(meshes, begins, strict=False)]
    corners = np.concatenate([np.zeros(0, np.int64), *each])
    if joined:
        kept, merged = np.unique(first_coincident(points), return_inverse=True)
        points, corners = points[kept], merged[corners]
    mesh = PolygonMesh(
        points=points,
        face_vertex_counts=np.full(len(corners) // 3, 3, dtype=np.int32),
        face_vertex_indices=corners.astype(np.int32),
        name=legible(path.stem),
        **(together(meshes) if meshes else {}),
    )
    check_mesh(mesh, str(path))
    return mesh


def _of_strips(part: Any) -> Any:
    """Return the triangles of a part that trimesh takes for points, as a PLY file of a scanner may have strips of them.

    Any other part is returned as it is.
    """
    import trimesh

    strips = part.metadata.get("_ply_raw", {}).get("tristrips")
    if not isinstance(part, trimesh.PointCloud) or not strips:
        return part
    said = strips["data"]["vertex_indices"]
    numbers = np.asarray(said["f1"] if said.dtype.names else said, np.int64).ravel()
    triangles = np.lib.stride_tricks.sliding_window_view(numbers, 3).copy()
    begins = np.append(0, np.flatnonzero(numbers < 0) + 1)  # a strip ends with -1
    places = np.arange(len(triangles))
    odd = (places - begins[np.searchsorted(begins, places, side="right") - 1]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]  # every other one of a strip is wound the other way
    triangles = triangles[(triangles >= 0).all(axis=1)]
    colors = part.colors if len(part.colors) else None
    return trimesh.Trimesh(part.vertices, triangles, vertex_colors=colors, process=False)


def _of_part(part: Any, materials: GltfMaterials | None) -> PolygonMesh:
    """Return a part of a scene of trimesh's, with its looks."""
    points, triangles = np.array(part.vertices, dtype=np.float64), np.array(part.faces, dtype=np.int64)
    corners, visual = triangles.ravel(), part.visual
    shape = {"points": points.reshape(-1, 3), "face_vertex_counts": np.full(len(triangles), 3, dtype=np.int32)}
    mesh = PolygonMesh(**shape, face_vertex_indices=corners.astype(np.int32))
    of_corners, known, places = np.full(len(corners), -1), [], None
    if visual.kind == "texture" and materials is not None:
        number = int(visual.material.name)
        of_corners[:], known = number, materials.looks
        if visual.uv is not None and len(visual.uv) == len(points):
            places = moved(np.asarray(visual.uv, np.float64)[corners], materials.transforms[number])
    if COLORS in part.vertex_attributes:
        shades = np.asarray(part.vertex_attributes[COLORS])[corners]
    else:
        shades = corner_colors(mesh, visual)
    if shades is not None:
        shades = _lightness(shades, encoded=materials is None)
    if places is None or not np.isfinite(places).all():
        places = None
        if materials is not None and known:
            known = [materials.unplaced(each) if each == of_corners[0] else None for each in range(len(known))]
    return replace(mesh, texture_coordinates=places, looks=looks_of(known, of_corners, shades))


def _lightness(colors: NDArray, encoded: bool) -> NDArray[np.float32]:
    """Return the linear RGB of colors in any type of numbers.

    Args:
        encoded: whether they are sRGB, as all but glTF has them.
    """
    most = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    shares = colors[:, :3].astype(np.float64) / most
    return linear(shares) if encoded else np.clip(shares, 0.0, 1.0).astype(np.float32)


def read_joined_triangles(path: Path | str) -> PolygonMesh:
    """Read triangles as `read_triangles`, and weld them: STL repeats a vertex for each triangle.

    A balloon made of such vertices would fall apart.
    """
    return read_triangles(path, joined=True)


LOADERS = {
    ".stl": read_joined_triangles,
    ".ply": read_triangles,
    ".off": read_triangles,
}
