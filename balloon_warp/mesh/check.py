"""Checks of a mesh from any kind of file; its objects, parts and images by name."""

import hashlib
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import Look, Picture, PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    corner_faces,
    face_starts,
    mesh_edges,
    vertex_components,
    with_corners,
)
from balloon_warp.suggestions import did_you_mean

MOST_NAMED = 5
"""Largest number of names in a sentence"""


class Objects:
    """The objects that are taken of a file, by name; all of it where none is named.

    A name may be a path, as of prims: /Room/Wall is an object Wall within Room.
    """

    def __init__(self, named: str | Sequence[str] | None):
        names = [named] if isinstance(named, str) else [*(named or ())]
        self._wanted = {name: tuple(word for word in name.split("/") if word) or (name,) for name in names}
        self._found = set[str]()
        self._known: dict[str, None] = {}

    @property
    def name(self) -> str:
        """Name of the only object that is taken, "" if there are several, or all."""
        only = [words[-1] for words in self._wanted.values()]
        return only[0] if len(only) == 1 else ""

    def takes(self, path: Iterable[str]) -> bool:
        """Return whether an object is taken: it is one of them, or is within one.

        Args:
            path: names of the objects around it, from the outside, and its own.
        """
        whole = [name for name in path if name]
        self._known.update(dict.fromkeys(reversed(whole)))
        hits = [name for name, words in self._wanted.items() if _holds(whole, name, words)]
        self._found.update(hits)
        return bool(hits) or not self._wanted

    def check(self, path: Path) -> None:
        """Make sure that all were found, once all objects of the file have been asked for.

        Raises:
            InputError: one was not; it names those that there are.
        """
        for name in self._wanted:
            if name not in self._found:
                known = [*self._known]
                more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
                has = f"it has {', '.join(known[:MOST_NAMED])}{more}" if known else "nothing in it has a name"
                raise InputError(f"{path}: has no object {name} ({has}){did_you_mean(name.strip('/'), known)}")


def _holds(path: list[str], name: str, words: tuple[str, ...]) -> bool:
    """Return whether a name, or the words of its path in a row, are in another path."""
    return name in path or any(tuple(path[at : at + len(words)]) == words for at in range(len(path)))


Taken = Literal["all", "closed", "largest"]


def parts_taken(mesh: PolygonMesh, taken: Taken, source: object) -> tuple[NDArray[np.bool_], str | None]:
    """Return the vertices of the parts that are taken, shape (vertex_count,), and a sentence about those that are not.

    Args:
        taken: all parts, which share no vertex; those without a border; or the one of the largest area.
        source: where the mesh is from.

    Raises:
        InputError: none is closed; it names `source`.
    """
    edges = mesh_edges(mesh)
    component = vertex_components(mesh, edges)
    of_faces = component[mesh.face_vertex_indices[face_starts(mesh)]]
    parts = np.unique(of_faces)
    if taken == "all":
        kept = parts
    elif taken == "largest":
        kept = parts[[np.bincount(of_faces, face_areas(mesh), mesh.vertex_count)[parts].argmax()]]
    else:
        kept = np.setdiff1d(parts, component[edges.ends[border_edges(edges), 0]])
        if not len(kept):
            open_ = "its part is" if len(parts) == 1 else f"all of its {len(parts):,} parts are"
            raise InputError(
                f'{source}: has no closed part, {open_} open; expected taken = "all" or "largest", or a mesh that '
                "`balloon-warp remesh` made"
            )
    left = len(parts) - len(kept)
    if not left:
        return np.ones(mesh.vertex_count, dtype=bool), None
    faces = np.count_nonzero(~np.isin(of_faces, kept))
    which = "are open" if taken == "closed" else "are smaller than the largest"
    which = which.replace("are", "is") if left == 1 else which
    sentence = f"{left:,} of {len(parts):,} parts, of {faces:,} faces, {'is' if left == 1 else 'are'} left out: "
    return np.isin(component, kept), f"{sentence}{'it' if left == 1 else 'they'} {which}."


