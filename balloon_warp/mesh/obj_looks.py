"""Looks as an OBJ file has them: materials in an .mtl beside it, and colors behind the coordinates of vertices."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.files import check_writable, whole_file
from balloon_warp.marks import LINE
from balloon_warp.mesh.looks import WHITE, Looks, encoded
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.ownership import require_ours

PLAIN = "plain"
"""Material of faces that have none"""


def check_materials(path: Path) -> None:
    """Make sure that the materials of an OBJ file can be written beside it.

    Raises:
        InputError: they cannot, or somebody else's stand there.
    """
    library = path.with_suffix(".mtl")
    check_writable(library, (".mtl",))
    require_ours(library, f"the materials of {path.name} go")


def write_materials(path: Path, looks: Looks) -> list[str]:
    """Write the materials that an OBJ file names beside it, and their images into the folder `textures`.

    Returns:
        The names of the materials, and last the one of faces without any.

    Raises:
        InputError: they cannot be written.
    """
    check_materials(path)
    names, lines = [], [f"# {LINE}\n"]
    for number, look in enumerate(looks.materials):
        names.append(f"{'_'.join(look.name.split()) or 'material'}_{number}")
        color, picture = look.color, look.picture
        if picture is not None and color != WHITE:  # most programs pass over a color beside an image
            color, picture = WHITE, picture.times(color)
        lines.append(f"newmtl {names[-1]}\nKd {' '.join(f'{shade:.6g}' for shade in color)}\n")
        if picture is not None:
            picture.write_beside(path)
            lines.append(f"map_Kd {picture.path.removeprefix('./')}\n")
    lines.append(f"newmtl {PLAIN}\n")
    with whole_file(path.with_suffix(".mtl")) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8", errors="replace", newline="\n")
    return [*names, PLAIN]


def vertex_colors(mesh: PolygonMesh) -> NDArray[np.float64] | None:
    """Return sRGB at each vertex, the mean of its corners', where any has a color, shape (vertex_count, 3).

    White where none has, by which a material is not changed.
    """
    looks = mesh.looks
    if looks is None or looks.colors is None:
        return None
    said = np.isfinite(looks.colors).all(axis=1) & (looks.of_corners < 0)
    at = mesh.face_vertex_indices[said]
    counts = np.bincount(at, minlength=mesh.vertex_count)
    sums = [np.bincount(at, shade, mesh.vertex_count) for shade in looks.colors[said].T]
    means = np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None]
    return encoded(np.where(counts[:, None] > 0, means, 1.0))
