"""Any mesh file, by its suffix."""

from pathlib import Path

from balloon_warp.errors import InputError
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import welded

OBJ_SUFFIXES = (".obj",)
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
FOREIGN_SUFFIXES = (".stl", ".ply", ".off", ".glb", ".gltf")
MESH_SUFFIXES = OBJ_SUFFIXES + USD_SUFFIXES + FOREIGN_SUFFIXES


def load_mesh(path: Path | str, weld: bool = False) -> PolygonMesh:
    """Read a mesh: polygons from OBJ and USD, triangles from STL, PLY, OFF, glTF and GLB.

    Args:
        weld: join faces where vertices lie at exactly the same place.

    Raises:
        InputError: there is no such file, its suffix is none of these, or its content is wrong.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a mesh file")
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputError(f"{path}: expected a mesh file ({' '.join(MESH_SUFFIXES)}), got suffix {suffix or 'none'}")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    mesh = _read(path, suffix)
    return welded(mesh) if weld else mesh


def _read(path: Path, suffix: str) -> PolygonMesh:
    # Only the one format's library is loaded.
    if suffix in OBJ_SUFFIXES:
        from balloon_warp.mesh.obj import read_obj

        return read_obj(path)
    if suffix in USD_SUFFIXES:
        from balloon_warp.mesh.usd import read_usd

        return read_usd(path)
    from balloon_warp.mesh.foreign import read_foreign

    return read_foreign(path)