def of_vertices(mesh: PolygonMesh, kept: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with the faces of some vertices alone, by a mask; its vertices keep their numbers."""
    if kept.all():
        return mesh
    return _with_faces(mesh, kept[mesh.face_vertex_indices[face_starts(mesh)]])


def of_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some of its faces alone, by a mask, and the vertices and groups that they have."""
    taken = _with_faces(mesh, faces)
    used, indices = np.unique(taken.face_vertex_indices, return_inverse=True)
    groups = {name: np.flatnonzero(np.isin(used, own)).astype(np.int32) for name, own in mesh.groups.items()}
    return replace(
        taken,
        points=mesh.points[used],
        face_vertex_indices=indices.ravel().astype(np.int32),
        groups={name: own for name, own in groups.items() if len(own)},
    )


def _with_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    return replace(with_corners(mesh, faces[corner_faces(mesh)]), face_vertex_counts=mesh.face_vertex_counts[faces])


LARGEST_FILE = 1 << 28
"""Largest size of an image [bytes]"""
KEPT = {"PNG": ".png", "JPEG": ".jpg"}
"""Suffixes of images that stay as they are, by their format; others become PNG"""


class Pictures:
    """Cache of the images that a mesh names, each read once."""

    def __init__(self, source: Path | str):
        self._source = source
        self._read: dict[str, Picture | None] = {}
        self.warnings: list[str] = []
        """Warnings, one for each image that cannot be read or placed"""

    def of_file(self, named: str, folder: Path) -> Picture | None:
        """Read the image of a file.

        Args:
            named: as a mesh names it: from its folder, or, where there is none, its bare name there.
            folder: of the mesh.
        """
        path = beside(folder, named)
        if path is None:
            return self._missing(named)
        if path.stat().st_size > LARGEST_FILE:
            return self.of_bytes(named, b"")
        try:
            return self.of_bytes(named, path.read_bytes(), path)
        except OSError:
            return self.of_bytes(named, b"")

    def of_bytes(self, named: str, data: bytes | None, file: Path | None = None) -> Picture | None:
        """Read the image of a file's content.

        Args:
            data: None where there is no such file.
            file: that it is of, if it is one of its own.
        """
        if data is None:
            return self._missing(named)
        if named not in self._read:
            self._read[named] = _picture(named, data, file)
            if self._read[named] is None:
                self.warnings.append(f"{self._source}: its texture {named} cannot be read as an image; it is left out.")
        return self._read[named]

    def mean_of(self, look: Look, named: str) -> Look:
        """Return a look with the mean color of its image, where the mesh does not say how the image lies on it."""
        if look.picture is None:
            return look
        sentence = f"{self._source}: its texture {named} has no coordinates on the mesh; its mean color is taken."
        if sentence not in self.warnings:
            self.warnings.append(sentence)
        return look.plain

    def _missing(self, named: str) -> None:
        if named not in self._read:
            self._read[named] = None
            self.warnings.append(f"{self._source}: its texture {named} is missing; it is left out.")


def beside(folder: Path, named: str) -> Path | None:
    """Find the regular file of a name in a mesh, from the mesh's folder; else that of its bare name there."""
    for name in (named, named.replace("\\", "/"), PureWindowsPath(named).name, PurePosixPath(named).name):
        try:
            if name and (path := folder / name).is_file():
                return path
        except (OSError, ValueError):  # too long for a name, or with a zero in it
            continue
    return None


def _picture(named: str, data: bytes, file: Path | None) -> Picture | None:
    """Decode an image, or return None if it is none."""
    from PIL import Image, UnidentifiedImageError  # only for a mesh that has images

    try:
        with Image.open(io.BytesIO(data)) as image:
            suffix = KEPT.get(image.format or "")
            if suffix is None or image.mode not in ("RGB", "RGBA", "L", "P"):
                deep = image.mode.startswith("I")  # gray in 16 bits
                shown = image.convert("I").point(lambda value: value / 257).convert("L") if deep else image
                with io.BytesIO() as packed:
                    shown.convert("RGB").save(packed, "PNG")
                    suffix, data = KEPT["PNG"], packed.getvalue()
            else:
                image.load()  # to the end: a truncated one would fail once all is done
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        return None
    bare = re.sub(r"[^0-9A-Za-z_-]+", "_", PurePosixPath(named.replace("\\", "/")).stem).strip("_")[:40] or "texture"
    mark = f"_{hashlib.sha256(data).hexdigest()[:8]}"
    return Picture(f"{bare.removesuffix(mark)}{mark}{suffix}", data, file)


FLOAT32_MAX = float(np.finfo(np.float32).max)
LARGEST_FACE = 4096
"""Largest number of corners of a face; the springs across it grow with their square"""
LARGEST_FAN = 256
"""Number of neighbors up to which a particle gets flexion springs between all of them; past one with more, as the hub
of a wheel, each neighbor gets one"""


def check_mesh(mesh: PolygonMesh, source: str, least_corners: int = 3) -> None:
    """Check that a mesh has points and faces, and that they fit together.

    Args:
        least_corners: of a face; with 2, a face may be an edge.

    Raises:
        InputError: names `source` and the first face or vertex, from 1, that is wrong.
    """
    if mesh.vertex_count == 0 or mesh.face_count == 0:
        raise InputError(f"{source}: has {mesh.vertex_count} vertices and {mesh.face_count} faces; expected both")
    outside = ~(np.abs(mesh.points) <= FLOAT32_MAX).all(axis=1)
    if outside.any():
        vertex = int(outside.argmax())
        raise InputError(
            f"{source}: vertex {vertex + 1}: coordinates must be finite and fit in 32-bit floats "
            f"(got {' '.join(map(str, mesh.points[vertex]))})"
        )
    if mesh.face_vertex_counts.min() < least_corners:
        face = int(mesh.face_vertex_counts.argmin())
        raise InputError(
            f"{source}: face {face + 1}: a face needs {'three' if least_corners == 3 else 'two'} corners or more "
            f"(got {mesh.face_vertex_counts[face]})"
        )
    if mesh.face_vertex_counts.max() > LARGEST_FACE:
        face = int(mesh.face_vertex_counts.argmax())
        raise InputError(
            f"{source}: face {face + 1}: a face may have at most {LARGEST_FACE:,} corners "
            f"(got {mesh.face_vertex_counts[face]:,})"
        )
    corner_count = int(mesh.face_vertex_counts.sum(dtype=np.int64))
    if corner_count != len(mesh.face_vertex_indices):
        raise InputError(
            f"{source}: the face sizes add up to {corner_count} corners, but {len(mesh.face_vertex_indices)} are given"
        )
    for index in (mesh.face_vertex_indices.min(), mesh.face_vertex_indices.max()):
        if not 0 <= index < mesh.vertex_count:
            raise InputError(f"{source}: a face refers to point {index}; expected 0 to {mesh.vertex_count - 1}")
