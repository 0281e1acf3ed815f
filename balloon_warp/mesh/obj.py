"""Wavefront OBJ files: vertices and polygons, kept as they are written. The n-th `v` line is vertex n.

Texture coordinates go along, base colors and base textures of the .mtl, and the names of groups and objects. Normals,
lines and curves are passed over.
"""

import io
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.files import legible, regular_content, whole_file
from balloon_warp.marks import LINE
from balloon_warp.mesh.check import FLOAT32_MAX, LARGEST_FACE
from balloon_warp.mesh.corners import face_starts
from balloon_warp.mesh.obj_groups import ObjGroups
from balloon_warp.mesh.obj_looks import vertex_colors, write_materials
from balloon_warp.mesh.obj_materials import ObjMaterials
from balloon_warp.mesh.obj_textures import ObjTextures
from balloon_warp.mesh.objects import Objects
from balloon_warp.mesh.parts import of_faces
from balloon_warp.mesh.polygon_mesh import PolygonMesh

COMPRESSED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"(\xb5/\xfd": "Zstandard"}
"""Compressions by the first bytes of a file"""


class _LineError(Exception):
    """Mistake in a line."""


def read_obj(path: Path | str, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read vertices and polygons. OBJ says nothing of axes and units: they are taken as Y up and meters.

    Args:
        path: of the file; reading takes up to nine times as much memory as it has bytes.
        prim: the name of an object or a group, or several: their faces and vertices alone are taken.

    Raises:
        InputError: the file cannot be read, has no such object, or a line is wrong; it names the line and the reason.
    """
    path = Path(path)
    # Arrays of machine numbers: lists would take ten times as much memory as the file.
    coordinates, vertex_lines = array("d"), array("i")
    corners, sizes, face_lines = array("i"), array("i"), array("i")
    textures, groups, materials = ObjTextures(), ObjGroups(), ObjMaterials(path)
    for number, line in _lines(path):
        kind, *rest = line.split(None, 1) or [b""]
        words = rest[0].split() if rest and kind in (b"v", b"f", b"vt") else []
        try:
            if kind == b"v":
                coordinates.extend(_coordinates(words))
                if len(words) > 5:
                    materials.add_vertex(words)
                vertex_lines.append(number)
            elif kind == b"f":
                face = _face(words, len(vertex_lines))
                corners.extend(face)
                sizes.append(len(face))
                face_lines.append(number)
                textures.add_face(words)
            elif kind == b"vt":
                textures.add_vertex(words)
            elif kind in (b"g", b"o"):
                groups.begin(kind, rest[0] if rest else b"", len(sizes))
            elif kind == b"usemtl":
                materials.use(rest[0] if rest else b"", len(sizes))
            elif kind == b"mtllib" and rest:
                materials.add_library(rest[0])
        except _LineError as problem:
            raise InputError(f"{path}, line {number}: {problem} (got {_quote(line)})") from None
    if not vertex_lines:
        raise InputError(f"{path}: has no vertices (no line begins with v)")
    if not face_lines:
        raise InputError(f"{path}: has no faces (no line begins with f)")

    counts, indices = np.frombuffer(sizes, dtype=np.int32), np.frombuffer(corners, dtype=np.int32)
    mesh = PolygonMesh(
        points=np.frombuffer(coordinates).reshape(-1, 3),
        face_vertex_counts=counts,
        face_vertex_indices=indices,
        name=legible(path.stem),
        groups=groups.of_vertices(counts, indices),
    )
    _check_numbers(path, mesh, vertex_lines, face_lines)
    places = textures.of_corners(partly=True)
    looks = materials.of_corners(mesh, placed=places is not None)
    if looks is None or not looks.pictures:
        places = textures.of_corners()
    mesh = replace(mesh, texture_coordinates=places, looks=looks, warnings=materials.warnings)
    return mesh if prim is None else _objects_of(mesh, path, groups, Objects(prim))


def _objects_of(mesh: PolygonMesh, path: Path, groups: ObjGroups, objects: Objects) -> PolygonMesh:
    """Return the taken objects of a mesh, without the other objects' vertices."""
    faces = groups.faces_of([name for name in mesh.groups if objects.takes([name])], mesh.face_count)
    objects.check(path)
    return replace(of_faces(mesh, faces), name=objects.name or mesh.name)


def _check_numbers(path: Path, mesh: PolygonMesh, vertex_lines: Sequence[int], face_lines: Sequence[int]) -> None:
    """Check coordinates and vertex numbers.

    Raises:
        InputError: A coordinate is too large, or a face names a vertex that is not there; it names the line.
    """
    outside = ~(np.abs(mesh.points) <= FLOAT32_MAX).all(axis=1)
    if outside.any():
        vertex = int(outside.argmax())
        got = " ".join(map(str, mesh.points[vertex]))
        raise InputError(
            f"{path}, line {vertex_lines[vertex]}: coordinates must be finite and fit in 32-bit floats (got {got})"
        )
    # A face may stand above its vertices, so this shows only at the end.
    missing = mesh.face_vertex_indices >= mesh.vertex_count
    if missing.any():
        corner = int(missing.argmax())
        line = face_lines[int(np.searchsorted(np.cumsum(mesh.face_vertex_counts), corner, side="right"))]
        vertex = mesh.face_vertex_indices[corner] + 1
        raise InputError(f"{path}, line {line}: there is no vertex {vertex}, the file has {mesh.vertex_count}")


LOADERS = {".obj": read_obj}


def write_obj(path: Path | str, mesh: PolygonMesh) -> None:
    """Write vertices and polygons, with texture coordinates and looks where there are some.

    Materials go into an .mtl beside the file, images into a folder `textures`. Reading them gives the same float64
    points. The file appears whole or not at all.

    Raises:
        InputError: the file cannot be written, or the .mtl is another program's.
    """
    path = Path(path)
    colors = vertex_colors(mesh)
    ends = [""] * mesh.vertex_count if colors is None else [" {:.5g} {:.5g} {:.5g}".format(*c) for c in colors.tolist()]
    lines = [f"v {x!r} {y!r} {z!r}{end}\n" for (x, y, z), end in zip(mesh.points.tolist(), ends, strict=True)]
    corners = list(map(str, (mesh.face_vertex_indices + 1).tolist()))
    if mesh.texture_coordinates is not None:
        places, numbers = np.unique(mesh.texture_coordinates, axis=0, return_inverse=True)
        lines += [f"vt {u:.7g} {v:.7g}\n" for u, v in places.tolist()]
        corners = [f"{corner}/{number}" for corner, number in zip(corners, numbers.ravel() + 1, strict=True)]
    begins = _material_lines(path, mesh)
    if begins:
        lines.insert(0, f"mtllib {path.with_suffix('.mtl').name}\n")
    lines.insert(0, f"# {LINE}\n")
    begin = 0
    for face, end in enumerate(np.cumsum(mesh.face_vertex_counts).tolist()):
        lines.append(f"{begins.get(face, '')}f {' '.join(corners[begin:end])}\n")
        begin = end
    with whole_file(path) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8", errors="surrogateescape", newline="\n")


def _material_lines(path: Path, mesh: PolygonMesh) -> dict[int, str]:
    """Write a mesh's materials; return the line that stands before each face from which on it is another."""
    if mesh.looks is None or not mesh.looks.materials or not mesh.face_count:
        return {}
    names = write_materials(path, mesh.looks)
    of_faces = mesh.looks.of_corners[face_starts(mesh)]
    begins = np.flatnonzero(np.append(True, of_faces[1:] != of_faces[:-1])).tolist()
    return {face: f"usemtl {names[of_faces[face]]}\n" for face in begins}


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Iterate over the lines of the file with their numbers, without comments.

    A continued line has the number of its first part.
    """
    text = _content(path)
    if text.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in text:
        raise InputError(f"{path}: is binary or UTF-16, not the plain text of an OBJ file")
    # Bytes throughout: comments and names may be in any 8-bit encoding.
    text = text.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = enumerate(io.BytesIO(text), start=1)
    if b"#" in text or b"\\" in text:
        return _plain(lines)
    return lines


def _plain(lines: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Return the lines without comments, each continued one joined with those that follow."""
    for number, line in lines:
        line = line.partition(b"#")[0]
        yield number, _joined(line, lines) if line.rstrip().endswith(b"\\") else line


def _joined(line: bytes, following: Iterator[tuple[int, bytes]]) -> bytes:
    """Return a line that ends in a backslash, and those that it is continued on."""
    whole = bytearray()
    while (text := line.rstrip()).endswith(b"\\"):
        whole += text[:-1] + b" "
        _, line = next(following, (0, b""))
        line = line.partition(b"#")[0]
    return bytes(whole + line)


def _content(path: Path) -> bytes:
    content = regular_content(path)
    for opening, format_name in COMPRESSED.items():
        if content.startswith(opening):
            raise InputError(f"{path}: is compressed ({format_name}), not the plain text of an OBJ file")
    return content


def _coordinates(words: list[bytes]) -> list[float]:
    """Return the first three numbers of a `v` line. A weight or a color may follow."""
    if len(words) < 3:
        raise _LineError(f"a vertex needs three coordinates, not {len(words)}")
    try:
        numbers = list(map(float, words))
    except ValueError:
        raise _LineError("coordinates must be decimal numbers") from None
    if b"_" in b"".join(words):  # which Python reads, as in 1_000
        raise _LineError("coordinates must be decimal numbers")
    return numbers[:3]


def _face(words: list[bytes], above: int) -> list[int]:
    """Return the vertices of an `f` line, from 0; of v/vt/vn only v is read. `above` vertices stand above the line."""
    if len(words) < 3:
        raise _LineError(f"a face needs three corners or more, not {len(words)}")
    if len(words) > LARGEST_FACE:
        raise _LineError(f"a face may have at most {LARGEST_FACE:,} corners, not {len(words):,}")
    try:
        numbers = [int(word.split(b"/", 1)[0]) for word in words]
    except ValueError:
        raise _LineError("vertex numbers must be integers") from None
    if min(numbers) < 1 or max(numbers) > above or b"_" in b"".join(words):
        return [_vertex(number, word, above) for number, word in zip(numbers, words, strict=True)]
    return [number - 1 for number in numbers]


def _vertex(number: int, word: bytes, above: int) -> int:
    """Return a vertex, from 0, from its number in the file: from 1, or negative, counting back from the last."""
    if b"_" in word:
        raise _LineError("vertex numbers must be integers")
    if number == 0:
        raise _LineError("vertex numbers begin at 1, not 0")
    if abs(number) > np.iinfo(np.int32).max:
        raise _LineError(f"there is no vertex {_shortened(str(number))}, which takes more than 32 bits")
    if number < -above:
        raise _LineError(f"there is no vertex {number}, only {above} stand above this line")
    return number - 1 if number > 0 else above + number


def _quote(line: bytes) -> str:
    return repr(_shortened(line.strip().decode("latin-1")))


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:60]}..."
