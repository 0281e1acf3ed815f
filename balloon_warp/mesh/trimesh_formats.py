"""Formats that trimesh reads as triangles: STL, PLY and OFF here, glTF in `gltf`."""

from io import BytesIO
from pathlib import Path

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.files import legible
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.polygon_mesh import PolygonMesh


def read_triangles(path: Path | str, joined: bool = False, source: BytesIO | None = None) -> PolygonMesh:
    """Read a mesh through trimesh: all of a scene's parts as one, in its world, polygons split into triangles.

    Vertices keep the file's order.

    Args:
        joined: make vertices at exactly the same place one.
        source: what to read in place of the file, with the files beside it.

    Raises:
        InputError: trimesh cannot read the file, or it has no triangles.
    """
    import trimesh  # only for such a file: it takes a second

    path = Path(path)
    try:
        # process=False: trimesh would merge and reorder vertices. Textures stay closed.
        read = trimesh.load_mesh(
            source or path,
            file_type=path.suffix[1:].lower(),
            resolver=trimesh.resolvers.FilePathResolver(str(path)),
            process=False,
            skip_materials=True,
        )
    except Exception as error:  # its readers let any exception of the parsing through
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({reason})") from error
    points, triangles = np.array(read.vertices, dtype=np.float64), np.array(read.faces, dtype=np.int64)
    if joined:
        kept, merged = np.unique(first_coincident(points), return_inverse=True)
        points, triangles = points[kept], merged[triangles]
    mesh = PolygonMesh(
        points=points.reshape(-1, 3),
        face_vertex_counts=np.full(len(triangles), 3, dtype=np.int32),
        face_vertex_indices=triangles.ravel().astype(np.int32),
        name=legible(path.stem),
    )
    check_mesh(mesh, str(path))
    return mesh


def read_joined_triangles(path: Path | str) -> PolygonMesh:
    """`read_triangles`, joined: STL repeats a vertex for each triangle. A balloon made of such vertices would fall
    apart."""
    return read_triangles(path, joined=True)


LOADERS = {
    ".stl": read_joined_triangles,
    ".ply": read_triangles,
    ".off": read_triangles,
}
