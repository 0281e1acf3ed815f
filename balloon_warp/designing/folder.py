"""The folder of a design: a scene that runs as it is, its files, a picture and a report."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.marks import manifest_text, png_mark
from balloon_warp.mesh import PolygonMesh
from balloon_warp.ownership import require_no_inputs, require_ours, require_ours_in, sole_writer

SCENE, REPORT = "balloon.toml", "report.json"
SAVED = "progress.npz"
JOB = "progress.json"
"""File with the request and progress of a design, from which it resumes"""
OURS = re.compile(
    r"balloon(_\d+)?\.(toml|obj|mtl)|springs\.npz|mould\.(stl|obj)|panels\.obj|pattern\.svg|error\.png"
    r"|report\.json|progress\.(npz|json)"
)
"""Names of the files of designs"""


@contextmanager
def own_folder(folder: Path, inputs: Mapping[Path, str]) -> Iterator[None]:
    """Make the folder, where there is none, and keep others from writing there in the `with` block.

    Raises:
        InputError: it cannot be made, is a file, or has files where ours go that are inputs or somebody else's.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = sorted(path.name for path in folder.iterdir() if OURS.fullmatch(path.name))
    except OSError as error:
        raise InputError(f"{folder}: cannot be the output folder: {error.strerror}") from None
    require_no_inputs((folder / name for name in names), inputs)
    require_ours_in(folder, names, (REPORT, JOB))
    require_ours(folder / SCENE)
    with sole_writer(folder):
        yield


def write_springs(
    path: Path, pairs: NDArray[Any], lengths: NDArray[np.float64], constants: NDArray[np.float64]
) -> None:
    """Write a file of springs, which `balloon.springs` names."""
    with whole_file(path) as temporary:
        np.savez_compressed(temporary, pairs=pairs, rest_lengths=lengths, constants=constants)


def write_stl(path: Path, mesh: PolygonMesh, triangles: NDArray[Any], unit: float = 1000.0) -> None:
    """Write a binary STL file in millimeters, which printers take for granted.

    Args:
        unit: of the file, in the mesh's.
    """
    corners = (unit * mesh.points[triangles]).astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(len(triangles), dtype=facet)
    facets["normal"], facets["corners"] = normals, corners
    with whole_file(path) as temporary:
        temporary.write_bytes(b"millimeters".ljust(80) + len(facets).to_bytes(4, "little") + facets.tobytes())


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write the result as a report, for people and programs."""
    with whole_file(path) as temporary:
        temporary.write_text(manifest_text(report), encoding="utf-8")


def write_picture(path: Path, picture: Image.Image) -> None:
    """Write the picture of the errors."""
    with whole_file(path) as temporary:
        picture.save(temporary, format="PNG", optimize=True, pnginfo=png_mark())
