"""Loading of meshes: a file, by its suffix, or a mesh-like value of Python.

Each format lists its suffixes and readers in its own file.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.files import check_regular, file_behind, legible
from balloon_warp.mesh import gltf, obj, trimesh_formats, usd
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.from_python import MeshLike, mesh_from
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.suggestions import did_you_mean_file

BY_NAME = obj.LOADERS | gltf.LOADERS
"""Readers of files that name their objects"""
LOADERS = obj.LOADERS | usd.LOADERS | trimesh_formats.LOADERS | gltf.LOADERS


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
