"""Formats that trimesh reads as triangles: STL, PLY and OFF here, glTF in `gltf`."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import legible
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.gltf_looks import COLORS, GltfMaterials, moved
from balloon_warp.mesh.looks import linear, looks_of, together
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.trimesh_looks import corner_colors


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
        parts = [part for part in read.dump() if isinstance(part, trimesh.Trimesh)]
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
