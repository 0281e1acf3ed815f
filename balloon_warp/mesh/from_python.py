"""Meshes that are no files: Python objects of a mesh, as a `PolygonMesh`."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.trimesh_looks import read_visual


class Faceted(Protocol):
    """A mesh of another library's, such as a trimesh.Trimesh."""

    @property
    def vertices(self) -> Any:
        """Points, shape (n, 3)."""

    @property
    def faces(self) -> Any:
        """Lists of corners that index points from 0."""


MeshLike = TypeAliasType("MeshLike", PolygonMesh | Faceted | tuple[ArrayLike, Any])
"""Mesh of this package or another; or points and faces, as in `Faceted`"""


def is_mesh(given: object) -> bool:
    """Return whether a Python value is a mesh; its numbers may be wrong."""
    is_pair = isinstance(given, tuple | list) and len(given) == 2 and not isinstance(given[0], str)
    return is_pair or isinstance(given, PolygonMesh) or hasattr(given, "faces") or hasattr(given, "to_mesh")


def mesh_from(given: Any) -> PolygonMesh:
    """Make a mesh of a `MeshLike`, or of a scene of trimesh's, whose parts become one.

    Its numbers are not checked; `check_mesh` does that.

    Raises:
        InputError: it is none; the message begins with the part that is wrong.
    """
    if not is_mesh(given):
        kinds = "a file, a PolygonMesh, a trimesh.Trimesh, or a pair of points and faces"
        raise InputError(f"mesh: must be {kinds} (got {type(given).__name__})")
    if isinstance(given, PolygonMesh):
        return given
    if isinstance(given, tuple | list):
        points, faces = given
        return _of_arrays(points, faces, "mesh")
    if hasattr(given, "to_mesh"):
        given = given.to_mesh()
    mesh = _of_arrays(given.vertices, given.faces, _name_of(given))
    return replace(mesh, **read_visual(mesh, getattr(given, "visual", None))._asdict())


def _of_arrays(points: Any, faces: Any, name: str) -> PolygonMesh:
    counts, indices = _corners(faces)
    return PolygonMesh(_points(points), counts, indices, name)


def _points(given: Any) -> NDArray[np.float64]:
    try:
        points = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("points: must be numbers, shape (n, 3)") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: must have shape (n, 3) (got {points.shape})")
    return points


def _corners(given: Any) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the number of corners of each face, and all corners, one face after the other."""
    try:
        faces = [np.asarray(face) for face in given]
    except TypeError:
        raise InputError(f"faces: must be lists of point numbers (got {type(given).__name__})") from None
    for number, face in enumerate(faces):
        if face.ndim != 1 or not np.issubdtype(face.dtype, np.integer):
            found = str(face.tolist())[:60]
            raise InputError(f"faces: face {number} must be point numbers, counted from 0 (got {found})")
    counts = np.array([len(face) for face in faces], dtype=np.int32)
    indices = np.concatenate([np.zeros(0, dtype=np.int64), *faces])
    if len(indices) and not np.array_equal(indices, indices.astype(np.int32)):
        raise InputError(f"faces: point numbers must fit in 32 bits (got {indices.max()})")
    return counts, indices.astype(np.int32)


def _name_of(given: Any) -> str:
    """Return the name of the mesh's file, where there is one."""
    known = getattr(given, "metadata", None) or {}
    return str(known.get("name") or Path(str(known.get("file_name") or "mesh")).stem)
