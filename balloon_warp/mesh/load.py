"""Loading of meshes: a file, by its suffix, or a mesh-like value of Python; unit, axes and welding.

Each format lists its suffixes and readers in its own file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError, did_you_mean_file
from balloon_warp.mesh import gltf, obj, usd
from balloon_warp.mesh.crossings import Taken, check_mesh, of_vertices, parts_taken
from balloon_warp.mesh.gltf import read_visual
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import describe_defects, repaired
from balloon_warp.mesh.seams import counted_once, open_seam, welded, welded_along_seams
from balloon_warp.system.arguments import checked
from balloon_warp.system.files import check_regular, file_behind, legible


def place_mesh(
    mesh: PolygonMesh,
    up_axis: str,
    scale: float = 1.0,
    rotation: Sequence[float] = (0.0, 0.0, 0.0),
    position: Sequence[float] = (0.0, 0.0, 0.0),
) -> PolygonMesh:
    """Return the mesh in meters, turned to the up axis ("Y" or "Z"), then scaled, rotated and moved.

    Args:
        rotation: about x, then y, then z [degrees].
        position: where the mesh's origin goes [m].
    """
    points = mesh.points * (mesh.meters_per_unit * scale)
    if mesh.up_axis != up_axis:
        points = points @ axes_matrix(mesh.up_axis, up_axis).T
    for axis, degrees in enumerate(rotation):
        points = points @ _rotation(axis, degrees).T
    return replace(mesh, points=points + np.array(position), up_axis=up_axis, meters_per_unit=1.0)


def axes_matrix(mesh_up: str, up_axis: str) -> NDArray[np.float64]:
    """Return the matrix that turns one up axis, "Y" or "Z", to another."""
    if mesh_up == up_axis:
        return np.eye(3)
    return _rotation(0, 90.0 if up_axis == "Z" else -90.0)


def rotation_matrix(rotation: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of a rotation about x, then y, then z [degrees], which takes a column to where it is then."""
    about_x, about_y, about_z = (_rotation(axis, float(degrees)) for axis, degrees in enumerate(rotation))
    return about_z @ about_y @ about_x


def in_y_up_meters(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh in meters, y up, which is how an OBJ file is taken. To the last bit: axes change places."""
    points = mesh.points * mesh.meters_per_unit
    if mesh.up_axis == "Z":
        points = points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return replace(mesh, points=points, up_axis="Y", meters_per_unit=1.0)


def _rotation(axis: int, degrees: float) -> NDArray[np.float64]:
    """Return the matrix of a right-handed rotation about a coordinate axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


Weld = bool | Literal["auto"] | float
Holes = Literal["cap", "keep"]
Parts = Literal["held", "free"]
LEAST_GAP, LARGEST_GAP = 1e-6, 0.1
"""Range of a weldable gap over the mesh's size"""


@dataclass(frozen=True)
class Treatment:
    """Treatment of a mesh's seams, holes and parts, as the scene's balloon gives it in fields of these names."""

    weld: Weld = "auto"
    """Weld open edges that coincide up to rounding, or up to a gap over the mesh's size; or all vertices that coincide
    exactly; or none"""
    holes: Holes = "cap"
    """Close holes in the surface, or keep them"""
    parts: Parts = "held"
    """Hold components together, or leave them free"""
    taken: Taken = "all"
    """Parts to take: all, those without a border, or the largest by area"""


def prepared(mesh: PolygonMesh, source: object, treatment: Treatment) -> PolygonMesh:
    """Return the mesh as it is simulated, with warnings of its defects and their treatment.

    Vertices keep their numbers; the springs that hold its parts are made later.

    A mesh of edges alone, faces of two corners, is a net of springs: it stays as it is.

    Raises:
        InputError: no face is left, or no part of those that are to be taken; it names `source`.
    """
    if mesh.face_count and mesh.face_vertex_counts.max() == 2:
        return mesh
    mesh = counted_once(mesh)
    if treatment.weld is True:
        mesh = welded(mesh)
    elif treatment.weld:
        mesh = welded_along_seams(mesh, 0.0 if treatment.weld == "auto" else treatment.weld)
    whole = repaired(mesh, source, treatment.holes)
    kept, left_out = parts_taken(whole, treatment.taken, source)
    whole, mesh = of_vertices(whole, kept), of_vertices(mesh, kept)
    seam = open_seam(mesh) if treatment.weld is not False else None
    told = [str(each) for each in (left_out, seam) if each]
    said = describe_defects(mesh, whole, treatment.parts, np.flatnonzero(~kept))
    return replace(whole, warnings=(*whole.warnings, *told, *said))


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


BY_NAME = obj.LOADERS | gltf.LOADERS
"""Readers of files that name their objects"""
LOADERS = obj.LOADERS | usd.LOADERS | gltf.TRIANGLE_LOADERS | gltf.LOADERS


@checked
def load_mesh(source: Path | str | MeshLike, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read a mesh as it is: polygons from OBJ and USD, triangles from STL, PLY, OFF, glTF and GLB.

    Args:
        source: a file; or a PolygonMesh, a trimesh.Trimesh, or points of shape (n, 3) [m] and faces, each a list of
            points' numbers from 0.
        prim: of a USD stage, the path of a mesh, or of a prim with meshes below it; of an OBJ file, the name of an
            object or a group; of a glTF file, the name of a node or a mesh; or several. All that it shows when missing.

    Raises:
        InputError: there is no such file, its suffix is none of these, its content is wrong, or it has no such prim.
    """
    if not isinstance(source, str | Path):
        if prim is not None:
            raise InputError(f"prim {prim}: selects an object of a file; expected a file")
        mesh = mesh_from(source)
        check_mesh(mesh, mesh.name)
        return mesh
    path = Path(source)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a mesh file")
    suffix = path.suffix.lower()
    if suffix not in LOADERS:
        raise InputError(f"{path}: expected a mesh file ({' '.join(LOADERS)}), got suffix {suffix or 'none'}")
    if not path.exists():
        raise InputError(f"{path}: no such file{did_you_mean_file(path, LOADERS)}")
    behind = file_behind(path)
    mesh = _read(behind, prim)
    is_renamed = behind != path and mesh.name == legible(behind.stem)
    return replace(mesh, name=legible(path.stem)) if is_renamed else mesh


def _read(path: Path, prim: str | Sequence[str] | None) -> PolygonMesh:
    """Read a file that is there.

    Raises:
        InputError: it is none that can be read whole.
    """
    suffix = path.suffix.lower()
    if suffix in usd.LOADERS:
        return usd.read_usd(path, prim)
    check_regular(path)
    if suffix in BY_NAME:
        return BY_NAME[suffix](path, prim)
    if prim is not None:
        raise InputError(
            f"{path}: prim {prim} selects an object of a file; expected one of those that name them "
            f"({' '.join([*usd.LOADERS, *BY_NAME])})"
        )
    return LOADERS[suffix](path)
