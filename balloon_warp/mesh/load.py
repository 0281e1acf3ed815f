"""Any mesh file, by its suffix. Each format says in its own file which suffixes are its, and how they are read."""

from pathlib import Path

from balloon_warp.errors import InputError
from balloon_warp.meant import did_you_mean_file
from balloon_warp.mesh import obj, trimesh_formats, usd
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import welded

LOADERS = obj.LOADERS | usd.LOADERS | trimesh_formats.LOADERS


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
    if suffix not in LOADERS:
        raise InputError(f"{path}: expected a mesh file ({' '.join(LOADERS)}), got suffix {suffix or 'none'}")
    if not path.exists():
        raise InputError(f"{path}: no such file{did_you_mean_file(path, LOADERS)}")
    mesh = LOADERS[suffix](path)
    return welded(mesh) if weld else mesh
